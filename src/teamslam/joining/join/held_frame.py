"""A world of which only part was measured: how deep robots are, how they are tilted, which way they look.

Such rows tell nothing of where a map is, or how it is turned, in some directions; in the others they tell of its poses
beside each other, as any rows do. One row more says where its first pose is in the directions that are free, which is a
choice and no measurement: its residual is zero at the optimum, and nothing else depends on it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, Pose, Registration
from teamslam.joining.join.registration import registered
from teamslam.model import WORLD, Dataset, Submap, Table, Values, pack, robot_of

SOURCE = "frame"  # of the row that says so
SIGMA = 1e-3  # [m, rad]; of no account, as nothing contradicts it


def with_frame(log: Dataset, joined: Submap) -> tuple[Dataset, str]:
    """A log whose rows of the world tell of a map, but not all of where it is there, with the row that holds the rest,
    and its truth moved so, too; and what is said of that. As it is, and no word, where they tell all, or no more than
    would be needed to tell where the map is."""
    absolute = [t for t in _in_the_map(log.tables, joined.all_values) if t.source != SOURCE]
    if joined.base == WORLD or not absolute:
        return log, ""
    dim = joined.base_dim
    found = registered(joined.all_values, absolute, dim)
    numbers, ways = sum(int(t.ranks.sum()) for t in absolute), len(found.information)
    if found.rank == ways or numbers <= found.rank:
        return log, ""
    row = _row(joined.base, found.pose, found.free_at(Pose.identity(dim)))
    said = (
        f"what was measured in the world tells of {found.rank} of the {ways} ways in which a map can shift and turn "
        f"there; in the others it is written as {log.names.describe(joined.base)} has it"
    )
    return replace(log, tables=(*log.tables, row), truth=_moved(log.truth, absolute, row, found)), said


def _in_the_map(tables: Sequence[Table], values: Values) -> list[Table]:
    """The rows of the world that tell of something in a map."""
    unary = [t.select(np.flatnonzero(values.layout.contains(t.keys[:, 0]))) for t in tables if t.row.unary]
    return [t for t in unary if len(t)]


def _row(base: int, there: Pose, free: Array) -> Table:
    dof = free.shape[-1]
    whitening = np.zeros((1, dof, dof))
    whitening[0, : len(free)] = free / SIGMA
    robot, number = int(robot_of(base)), np.zeros(1, np.int64)
    return Table(robot, SOURCE, "pose", there.dim, np.array([[base]]), pack(there)[None], whitening, number)


def _moved(truth: Values | None, absolute: Sequence[Table], row: Table, found: Registration) -> Values | None:
    """The truth where the row says, in what was not measured."""
    if truth is None or not truth.layout.contains(row.keys[0, 0]):
        return truth
    known = _in_the_map(absolute, truth)
    as_true = [replace(t, values=t.predict(truth)) for t in known]
    return truth.transform(registered(truth, [*as_true, row], len(found.middle)).pose)
