"""Other starts for a way whose heading may be lost by a turn: dead reckoning, bent evenly.

A loop that landmarks or robots close tells the heading only up to whole turns. Least squares settles in the basin of
the start: dead reckoning that is off by more than half a turn ends with the error wound the wrong way round, a local
minimum. The basins lie along one direction, the sum of the heading errors, so they are reached by bending the way:
the heading turns by a total angle phi, spread along the odometry as its variance is,

    R_t -> R_t Exp(phi v_t a) ,    phi = k 2 pi / 3 ,  |phi| <= 3 sigma ,    v_t the share of step t, a a body axis

Three starts to a basin, each as wide as a turn, and at most MOST bends each way, which is two turns. A way whose
heading is known better than to 0.7 rad has one start.
Carlone & Censi, "From angular manifolds to the integer lattice" (T-RO 2014), count the same minima.
"""

import numpy as np

from teamslam.geometry import Array, Pose, compose_along, rotations
from teamslam.model import Values, pose_kind

SPACING = 2.0 * np.pi / 3.0  # [rad]
REACH = 3.0  # [sigmas]
MOST = 6  # bends each way about an axis; a heading that may be lost by more than two turns is lost


def wound(way: Values, variances: Array) -> list[Values]:
    """Start values of a robot's way: itself first, then bent less to more.

    `way`: poses (n) by dead reckoning, the first one the identity; `variances` (n - 1,) [rad^2] of the heading that
    each step adds (in space the sum over its three axes). Law: the first is `way`, all keep the first pose.
    """
    keys = way.layout.keys
    dim = 2 if way.layout.kinds[0] == pose_kind(2) else 3
    axes = np.eye(rotations(dim).DOF)
    share, total = variances / max(variances.sum(), 1e-300), float(variances.sum()) / len(axes)
    count = min(int(REACH * np.sqrt(total) / SPACING), MOST)
    if not count:
        return [way]
    poses = way.poses_of(keys, dim)
    steps = poses[:-1].between(poses[1:])
    starts = [way]
    for k in range(1, count + 1):
        for turn in [*(k * SPACING * axes), *(-k * SPACING * axes)]:
            bent = steps.rotation @ rotations(dim).exp(share[:, None] * turn)
            starts.append(Values.of({pose_kind(dim): (keys, compose_along(Pose(bent, steps.translation)))}))
    return starts
