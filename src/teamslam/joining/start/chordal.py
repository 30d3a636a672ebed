"""Poses from relative poses alone, in closed form: two linear least squares, first the rotations, then the places.

    min over R_1 .. R_n in R^(d x d)  sum_ij  w_ij |R_j - R_i R_ij|_F^2 ,      R_0 = 1;  then the nearest rotations
    min over t_1 .. t_n               sum_ij  v_ij |t_j - t_i - R_i t_ij|^2 ,  t_0 = 0

What makes a pose graph hard are its headings; without the demand that each R_j be a rotation they are a linear problem.
Without noise it is exact, whatever the loops; with noise as large as logs have it, it ends in the basin of the best
optimum where dead reckoning does not (Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM: a
survey on rotation estimation", ICRA 2015; the relaxation is that of Martinec and Pajdla, CVPR 2007). A graph without
loops is composed as by dead reckoning.
"""

from collections.abc import Iterable

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.joining.start.targets import measured_poses
from teamslam.model import Layout, Table, point_kind
from teamslam.model.sparse import sp
from teamslam.solver import Factor

FAINT = 1e-9  # of the strongest: what every relative pose weighs at least, so that what is linked is also determined


def chordal(tables: Iterable[Table], keys: IntArray, dim: int) -> Pose:
    """The poses (n,) of `keys` (sorted) in the frame of the first, by the relative poses of `tables` between them.

    Those of another dimension count by their shadow on the ground, or as upright. Raises SolveError where no relative
    poses link a pose to the first.
    """
    between = [t.select(np.asarray(np.isin(t.keys, keys).all(1))) for t in tables if t.model == "relative_pose"]
    between = [t for t in between if len(t)]
    if not between or len(keys) == 1:
        return Pose.identity(dim, (len(keys),))
    ends = np.searchsorted(keys, np.concatenate([t.keys for t in between]))
    measured = concatenate([measured_poses(t, dim) for t in between])
    of_turns, of_places = (np.maximum(w, FAINT * w.max()) for w in np.concatenate([_weights(t) for t in between]).T)
    origin = np.eye(dim)
    turns = _relaxed(ends, measured.rotation, np.zeros((len(ends), dim, dim)), of_turns, origin, len(keys))
    rotation = _nearest_rotations(np.swapaxes(turns, -1, -2))
    along = rotation[ends[:, 0]] @ measured.translation[..., None]
    steps = np.broadcast_to(origin, measured.rotation.shape)
    places = _relaxed(ends, steps, along, of_places, np.zeros((dim, 1)), len(keys))
    return Pose(rotation, places[..., 0])


def _weights(table: Table) -> Array:
    """The mean information (m, 2) on the rotation and on the place that each relative pose gives."""
    diagonal = np.sum(np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:])) ** 2, 1)
    return np.stack([diagonal[:, table.dim :].mean(1), diagonal[:, : table.dim].mean(1)], 1)


def _relaxed(ends: IntArray, turns: Array, constants: Array, weights: Array, origin: Array, count: int) -> Array:
    """The matrices y (count, d, k), the first of them `origin`, that minimise sum w |y_j - B' y_i - c|^2.

    `ends` (m, 2) are i and j, `turns` B (m, d, d) rotations, `constants` c (m, d, k), `weights` w (m,).
    """
    d, (i, j) = origin.shape[0], ends.T
    turns, constants = weights[:, None, None] * turns, weights[:, None, None] * constants
    diagonal = np.bincount(ends.ravel(), np.repeat(weights, 2), minlength=count)[1:]
    right = np.zeros((count, *origin.shape))
    np.add.at(right, j, constants)
    np.add.at(right, i, -turns @ constants / weights[:, None, None])
    np.add.at(right, j[i == 0], np.swapaxes(turns[i == 0], -1, -2) @ origin)
    np.add.at(right, i[j == 0], turns[j == 0] @ origin)
    free = (i > 0) & (j > 0)
    row = d * (i[free, None, None] - 1) + np.arange(d)[:, None] + np.zeros((1, d), np.int64)
    column = d * (j[free, None, None] - 1) + np.arange(d) + np.zeros((d, 1), np.int64)
    rows = np.concatenate([np.arange(d * (count - 1)), row.ravel(), column.ravel()])
    columns = np.concatenate([np.arange(d * (count - 1)), column.ravel(), row.ravel()])
    numbers = np.concatenate([np.repeat(diagonal, d), -turns[free].ravel(), -turns[free].ravel()])
    normal = sp.csr_array(sp.coo_array((numbers, (rows, columns)), shape=(d * (count - 1),) * 2))
    layout = Layout.of(np.arange(count - 1), np.full(count - 1, int(point_kind(d))))
    solved = Factor.of(layout, normal).solve(right[1:].reshape(d * (count - 1), -1))
    return np.concatenate([origin[None], solved.reshape(count - 1, *origin.shape)])


def _nearest_rotations(matrices: Array) -> Array:
    u, _, vt = np.linalg.svd(matrices)
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)
