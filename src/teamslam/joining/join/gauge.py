"""The frame of a joined map: its first base pose, or the world where something was measured in it.

Positions and poses in the world (GPS, survey) fix the gauge themselves. The start is moved there by one rigid fit over
them; with too few of them (one in the plane, fewer than three in space) the map is free to turn, which is refused.
Where one of the maps that are joined is written in the world's frame already, that frame is held, and all go there.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray, align, lift_points
from teamslam.model import WORLD, Submap, Table, Values


def anchor(start: Values, root: Submap, tables: Sequence[Table]) -> tuple[Values, IntArray]:
    """The start values in the frame of the joined map, and the keys that are held fixed there (the gauge).

    Raises SolveError where the measured positions leave the map free to turn.
    """
    if start.layout.contains(WORLD):
        return start.transform(start.pose(WORLD).inverse()), np.array([WORLD])
    absolute = [t for t in tables if t.row.unary]
    if not absolute:
        return start, np.array([root.base])
    dim = root.base_dim
    here = np.concatenate([start.positions(t.keys[:, 0], dim) for t in absolute])
    there = np.concatenate([lift_points(t.values[:, : min(dim, t.dim)], dim) for t in absolute])
    turned = [t for t in absolute if t.model == "pose" and t.dim == dim]
    if turned:
        mine = np.concatenate([start.poses_of(t.keys[:, 0], dim).rotation for t in turned])
        theirs = np.concatenate([t.values[:, dim:].reshape(-1, dim, dim) for t in turned])
        return start.transform(align(here, there, source_rotations=mine, target_rotations=theirs).pose), _none()
    fit = align(here, there)
    if fit.rigidity < 1e-6:
        raise SolveError(
            f"the map's orientation in the world is not determined: {len(here)} measured position(s) leave it free to "
            f"turn; {'two apart' if dim == 2 else 'three not in line'} would hold it, or one measured pose"
        )
    return start.transform(fit.pose), _none()


def _none() -> IntArray:
    return np.zeros(0, np.int64)
