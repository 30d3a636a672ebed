"""What a log looks like before it is solved: mistakes of each robot by itself, and in sightings of robots.

    each robot   what two looks at a landmark plainly speak for, tried on one stretch of its way (see `alone`)
    the team     a stretch mapped by odometry and landmarks alone: sightings of robots that are far off there, and are
                 not once they are read in another way

A log with no mistake costs a look over its triangles, and one map of a stretch.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from teamslam.model import Dataset, Table, Values, told_by
from teamslam.trust.cause import Cause
from teamslam.trust.causes.alone import LIKE, SURE, Found, Mistake, mistake_of, names_of_slips, slip_of
from teamslam.trust.causes.between import cost_at, unlikely_at, without_links
from teamslam.trust.causes.search import agreed, in_words
from teamslam.trust.causes.stretches import busiest
from teamslam.trust.causes.trial import Trial
from teamslam.trust.residuals import beside_median

PLAIN = 0.6  # of how far triangles are off, that is left without a mistake
BAD = 9.0  # of the median squared residual of sightings of robots, where landmarks put these
GOOD = 0.2  # of it, that is left without a mistake
FEWEST = 8  # sightings of robots


def looks_like(log: Dataset) -> Iterator[Cause]:
    """The mistakes that a log plainly looks like, in words."""
    alone = [found for robot in sorted(log.robots) if (found := mistake_of(log, robot, PLAIN)) is not None]
    between = [] if alone or len(log.robots) < 2 else list(_in_sightings_of_robots(log))
    for cause in in_words(agreed(alone or between), log):
        cure = "; expected metres and radians: convert them" if cause.kind in ("unit", "degrees") else ""
        yield replace(cause, sentence=cause.sentence + cure)


def _in_sightings_of_robots(log: Dataset) -> Iterator[Found]:
    """The slips in sightings of robots, of each sensor of each robot."""
    stretch = Trial.of(busiest(log)).log
    links = [t for t in stretch.tables if t.observes_robots]
    blind = Trial(without_links(stretch)).values if links else None
    if blind is None:
        return
    for (robot, _, _), group in groupby(sorted(links, key=_sensor), _sensor):
        mine = list(group)
        if (before := _typical(mine, blind)) > BAD:
            yield from _best(stretch.with_tables(mine), robot, before, blind)


def _sensor(table: Table) -> tuple[int, str, str]:
    return table.robot, table.source, table.model


def _best(links: Dataset, robot: int, before: float, blind: Values) -> Iterator[Found]:
    """The likeliest slip in one sensor's sightings of robots, with others as likely, if it leaves little."""
    slips = [slip_of(name, (robot,), links.tables) for name in names_of_slips(links.tables)]
    meant = [slip.mend(links).tables for slip in slips]
    written = unlikely_at(links.tables, blind)
    gains = [written - unlikely_at(t, blind) + 2.0 * slip.unit for t, slip in zip(meant, slips, strict=True)]
    good = [n for n in range(len(slips)) if gains[n] > SURE and _typical(meant[n], blind) < GOOD * before]
    if not good:
        return
    best = max(good, key=lambda n: gains[n])
    near = [n for n in good if gains[n] > gains[best] - LIKE * max(_typical(meant[best], blind), 1.0)]
    least = min(slips[n].changes for n in near)
    each: dict[tuple[str, str], Mistake] = {
        (slips[n].kind, slips[n].looks): slips[n] for n in near if slips[n].changes == least
    }
    numbers = float(sum(table.dof for table in links.tables))
    yield Found(tuple(each.values()), cost_at(links.tables, blind), cost_at(meant[best], blind), numbers)


def _typical(tables: Sequence[Table], values: Values) -> float:
    """The median squared residual, over what it should be, of rows whose poses are known; 0 of too few."""
    known = told_by(tables, values.layout)
    sizes = [beside_median(np.sum(t.whitened(values) ** 2, -1), t.ranks) for t in known]
    found = np.concatenate([np.zeros(0), *sizes])
    return float(np.median(found)) if len(found) >= FEWEST else 0.0
