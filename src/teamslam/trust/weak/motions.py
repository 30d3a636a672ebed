"""Rigid motions of a map's variables, to first order, and how long a displacement of all of them is.

A motion (t, w) about a point c moves a variable at p, with rotation R, by

    dp = t + w x (p - c),     dw = R' w          in the chart of each variable

so that, over all variables, displacements are the columns G of all motions times (t, w). Where a robot moves in the
plane, the turns are those that it can follow. Lengths are sums of squares: positions as they are, turns times a lever.
"""

from functools import cached_property

import numpy as np

from teamslam.geometry import Array, BoolArray, Pose, lift_points, lift_tangent, rotations
from teamslam.model import Layout, Values


class Motions:
    """All rigid motions of some variables, and of parts of them.

    `columns` (dof, m): the displacement by a unit of each of t (dim), then w, about the origin. `axes` (k, 1 or 3): of
    the turns. `weight` (dof,): 1 for positions, `lever`^2 for turns: what a turn moves at that distance.
    """

    def __init__(self, values: Values, lever: float) -> None:
        self.values, self.layout, self.lever = values, values.layout, lever
        self.dim = 2 + int((values.layout.kinds % 2).max(initial=0))
        self.frame_dim = dim_of_frame(values)
        self.axes = lift_tangent(self.frame_dim, self.dim)[self.dim :, self.frame_dim :].T
        self.columns = _columns(values, self.dim, self.axes)
        self.weight = np.where(turns(values.layout), lever**2, 1.0)

    @property
    def of_the_whole(self) -> Array:
        """The columns (dof, 3 or 6) that move the whole map as measurements between its variables cannot see."""
        return self.columns[:, np.append(np.arange(self.frame_dim), np.arange(self.dim, self.columns.shape[1]))]

    def hat(self, w: Array) -> Array:
        """The matrix (dim, dim) that makes of places p their velocity w x p in a turn (k,)."""
        return np.asarray(rotations(self.dim).hat(w @ self.axes))

    @cached_property
    def places(self) -> Array:
        """Where every variable is (n, dim)."""
        return self.values.positions(self.layout.keys, self.dim)

    def rows(self, part: BoolArray) -> BoolArray:
        """The unknowns (dof,) of the variables of a part (n,)."""
        return np.asarray(np.repeat(part, self.layout.dofs))

    def moved(self, centre: Array) -> Array:
        """T (m, m) with (t, w) about the origin = T (t, w) about `centre`."""
        d = self.dim
        out = np.eye(d + len(self.axes))
        for k, unit in enumerate(np.eye(len(self.axes))):
            out[:d, d + k] = -self.hat(unit) @ centre
        return out

    def centroid(self, part: BoolArray) -> Array:
        """The middle (dim,) of a part."""
        return np.asarray(self.places[part].mean(0))

    def fit(self, part: BoolArray, centre: Array) -> Array:
        """F (m, dof): the motion about `centre` that is nearest to a displacement of a part, as F times it.

        What the part does not show, such as the turn of a point about itself, is zero.
        """
        own = np.where(self.rows(part), self.weight, 0.0)[:, None] * (self.columns @ self.moved(centre))
        scale = self._scale(part, centre)
        gram = (self.columns @ self.moved(centre)).T @ own / np.outer(scale, scale)
        return np.asarray((np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ (own / scale).T) / scale[:, None])

    def held(self, part: BoolArray, centre: Array) -> Array:
        """The projector (m, m) on the motions about `centre` that a part shows."""
        G = (self.columns @ self.moved(centre))[self.rows(part)]
        return np.asarray(np.linalg.pinv(G, rcond=1e-9) @ G)

    def _scale(self, part: BoolArray, centre: Array) -> Array:
        reach = np.sqrt(np.mean(np.sum((self.places[part] - centre) ** 2, -1))) + self.lever
        return np.concatenate([np.ones(self.dim), np.full(len(self.axes), reach)])


def turns(layout: Layout) -> BoolArray:
    """Which unknowns (dof,) are turns."""
    dims = np.repeat(2 + layout.kinds % 2, layout.dofs)
    within = np.arange(layout.dof) - np.repeat(layout.dof_start[:-1], layout.dofs)
    return np.asarray(within >= dims)


def dim_of_frame(values: Values) -> int:
    """Of the motions that all can follow: the plane's, where a robot moves in it."""
    kinds = values.layout.kinds
    poses = kinds[kinds < 2]
    return 2 + int((poses if len(poses) else kinds).min(initial=1) % 2)


def _columns(values: Values, dim: int, axes: Array) -> Array:
    group = rotations(dim)
    out = []
    for kind, keys, data in values.parts():
        if isinstance(data, Pose):
            whole = np.zeros((len(keys), dim + group.DOF, dim + len(axes)))
            pose = data.lift(dim)
            whole[:, dim:, dim:] = group.adjoint(np.swapaxes(pose.rotation, -1, -2)) @ axes.T
            places, follows = pose.translation, lift_tangent(kind.dim, dim).T
        else:
            whole = np.zeros((len(keys), dim, dim + len(axes)))
            places, follows = lift_points(data, dim), np.eye(dim)[: kind.dim]
        whole[:, :dim, :dim] = np.eye(dim)
        for k, axis in enumerate(axes):
            whole[:, :dim, dim + k] = places @ group.hat(axis).T
        out.append((follows @ whole).reshape(-1, dim + len(axes)))
    return np.concatenate(out)
