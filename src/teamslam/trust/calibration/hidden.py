"""What a map hides: errors that all targets of one image have in common, taken up by the pose from which it was taken.

Where a robot's odometry lets its heading go, an error common to all bearings of an image is a turn of the robot, and
nothing that a team measures tells one from the other. What is left of such bearings is only how they differ. So where
a map takes up most of such an error, small residuals do not show a small deviation, and it is left as stated.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.posterior import Fit

DRAWS = 4
MOST = 0.5  # of the variance


def hidden(
    fit: Fit, now: Sequence[Noise], kinds: Mapping[tuple[str, str, int], Sequence[int]], rng: np.random.Generator
) -> Mapping[int, BoolArray]:
    """Of each table of sightings, by `kinds`, which parts' common errors (rows,) the map takes up; all robots'
    together."""
    rows = {kind: now[members[0]].deviation.shape[1] for kind, members in kinds.items()}
    made = np.zeros((len(fit.linear.errors), max(rows.values(), default=0) * DRAWS))
    errors = fit.linear.by_tables(made)
    for kind, members in kinds.items():
        for k in members:
            _, image = np.unique(now[k].table.keys[:, 0], return_inverse=True)
            for part in range(rows[kind]):
                common = rng.standard_normal((image.max() + 1, DRAWS))[image]
                errors[k][:, part, _of(part)] = common * now[k].deviation[:, part, None]
    left = fit.linear.by_tables(fit.left(made))
    out = {k: np.zeros(rows[kind], bool) for kind, members in kinds.items() for k in members}
    for kind, members in kinds.items():
        for part in range(rows[kind]):
            kept = sum(_size(left[k], now[k], part) for k in members)
            whole = sum(_size(errors[k], now[k], part) for k in members)
            for k in members:
                out[k][part] = kept < (1.0 - MOST) * whole
    return out


def _of(part: int) -> slice:
    """The draws in which this part errs."""
    return slice(part * DRAWS, (part + 1) * DRAWS)


def _size(errors: Array, noise: Noise, part: int) -> float:
    deviation = np.broadcast_to(noise.deviation[:, part], len(errors))
    seen = deviation > 0.0
    return float(np.sum((errors[seen, part, _of(part)] / deviation[seen, None]) ** 2))
