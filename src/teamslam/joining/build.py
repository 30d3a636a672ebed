"""Algorithm 1: a submap from a robot's own measurements, in its own frame, with the information at the optimum.

    start:  dead reckoning, every target where it was first seen
    solve:  minimise f(S) (paper, eq. 2)
    keep :  S^ and I_S = J' W J at S^ (eq. 9), robust weights inside

What a Gaussian over S cannot hold travels beside it as raw measurements, and meets its other half at the join:
sightings that leave part of their target open within this piece (a range or bearing to a robot has no heading), and
robust sightings of robots, since a pose seen once leaves no residual by which a wrong sighting could be known.
"""

from collections.abc import Callable, Iterable

import numpy as np

from teamslam.errors import ModelError, SolveError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.start import WHOLE, dead_reckoning, place_targets
from teamslam.model import Dataset, Layout, Sources, Submap, Table, index_of, is_pose, robot_of
from teamslam.solver import Options, Solution, Step, System, convex_start, optimise
from teamslam.solver.optimise import DEFAULTS


def build(
    piece: Dataset,
    *,
    id: str | None = None,
    version: int = 0,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Submap:
    """The submap of one robot's piece of log.

    Its frame is the piece's first pose. Raises ModelError where the piece is not one robot's or its odometry is broken
    (`teamslam.split` gives pieces that are neither), SolveError where the measurements leave a variable open.
    """
    submap, _ = build_with_solution(piece, id=id, version=version, options=options, progress=progress)
    return submap


def build_with_solution(
    piece: Dataset,
    *,
    id: str | None = None,
    version: int = 0,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> tuple[Submap, Solution]:
    """`build`, and the solver's account of it."""
    robot = _the_robot(piece)
    poses = dead_reckoning(piece, robot)
    inside, raw = gaussian_part(piece.tables, robot, poses.layout.keys)
    start = place_targets(poses, inside, _local_kinds(piece.layout, piece.robots[robot]))
    base = int(poses.layout.keys[0])
    system = System(start.layout, tables=inside, fixed=np.array([base]), names=piece.names)
    solution = optimise(system, convex_start(system, start, options), options, progress)
    if not solution.converged:
        raise SolveError(_not_converged(solution))
    submap = Submap(
        id=id or f"{piece.names.robot(robot)}/{int(index_of(base))}",
        version=version,
        base=base,
        base_dim=piece.robots[robot],
        values=solution.values.select(solution.values.layout.keys != base),
        information=solution.information,
        sources=Sources.of(piece.tables),
        names=piece.names,
        raw=tuple(raw),
        cost=solution.cost,
        chi2=solution.chi2,
        rows=solution.rows,
    )
    return submap, solution


def _local_kinds(layout: Layout, dim: int) -> Layout:
    """The kinds of variables in a robot's own frame: seen from space, a robot on the ground is a pose in space."""
    return Layout.of(layout.keys, layout.kinds | 1 if dim == 3 else layout.kinds)


def _not_converged(solution: Solution) -> str:
    return (
        f"a submap of {len(solution.values)} variables did not converge after {solution.iterations} iterations "
        f"(distance to go {solution.decrement:.2g} sigma). {solution.status.value} Cut the log into shorter pieces, "
        f"or allow more iterations"
    )


def gaussian_part(tables: Iterable[Table], robot: int, poses: IntArray) -> tuple[list[Table], list[Table]]:
    """A piece's tables in two parts: the rows that the submap's Gaussian holds, and those that travel raw.

    `poses` are the robot's own poses of the piece.
    """
    tables = list(tables)
    fixed_marks = _determined(tables)
    inside, raw = [], []
    for table in tables:
        keep = _holds(table, robot, poses, fixed_marks)
        inside += [table.select(keep)] if keep.any() else []
        raw += [table.select(~keep)] if not keep.all() else []
    return inside, raw


def _determined(tables: list[Table]) -> IntArray:
    """The landmarks that some row of these tables fixes whole."""
    whole = [t.keys[:, 1] for t in tables if t.model in ("relative_pose", *WHOLE)]
    return np.unique(np.concatenate(whole)) if whole else np.zeros(0, np.int64)


def _holds(table: Table, robot: int, poses: IntArray, fixed_marks: IntArray) -> BoolArray:
    """Which rows the Gaussian of a robot's submap can hold."""
    if table.row.unary:
        return np.zeros(len(table), bool)  # absolute: written in the world's frame, which no submap knows
    target = table.keys[:, 1]
    other_robot = is_pose(target) & (robot_of(target) != robot)
    whole_robot = table.model == "relative_pose" and table.loss.name == "squared"
    own = np.isin(table.keys, poses).all(1) | np.isin(target, fixed_marks)
    return np.where(other_robot, whole_robot, own)


def _the_robot(piece: Dataset) -> int:
    owners = sorted({table.robot for table in piece.tables})
    if len(owners) != 1:
        raise ModelError(f"a submap is built from one robot's measurements, found those of {len(owners)} robots")
    return owners[0]
