"""Covariances of some of a map's landmarks with each other and with any one of some poses: what an image asks for.

One solve for each unknown of a landmark, C = M^-1 [e_1 e_2 ..]; of each, the rows of these variables are kept.
"""

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Submap
from teamslam.solver import Factor

AT_ONCE = 64  # columns that are solved for together


class Joint:
    """The joint covariance of landmarks `keys`, all of one kind, and any one of `poses` of a map, by `with_pose`."""

    def __init__(self, submap: Submap, keys: IntArray, poses: IntArray) -> None:
        self.base, self.count, layout = submap.base, len(keys), submap.values.layout
        poses = np.unique(poses[poses != submap.base])
        factor = Factor.of(layout, submap.information, submap.names, submap.values)
        unknowns, own = layout.unknowns(keys), [layout.unknowns(poses[n : n + 1]) for n in range(len(poses))]
        rows = np.concatenate([unknowns, *own])
        across = []
        for first in range(0, len(unknowns), AT_ONCE):
            some = unknowns[first : first + AT_ONCE]
            unit = np.zeros((layout.dof, len(some)))
            unit[some, np.arange(len(some))] = 1.0
            across.append(factor.solve(unit)[rows])
        columns = np.concatenate(across, 1)
        self.landmarks = columns[: len(unknowns)]
        ends = np.cumsum([len(unknowns), *map(len, own)])
        self.across = {int(key): columns[a:b] for key, a, b in zip(poses, ends, ends[1:], strict=False)}
        marginals = factor.marginals()
        self.own = {int(key): marginals[int(layout.index(key))] for key in poses}

    def with_pose(self, key: int, dof: int, among: IntArray | None = None) -> Array:
        """The covariance of a pose, then of all landmarks, or of those `among` them (by place), together; a map's base
        does not move."""
        at = np.arange(self.count) if among is None else among
        size = len(self.landmarks) // self.count
        columns = (size * at[:, None] + np.arange(size)).ravel()
        out = np.zeros((dof + len(columns),) * 2)
        out[dof:, dof:] = self.landmarks[np.ix_(columns, columns)]
        if key != self.base:
            out[:dof, :dof] = self.own[key]
            out[:dof, dof:] = self.across[key][:, columns]
            out[dof:, :dof] = out[:dof, dof:].T
        return out
