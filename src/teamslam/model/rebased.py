"""A submap in the frame of another of its poses: the same measurements, linearised at the same place.

What a submap says does not change if everything in it moves as one body. So what its information has to say of the base
b, which is not among its unknowns, follows from the others', row by row,

    I_kb = - sum_j I_kj G_j G_b^-1       G_j: how j moves as the whole does, by [t, w]

with turns about where k is, so that what is far away does not drown it in rounding. Then all is written in the new
frame F (dT -> R_F' dT), and the pose that is the frame from now on is no unknown any more. To first order, which is all
that an information knows, nothing is lost; beyond it the two are different Gaussians (see `joining.build.eyes`).
"""

from dataclasses import replace

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray, rotations
from teamslam.model.keys import WORLD, is_parameter, robot_of
from teamslam.model.layout import Kind, Layout
from teamslam.model.sparse import sp
from teamslam.model.submap import Submap
from teamslam.model.values import Values

ROUNDING = 64 * np.finfo(float).eps  # of a sum, beside the sum of its sizes


def rebased(submap: Submap, base: int) -> Submap:
    """The submap seen from another pose of the robot whose pose its base is. Laws: back again it is the same, to
    rounding; its information is that of its measurements linearised in that frame. Raises ModelError for what is no
    such pose.
    """
    if base == submap.base:
        return submap
    if submap.base == WORLD or base not in submap.trajectory_keys(int(robot_of(submap.base))):
        raise ModelError(
            f"submap {submap.id} cannot be seen from {submap.names.describe(base)}: a submap's frame is one of the "
            f"poses of the robot that drove it"
        )
    whole = submap.all_values
    seen = _seen_from(whole, base)
    values = seen.select(seen.layout.keys != base)

    def information() -> sp.csr_array:
        full = _over_all(submap)
        turned = _turns(whole, base)
        at = whole.layout.unknowns(values.layout.keys)
        seen = (turned @ full @ turned.T).tocsr()[at][:, at]
        return sp.csr_array(0.5 * (seen + seen.T))  # to the bit

    return replace(submap, base=base, values=values, information=information)


def _seen_from(values: Values, base: int) -> Values:
    """The values in the frame of one of them; parameters are carried by whatever is the frame."""
    seen = values.seen_from(values.pose(base), values.layout)
    carried = values.layout.keys[is_parameter(values.layout.keys)]
    return seen.update(values.only(carried)) if len(carried) else seen


def _over_all(submap: Submap) -> sp.csr_array:
    """The information over all variables, the base among them, in the present frame."""
    whole, held, dim = submap.all_values.layout, submap.values.layout, submap.base_dim
    information = submap.information
    shifts, turns, places, component = _as_one(submap.values, dim)
    rows = np.repeat(np.arange(held.dof), np.diff(information.indptr))
    columns, numbers = information.indices, information.data
    sizes = np.sqrt(np.abs(information.diagonal()))
    most = sizes[rows] * sizes[columns]  # that a number may be; what it was summed from was rounded as this is

    def summed(each: Array) -> Array:
        found, size = (np.bincount(rows, x, held.dof) for x in (numbers * each, most * np.abs(each)))
        return np.where(np.abs(found) > ROUNDING * size, found, 0.0)

    group = rotations(dim)
    out = np.zeros((held.dof, dim + group.DOF))
    for k in range(dim):
        out[:, k] = -summed(shifts[columns, k])
    for k, axis in enumerate(np.eye(group.DOF)):
        # About where the row's variable is: what its own turn there shifts is taken off every lever.
        lever = places @ group.hat(axis).T
        own = np.where(component[columns] >= 0, lever[rows, component[columns]], 0.0)
        out[:, dim + k] = -summed(turns[columns, k] - own)
        out[:, dim + k] += np.sum(out[:, :dim] * lever, 1)  # and the base, seen from there, back to where it is
    base = whole.unknowns(np.array([submap.base]))
    rest = whole.unknowns(held.keys)
    blocks = sp.csr_array(out)
    gauge = np.concatenate([shifts, turns], 1)
    corner = -(gauge.T @ blocks.toarray())
    into_rest = sp.csr_array((np.ones(held.dof), (rest, np.arange(held.dof))), shape=(whole.dof, held.dof))
    into_base = sp.csr_array((np.ones(len(base)), (base, np.arange(len(base)))), shape=(whole.dof, len(base)))
    cross = into_rest @ blocks @ into_base.T
    own_block = into_base @ sp.csr_array(0.5 * (corner + corner.T)) @ into_base.T
    return sp.csr_array(into_rest @ information @ into_rest.T + cross + cross.T + own_block)


def _as_one(values: Values, dim: int) -> tuple[Array, Array, Array, Array]:
    """How unknowns (n) move as everything moves as one body in `dim` dimensions: by its shifts (n, dim) and by its
    turns about the origin (n, dof); where the variable of each is (n, dim), and which component of that it is, else
    -1."""
    group = rotations(dim)
    layout, n = values.layout, values.layout.dof
    shifts, turns, places = np.zeros((n, dim)), np.zeros((n, group.DOF)), np.zeros((n, dim))
    component = np.full(n, -1)
    for kind, keys, _ in values.parts():
        moves = ~is_parameter(keys)
        at = layout.dof_start[layout.index(keys)]
        where = values.positions(keys, dim)
        for c in range(kind.dof):
            places[at + c] = where
        for c in range(min(kind.dim, dim)):
            rows = (at + c)[moves]
            component[rows], shifts[rows, c] = c, 1.0
            for k, axis in enumerate(np.eye(group.DOF)):
                turns[rows, k] = (where @ group.hat(axis).T)[moves, c]
        if kind.is_pose:
            turned = _turned(values, kind, keys, dim)
            for c in range(kind.dof - kind.dim):
                turns[at + kind.dim + c] = turned[:, c]
    return shifts, turns, places, component


def _turned(values: Values, kind: Kind, keys: IntArray, dim: int) -> Array:
    """How poses turn, each in its own axes, as everything turns about the frame's: (n, their dof, dof of the turns)."""
    if kind.dim == 2:
        return np.ones((len(keys), 1, 1)) if dim == 2 else np.tile(np.array([[[0.0, 0.0, 1.0]]]), (len(keys), 1, 1))
    back = np.swapaxes(values.poses_of(keys, 3).rotation, -1, -2)
    return back if dim == 3 else back[:, :, 2:]


def _turns(values: Values, base: int) -> sp.csr_array:
    """What takes errors in the present frame into those in the frame of a pose: R' of every place."""
    layout: Layout = values.layout
    frame = values.pose(base)
    rows, columns, numbers = [], [], []
    for kind, keys, _ in values.parts():
        back = frame.lift(kind.dim).rotation.T
        at = layout.dof_start[layout.index(keys)]
        carried = is_parameter(keys)
        for i in range(kind.dof):
            for j in range(kind.dof):
                inside = i < kind.dim and j < kind.dim
                number = np.where(carried, float(i == j), back[i, j] if inside else float(i == j))
                rows.append(at + i)
                columns.append(at + j)
                numbers.append(number)
    r, c, x = map(np.concatenate, (rows, columns, numbers))
    return sp.csr_array((x[x != 0], (r[x != 0], c[x != 0])), shape=(layout.dof, layout.dof))
