"""Units that do not fit between odometry and sightings, told without solving anything.

Triangles of two looks at a landmark and the odometry between them (see `pairs`) close to within their noise. Where they
are far from it, and close once lengths of one sensor are taken as millimetres, or its angles as degrees, that is what
they are. No half-way case is told: a badly calibrated log closes badly in every unit. Nor are kilometres: sightings
taken for a thousand times as long close within angles that reach as much farther.
"""

from collections.abc import Iterator

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array
from teamslam.model import Dataset
from teamslam.trust.cause import rows_called
from teamslam.trust.causes.pairs import misfit, pairs_of, way_of
from teamslam.trust.causes.slips import TOO, slips, without
from teamslam.trust.causes.turns import with_turns_in_radians

FEWEST = 20  # triangles
BAD = 12.0  # of the median of a sensor's triangles as it is written; logs without a mistake have 1 or less
GOOD = 2.0  # and as it is meant
NEAR = 1.0  # another unit that closes within this, or NEXT times as well, leaves it open
NEXT = 4.0
ODOMETRY = "odometry"
DEGREES = "degrees"
KNOWN = ("millimetres", "centimetres", "feet", DEGREES)


def units_that_do_not_fit(log: Dataset, robot: int) -> Iterator[str]:
    """What a robot's sensors look like whose units do not fit its other ones, in words; nothing where all fit, or where
    no unit makes them fit."""
    mine = log.of_robot(robot)
    before = _closing(mine, robot)
    if before is None or before < BAD:
        return
    ranked = sorted(_tried(mine, robot), key=lambda found: found[0])
    if not ranked or ranked[0][0] > GOOD:
        return
    after = ranked[0][0]
    near = [(sensor, looks) for off, sensor, looks in ranked if off <= max(NEAR, NEXT * after)]
    # Lengths taken for shorter ones hide angles that are wrong; angles hide no lengths.
    near = [found for found in near if DEGREES in found[1]] or near
    said = ", or ".join(dict.fromkeys(f"{sensor}: {looks}" for sensor, looks in near))
    yield (
        f"robot {log.names.robot(robot)}, {said}, as far as two looks at a landmark and the odometry between them tell "
        f"(they disagree by {np.sqrt(before):.2g} sigma, so read by {np.sqrt(after):.2g}); "
        f"expected metres and radians: convert them"
    )


def _tried(log: Dataset, robot: int) -> Iterator[tuple[float, str, str]]:
    """How well triangles close with each sensor in each unit, with the sensor and the unit in words."""
    for source, model in dict.fromkeys((t.source, t.model) for t in log.tables if not t.observes_robots):
        first = next(t for t in log.tables if (t.source, t.model) == (source, model))
        for slip in slips(first.model, first.dim):
            if slip.name.removesuffix(f" {TOO}") in KNOWN:
                meant = log.with_tables(
                    without(t, slip.name) if (t.source, t.model) == (source, model) else t for t in log.tables
                )
                if (after := _closing(meant, robot)) is not None:
                    yield after, "odometry" if source == ODOMETRY else rows_called(source), slip.looks
    turned = with_turns_in_radians(log, robot)
    if all(new is old for new, old in zip(turned.tables, log.tables, strict=True)):
        return
    if (after := _closing(turned, robot)) is not None:
        yield after, "odometry", "turns are in degrees"


def _closing(log: Dataset, robot: int) -> float | None:
    """The median misfit of a robot's triangles, of its worst sensor; None where there are too few, or no way to be
    had."""
    try:
        way = way_of(log, robot)
    except TeamslamError:
        return None
    found: list[Array] = [misfit(table, pairs_of(log, robot, table), way) for table in log.tables]
    medians = [float(np.median(off)) for off in found if len(off) >= FEWEST]
    return max(medians, default=None)
