"""The search for what a misfit looks like.

    each robot by itself      slips in its odometry or its sightings, its clock              `alone`
    the robots together       slips in sightings of robots, whole robots, robots' clocks     `between`
    steps                     of odometry that contradict all else                           `jumps`
    tags                      of another size than stated                                    `sizes`
    landmarks                 in two places                                                  `places`
    the world                 in other units, mirrored, or another one                       `world`

Each later step looks at what the ones before leave; a mistake of a table bends the map so much that what it says of
landmarks means nothing, so these are looked at where nothing else was found. Nothing is looked for where no sensor and
no landmark costs notably too much.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.joining import Joined
from teamslam.model import Dataset, Table
from teamslam.trust.cause import Cause, rows_called
from teamslam.trust.causes.alone import SURE, Found, Mistake, mistake_of
from teamslam.trust.causes.between import FITS, may_disagree, mistakes_between
from teamslam.trust.causes.jumps import jumps
from teamslam.trust.causes.places import two_places
from teamslam.trust.causes.sizes import wrong_size_of_all, wrong_sizes
from teamslam.trust.causes.stretches import busiest
from teamslam.trust.causes.trial import Trial
from teamslam.trust.causes.world import mistakes_in_the_world
from teamslam.trust.residuals import Residuals, Rows
from teamslam.trust.tally import Tally, by_landmark, by_robot, by_sensor

MOST_ROBOTS = 8  # that are looked at one by one, the worst first
BAD_SENSOR, BAD_LANDMARK = 2.0, 3.0  # times the expected cost, from which a mistake is looked for
EXCESS = 50.0  # of cost, that must go with it
UNCERTAIN = 0.3  # of the cost of a row, by what is not known of its leverage


def mistakes_in(
    log: Dataset,
    joined: Joined,
    parts: Sequence[Residuals],
    *,
    far: bool = False,
    stated: Sequence[Table] | None = None,
) -> list[Cause]:
    """The mistakes in a log that explain why its map does not fit; `parts` are the residuals at the map. Of one that is
    `far` from where its rows would have it, by its join, residuals tell nothing, and only the world is asked. `stated`:
    the log's tables with the noise that it states, where this has been put right."""
    rows = [row for part in parts for row in part.rows]
    if far or _bad(by_sensor(rows)[0], BAD_SENSOR):
        in_the_world = mistakes_in_the_world(log)
        if in_the_world or far:
            return in_the_world
    both = list(zip(joined.components, parts, strict=True))
    costly = _bad(by_landmark(rows), BAD_LANDMARK)
    worst = _bad(by_sensor(rows)[0], BAD_SENSOR) or costly
    of_all = [cause for component, part in both if worst for cause in wrong_size_of_all(log, component.map, part.rows)]
    if of_all:
        return of_all
    sizes = [cause for component, part in both if costly for cause in wrong_sizes(log, component.map, part.rows)]
    if sizes:
        return sizes
    bad = _bad(by_sensor(rows)[0], BAD_SENSOR)
    found = mistakes_of_tables(log, rows) if bad else []
    found = found or [cause for component in joined.components for cause in jumps(log, component.map, stated=stated)]
    if found or not costly:
        return found
    return [cause for component, part in both for cause in two_places(log, component.map, part.rows, all_of_it=bad)]


def _bad(tally: Tally, ratio: float) -> bool:
    """Whether any group costs notably too much, whatever its leverage: of that some is uncertain."""
    surely = tally.cost > ratio * (np.maximum(tally.expected, 0.0) + UNCERTAIN * tally.rows)
    return bool((tally.high & surely & (tally.excess > EXCESS)).any())


def mistakes_of_tables(log: Dataset, rows: Sequence[Rows]) -> list[Cause]:
    """The mistakes in tables, whole robots and clocks: each robot by itself, then what is left between them."""
    order = _worst_first(log, rows)
    alone = [found for robot in order[:MOST_ROBOTS] if (found := mistake_of(log, robot)) is not None]
    alone = _decided(log, rows, agreed(alone))
    open_between = len(log.robots) > 1 and (alone or may_disagree(rows))
    between = mistakes_between(_mended(busiest(log, rows), alone), order) if open_between else []
    return [*in_words(alone, log), *in_words(between, log)]


def _mended(log: Dataset, found: Sequence[Found], choice: int = 0) -> Dataset:
    """A log without the mistakes found, of each with several ways to see it the one of a number, as far as it has so
    many; what cannot be mended here stays."""
    for each in found:
        with suppress(TeamslamError):
            log = each.alternatives[min(choice, len(each.alternatives) - 1)].mend(log)
    return log


def mistakes_of_robots(log: Dataset, robots: Iterable[int]) -> list[Cause]:
    """The mistakes of some robots, each by itself: of robots that no map is known of."""
    robots = sorted(robots)[:MOST_ROBOTS]
    return list(in_words(agreed([found for robot in robots if (found := mistake_of(log, robot)) is not None]), log))


def agreed(alone: Sequence[Found]) -> list[Found]:
    """Mistakes of robots by themselves, of each what explains most of them, where several explain one; of one kind in
    one sensor, one."""
    votes = Counter(mistake.key for found in alone for mistake in found.alternatives)
    agreed = []
    for found in alone:
        most = max(votes[mistake.key] for mistake in found.alternatives)
        best = [mistake for mistake in found.alternatives if votes[mistake.key] == most]
        each = {(mistake.source, mistake.kind): mistake for mistake in reversed(best)}
        agreed.append(replace(found, alternatives=tuple(reversed(each.values()))))
    return agreed


def _worst_first(log: Dataset, rows: Sequence[Rows]) -> list[int]:
    tally = by_robot(rows)
    excess = dict(zip(tally.labels.tolist(), tally.excess.tolist(), strict=True))
    return sorted(log.robots, key=lambda robot: -excess.get(robot, 0.0))


def _decided(log: Dataset, rows: Sequence[Rows], alone: list[Found]) -> list[Found]:
    """Mistakes of which the team knows which one it is, where a robot by itself cannot: eyes or wheels."""
    open_ones = [found for found in alone if len(found.alternatives) > 1]
    if not open_ones or len(log.robots) < 2:
        return alone
    stretch, most = Trial.of(busiest(log, rows)).log, min(len(found.alternatives) for found in open_ones)
    tried = [Trial(_mended(stretch, alone, choice)) for choice in range(most)]
    extent = next((trial.extent for trial in tried if trial.optima), 1.0)
    units = [2.0 * sum(found.alternatives[choice].unit for found in open_ones) for choice in range(most)]
    rank = [trial.unlikely(extent) - unit for trial, unit in zip(tried, units, strict=True)]
    good = [choice for choice in range(most) if rank[choice] - min(rank) < SURE]
    if min((tried[choice].ratio for choice in good), default=FITS) >= FITS:
        return alone
    return [_only(found, good) if found in open_ones else found for found in alone]


def _only(found: Found, choices: Sequence[int]) -> Found:
    return replace(found, alternatives=tuple(found.alternatives[n] for n in choices))


# --- words ------------------------------------------------------------------------------------------------------------


def in_words(found: Sequence[Found], log: Dataset) -> Iterator[Cause]:
    """A sentence for each mistake, of all robots that make it."""
    alike: dict[tuple[object, ...], list[Found]] = {}
    for each in found:
        alike.setdefault(tuple(m.key for m in each.alternatives), []).append(each)
    for same in alike.values():
        robots = tuple(sorted({robot for each in same for m in each.alternatives for robot in m.robots}))
        ways = range(len(same[0].alternatives))
        said = [_said([each.alternatives[way] for each in same], log) for way in ways]
        worst = max(same, key=lambda each: each.before)
        before = f"{worst.before:,.0f}" if worst.before < 1e15 else "more than can be solved"
        sums = f"a stretch that costs {before} costs {worst.after:,.0f} without that ({worst.expected:,.0f} expected)"
        kind = same[0].alternatives[0].kind
        explains, mend = min(each.explains for each in same), partial(_mended, found=same)
        yield Cause(kind, f"{', or '.join(said)}; {sums}", explains, robots, mend)


def _said(same: Sequence[Mistake], log: Dataset) -> str:
    """One mistake of some robots; of several amounts, from the least to the most."""
    who = _robots(sorted({robot for mistake in same for robot in mistake.robots}), log)
    amounts = sorted({f"{abs(m.amount) * log.names.tick_s:.2g}" for m in same}, key=float)
    unit = "poses" if log.names.counts else "s"
    between = f"{amounts[0]} {unit}" if len(amounts) == 1 else f"{amounts[0]} to {amounts[-1]} {unit}"
    return f"{who}{_what(same[0])}: {same[0].looks.format(between)}"


def _robots(robots: Sequence[int], log: Dataset) -> str:
    if len(robots) > 1 and set(robots) == set(log.robots):
        return "all robots"
    return log.names.these(robots)


def _what(mistake: Mistake) -> str:
    if not mistake.source:
        return ""
    return ", " + {"odometry": "odometry", "sightings": "sightings"}.get(mistake.source, rows_called(mistake.source))
