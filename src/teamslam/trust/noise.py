"""How large the residuals of each sensor are beside their standard deviations, and how many are outliers.

Per part of a measurement (range, bearing, x, theta, ...): the median of |e / sigma| over that of a Gaussian whose
variance is what the map left of it, 1 - followed. A median does not see outliers; they are counted apart: the share of
rows beyond what one Gaussian in a thousand is, in the spread that the bulk shows.

Noise changes its sign from one sighting of a thing to the next as often as not; what a wrong map leaves does not, as it
is off by nearly the same for a while. So residuals that keep their sign say nothing of sigmas, however large they are.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from teamslam.geometry import Array
from teamslam.model import is_pose, robot_of
from teamslam.trust.residuals import Rows
from teamslam.trust.tally import kind_of

MEDIAN = 0.6744898  # of |x|, x Gaussian
IN_THE_TAIL = 0.001
ONE_IN_1000 = 3.2905267  # |x| beyond it
FEWEST = 30  # rows to speak of a spread
LEFT = 0.3  # of the variance: where a map follows a part more closely, what is left says little of the sigma
FEWEST_PAIRS = 10  # of one thing seen twice running, to speak of signs
KEPT = 0.65  # of the signs, at most, of what is noise
WORTH_A_WORD = 0.02  # of a sensor's rows
BY_CHANCE = 1e-5  # of a part of a sensor: of a thousand teams with a hundred such parts one is told of outliers


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
    def has_outliers(self) -> bool:
        """Whether there are more outliers than a word is worth, and than chance makes of as many rows.

        Of n rows k are beyond what one in a thousand is with probability exp(-n KL(k/n, 1/1000)) at most (Chernoff).
        """
        share, bulk = self.outliers + IN_THE_TAIL, 1.0 - IN_THE_TAIL - self.outliers
        rare = share * math.log(share / IN_THE_TAIL)
        if bulk > 0.0:
            rare += bulk * math.log(bulk / (1.0 - IN_THE_TAIL))
        return self.outliers > WORTH_A_WORD and self.rows * rare > -math.log(BY_CHANCE)

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
    """Part by part, known by their names: who sees robots on the ground and in the air has rows of both dimensions."""
    names = list(dict.fromkeys(name for r in group for name in _names(r)))
    parts = np.concatenate([_under(names, r, r.parts) for r in group])
    counts = np.count_nonzero(~np.isnan(parts), axis=0).tolist()
    kept = _signs_kept(group, parts)
    shares = np.concatenate([_under(names, r, np.tile(r.followed, (len(r), 1))) for r in group])
    for place, (name, count) in enumerate(zip(names, counts, strict=True)):
        if count < FEWEST:
            continue
        left = 1.0 - float(np.nanmean(shares[:, place]))
        if left < LEFT:
            continue
        measured = ~np.isnan(parts[:, place])
        size = np.abs(parts[measured, place])
        scale = float(np.median(size)) / MEDIAN / np.sqrt(left)
        beyond = np.mean(size > ONE_IN_1000 * max(scale, 1.0) * np.sqrt(left))
        yield name, count, scale, max(float(beyond) - IN_THE_TAIL, 0.0), float(kept[place])


def _names(rows: Rows) -> tuple[str, ...]:
    return rows.table.row.part_names(rows.table.dim)


def _under(names: Sequence[str], rows: Rows, numbers: Array) -> Array:
    """Numbers of each part of some rows (m, r) as columns under `names` (m, n); not a number where they have no such
    part."""
    out = np.full((len(rows), len(names)), np.nan)
    out[:, [names.index(name) for name in _names(rows)]] = numbers
    return out


def _signs_kept(group: Sequence[Rows], parts: Array) -> Array:
    """The share of successive residuals of one thing that are of one sign (n,), of each of the group's `parts` (m, n);
    as of noise where hardly anything was seen twice running."""
    own = group[0].table.source == "odometry"
    seen = np.concatenate([r.table.keys[:, -1] for r in group])
    thing = np.zeros(len(seen), np.int64) if own else np.where(is_pose(seen), robot_of(seen), seen)
    order = np.lexsort((np.concatenate([r.observers for r in group]), thing))
    sign = np.sign(parts[order])
    running = (np.diff(thing[order]) == 0)[:, None] & ~np.isnan(sign[1:]) & ~np.isnan(sign[:-1])
    count = np.count_nonzero(running, axis=0)
    same = np.count_nonzero(running & (sign[1:] == sign[:-1]), axis=0)
    return np.where(count < FEWEST_PAIRS, 0.5, same / np.maximum(count, 1))
