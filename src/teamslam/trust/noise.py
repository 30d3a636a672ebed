"""How large the residuals of each sensor are beside their standard deviations, and how many are outliers.

Per part of a measurement (range, bearing, x, theta, ...): the median of |e / sigma| over that of a Gaussian whose
variance is what the map left of it, 1 - followed. A median does not see outliers; they are counted apart: the share of
rows beyond what one Gaussian in a thousand is, in the spread that the bulk shows.

Noise changes its sign from one sighting of a thing to the next as often as not; what a wrong map leaves does not, as it
is off by nearly the same for a while. So residuals that keep their sign say nothing of sigmas, however large they are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from teamslam.geometry import Array
from teamslam.model import is_pose, robot_of
from teamslam.trust.residuals import Rows
from teamslam.trust.tally import kind_of

MEDIAN = 0.6744898  # of |x|, x Gaussian
ONE_IN_1000 = 3.2905267  # |x| beyond it
FEWEST = 30  # rows to speak of a spread
LEFT = 0.3  # of the variance: where a map follows a part more closely, what is left says little of the sigma
FEWEST_PAIRS = 10  # of one thing seen twice running, to speak of signs
KEPT = 0.65  # of the signs, at most, of what is noise


@dataclass(frozen=True)
class Noise:
    """One part of one sensor of one robot: residuals are `scale` times as large as stated; `outliers`, a share of all
    `rows`, are none of the bulk's; `kept` is the share of successive residuals of one thing that are of one sign."""

    robot: int
    source: str
    part: str
    rows: int
    scale: float
    outliers: float
    kept: float = 0.5

    @property
    def is_noise(self) -> bool:
        """Whether the residuals look like noise, and not like a map that is wrong."""
        return self.kept <= KEPT


def noise_of(rows: Sequence[Rows]) -> list[Noise]:
    """The noise of every part of every sensor that has rows enough and whose residuals are not all taken up."""
    found = []
    for (robot, source, _), group in groupby(sorted(rows, key=kind_of), kind_of):
        found += [Noise(robot, source, *part) for part in _parts(list(group))]
    return found


def _parts(group: Sequence[Rows]) -> Iterator[tuple[str, int, float, float, float]]:
    table, count = group[0].table, sum(map(len, group))
    if count < FEWEST:
        return
    size = np.abs(np.concatenate([r.parts for r in group]))
    kept = _signs_kept(group)
    followed = np.average([r.followed for r in group], axis=0, weights=[len(r) for r in group])
    for place, name in enumerate(table.row.part_names(table.dim)):
        left = 1.0 - followed[place]
        if left < LEFT:
            continue
        scale = float(np.median(size[:, place])) / MEDIAN / np.sqrt(left)
        beyond = np.mean(size[:, place] > ONE_IN_1000 * max(scale, 1.0) * np.sqrt(left))
        yield name, count, scale, max(float(beyond) - 0.001, 0.0), float(kept[place])


def _signs_kept(group: Sequence[Rows]) -> Array:
    """The share of successive residuals of one thing that are of one sign (r,), by part; as of noise where hardly
    anything was seen twice running."""
    own = group[0].table.source == "odometry"
    seen = np.concatenate([r.table.keys[:, -1] for r in group])
    thing = np.zeros(len(seen), np.int64) if own else np.where(is_pose(seen), robot_of(seen), seen)
    order = np.lexsort((np.concatenate([r.observers for r in group]), thing))
    sign = np.sign(np.concatenate([r.parts for r in group])[order])
    running = np.diff(thing[order]) == 0
    if np.count_nonzero(running) < FEWEST_PAIRS:
        return np.full(sign.shape[1], 0.5)
    return np.asarray((sign[1:] == sign[:-1])[running].mean(0))
