"""Systematic errors as variables of a submap: its information says what is known of them, and joining carries it.

Where rows that were put right are linearised, H = J'W'WJ holds the map as if the errors p were known. With them as
variables the information is

    [ H    B ]                               B = J'W'WD,   S = D'W'WD,   units in which the prior is 1
    [ B'  S+1]

whose marginal over the map is H - B (S + 1)^-1 B'. The submap's estimate moves to the optimum over both, by one step of
least squares from wherever it is: p enters linearly.

Joining knows poses and points. So p travels as points that the submap's frame carries, two or three numbers each: seen
from its base they stand at p, wherever the map moves. Their keys are below WORLD: neither pose nor landmark.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.build.problem import gaussian_part
from teamslam.joining.exact.gap import Gap
from teamslam.model import Dataset, Kind, Submap, Table, Values, parameter_keys, point_kind, robot_of
from teamslam.model.sparse import sp
from teamslam.solver import Factor, System
from teamslam.trust.calibration.changed import Change, beyond, differing
from teamslam.trust.calibration.rows import linearised
from teamslam.trust.calibration.systematic import Systematic


def carrying(
    submap: Submap,
    tables: Sequence[Table],
    known: Sequence[Systematic],
    changes: Sequence[Change] = (),
    gap: Gap | None = None,
) -> Submap:
    """The submap of rows that were put right, with the systematic errors of its robots among its variables, and with
    what rows that follow each other say of how they differ.

    `tables` are the rows that its information is of, and `gap` what is known of these there, if anything is. Law: its
    marginal over the old variables is that of least squares over these, how they differ and p together. Itself where
    none of the errors is of its rows, nor any say how they differ.
    """
    if not submap.dof:
        return submap
    # As the information is, at the map that was given: elsewhere the two together may be that of no map.
    given, free = submap.all_values if submap.base >= 0 else submap.values, submap.values.layout
    fixed = given.layout.keys[~free.contains(given.layout.keys)]
    system = System(given.layout, tables=tables, fixed=fixed, names=submap.names) if gap is None else gap.system
    submap, step, factor = sharpened(submap, tables, changes, system, gap)
    touched, mine = _touched(tables, known)
    if not mine:
        return submap
    prior = np.array([known[j].prior for j in mine])
    mean = np.array([known[j].value for j in mine]) / prior
    cross, own, slope = np.zeros((submap.dof, len(mine))), np.eye(len(mine)), -mean
    for k, (table, effects) in enumerate(touched):
        places = [n for n, j in enumerate(mine) if effects[j] is not None]
        if not places:
            continue
        jacobian, error = system.jacobian(k, given), system.whitened(k, given)
        root = np.sqrt(table.loss.weight(np.sum(error**2, -1)))[:, None]
        effect = np.stack([prior[n] * effects[mine[n]] for n in places], -1)
        ahead = (jacobian @ step).reshape(error.shape)
        along = ((root[..., None] * table.whitening) @ effect).reshape(error.size, -1)
        cross[:, places] += jacobian.T @ (np.broadcast_to(root, error.shape).reshape(-1, 1) * along)
        own[np.ix_(places, places)] += along.T @ along
        slope[places] += along.T @ (root * (error - ahead)).ravel()
        differ = differing(table, changes)
        if differ is not None:
            ((error, bare),) = linearised([table], given, fixed, submap.names)
            along = differ @ effect.reshape(error.size, -1)
            cross[:, places] += (differ @ bare).T @ along
            own[np.ix_(places, places)] += along.T @ along
            slope[places] += along.T @ (differ @ (error.ravel() - bare @ step))
    return bordered(submap, factor, cross, own, slope, mean)


def held(submap: Submap, tables: Sequence[Table], known: Sequence[Systematic]) -> tuple[Systematic, ...]:
    """Systematic errors as a submap of rows `tables` has those that it carries; the others as they are known."""
    _, mine = _touched(tables, known)
    kind, out = _points_of(submap), list(known)
    keys = np.sort(parameter_keys(submap.id, -(-len(mine) // kind.dim)))
    if mine and submap.values.layout.contains(keys).all():
        points = submap.values.positions(keys, kind.dim).ravel().tolist()
        for j, value in zip(mine, points, strict=False):
            out[j] = replace(known[j], value=value * known[j].prior)
    return tuple(out)


def _touched(
    tables: Sequence[Table], known: Sequence[Systematic]
) -> tuple[list[tuple[Table, list[Array | None]]], list[int]]:
    """Tables with what each systematic error does to their rows, and which errors are of any."""
    touched = [(table, [error.on(table) for error in known]) for table in tables]
    return touched, [j for j in range(len(known)) if any(effects[j] is not None for _, effects in touched)]


def _points_of(submap: Submap) -> Kind:
    """What systematic errors travel as beside a submap's variables."""
    return point_kind(2 + int((submap.values.layout.kinds % 2).max(initial=0)))


def sharpened(
    submap: Submap, tables: Sequence[Table], changes: Sequence[Change], system: System, gap: Gap | None = None
) -> tuple[Submap, Array, Factor]:
    """The submap of rows that were put right, whose problem is `system`, by what those that follow each other say of
    how they differ as well: its information, and its estimate one step (dof,) of least squares over both further; with
    the step, and the factor of the information."""
    values = submap.all_values if submap.base >= 0 else submap.values
    held = values.layout.keys[~submap.values.layout.contains(values.layout.keys)]
    told = beyond(tables, changes, values, held, submap.names)
    information = submap.information
    if gap is not None and told is None:
        return replace(submap, values=submap.values.retract(gap.step)), gap.step, gap.factor
    slope = system.linearise(values, lazy=True).gradient
    if told is not None:
        more, further, _ = told
        information, slope = sp.csr_array(information + more), slope + further
    factor = Factor.of(submap.values.layout, information, submap.names, submap.values)
    step = factor.solve(slope)
    return replace(submap, values=submap.values.retract(step), information=information), step, factor


def rows_inside(submap: Submap, piece: Dataset) -> list[Table]:
    """The rows of a piece that the information of its submap is of: those that do not travel raw."""
    robot = int(robot_of(submap.base))
    inside, _ = gaussian_part(piece.tables, robot, submap.trajectory_keys(robot), submap.all_values.layout)
    return inside


def bordered(submap: Submap, factor: Factor, cross: Array, own: Array, slope: Array, values: Array) -> Submap:
    """The submap with p beside its variables, and beside errors that it holds already, at the optimum over all;
    `factor` is of its information."""
    kind = _points_of(submap)
    dim = kind.dim
    count = -(-len(values) // dim)
    spare = count * dim - len(values)
    cross = np.pad(cross, ((0, 0), (0, spare)))
    own = np.block([[own, np.zeros((len(own), spare))], [np.zeros((spare, len(own))), np.eye(spare)]])
    slope, values = np.pad(slope, (0, spare)), np.pad(values, (0, spare))
    half = factor.half(cross)
    shift = np.linalg.solve(own - half.T @ half, slope)
    moved = submap.values.retract(-factor.draws(half @ shift))
    keys = np.sort(parameter_keys(submap.id, count, beside=submap.values.layout.keys))
    both = moved.update(Values.of({kind: (keys, (values + shift).reshape(count, dim))}))
    return replace(submap, values=both, information=_beside(submap.information, cross, own, both.layout.unknowns(keys)))


def _beside(information: sp.csr_array, cross: Array, own: Array, places: IntArray) -> sp.csr_array:
    """The symmetric information of a submap with that of p, at some places (k,) among all unknowns, rising."""
    below = sp.hstack([sp.csc_array(cross), information.T], "csc").tocsr()
    whole = sp.csr_array(sp.vstack([sp.csr_array(np.concatenate([own, cross]).T), below], "csr"))
    if not len(places) or places[-1] < len(places):
        return whole
    at = np.setdiff1d(np.arange(whole.shape[0]), places, assume_unique=True)
    back = np.argsort(np.concatenate([places, at]))
    return sp.csr_array(whole[back][:, back])
