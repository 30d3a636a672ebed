"""Rows of odometry in which a robot stood still: they say nothing of how it errs under way.

A robot at rest that reports exactly no motion makes no error, whatever noise is stated for the time that passed. Such
rows beside rows under way are two kinds of noise, and no scale is right for both: one for all is too small for a robot
under way, and where anything else can make up for that there, such as a slip that swings what lies ahead, it ends at
none. So deviations and slips are those of rows under way, and hold at rest as well, where they are cautious. A robot
whose rows at rest hold noise, as those of a gyroscope do, is told from one by that: these count as any.
"""

import numpy as np

from teamslam.geometry import BoolArray, Pose
from teamslam.model import Table
from teamslam.model.sensors import pose_of

REST = 1e-3  # of what it moves and of what it turns, in the middle (rms)
FEWEST = 10  # rows under way


def under_way(table: Table) -> BoolArray:
    """Whether a robot moved in each row (m,) by what it measured itself; all rows of what is no odometry, and where too
    few are under way."""
    everywhere = np.ones(len(table), bool)
    if not table.is_odometry:
        return everywhere
    motion: Pose = pose_of(table.values, table.dim)
    both = motion.minus(Pose.identity(motion.dim, motion.batch))
    sizes = np.stack([np.linalg.norm(part, axis=-1) for part in (both[:, : table.dim], both[:, table.dim :])])
    moves = (sizes > REST * np.sqrt(np.mean(sizes**2, -1, keepdims=True))).any(0)
    return moves if moves.sum() >= FEWEST else everywhere
