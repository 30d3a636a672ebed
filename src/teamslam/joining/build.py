"""Algorithm 1: a submap from a robot's own measurements, in its own frame, with the information at the optimum.

    start:  dead reckoning, every target where it was first seen; of a long log, by pieces that are joined
    solve:  minimise f(S) (paper, eq. 2)
    keep :  S^ and I_S = J' W J at S^ (eq. 9), robust weights inside

Dead reckoning is a start while the heading is known; a log on which it is not is cut into pieces on which it is,
their submaps are built and joined, and what they show together is the start for the whole. So a submap may be as long
as the log.

What a Gaussian over S cannot hold travels beside it as raw measurements, and meets its other half at the join:
sightings that leave part of their target open (a range or bearing to a robot has no heading), and robust sightings of
robots, since a pose seen once leaves no residual by which a wrong sighting could be known.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from teamslam.errors import ModelError, SolveError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.join import join
from teamslam.joining.split import split
from teamslam.joining.start import dead_reckoning, own_chain, place_targets
from teamslam.joining.triangulate import triangulate
from teamslam.model import Dataset, Layout, Sources, Submap, Table, Values, index_of, is_landmark, is_pose, robot_of
from teamslam.solver import Options, Solution, Step, System, convex_start, optimise
from teamslam.solver.optimise import DEFAULTS

HEADING_SIGMA = 0.2  # [rad]: up to here dead reckoning is a good start; a chord errs by about half its square, 2 %
ROUGH = 20  # iterations of the join that only gives a start


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
    poses = own_chain(piece, robot)
    base = int(poses[0])
    start = _start(piece, robot, options)
    inside, raw = gaussian_part(piece.tables, robot, poses, start.layout)
    start = start.only(np.unique(np.concatenate([poses, *(t.keys.ravel() for t in inside)])))
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


def _start(piece: Dataset, robot: int, options: Options) -> Values:
    """Start values of everything that the piece's measurements fix, in the frame of its first pose."""
    parts = split(piece, heading_sigma=HEADING_SIGMA)
    if len(parts) == 1:
        placed = place_targets(
            dead_reckoning(piece, robot), piece.tables, _local_kinds(piece.layout, piece.robots[robot])
        )
        return triangulate(placed, piece.tables)
    rough = replace(options, max_iterations=min(options.max_iterations, ROUGH), decrement=max(options.decrement, 0.1))
    return join((build(part, options=options) for part in parts), options=rough).map.all_values


def _local_kinds(layout: Layout, dim: int) -> Layout:
    """The kinds of variables in a robot's own frame: seen from space, a robot on the ground is a pose in space."""
    return Layout.of(layout.keys, layout.kinds | 1 if dim == 3 else layout.kinds)


def _not_converged(solution: Solution) -> str:
    return (
        f"a submap of {len(solution.values)} variables did not converge after {solution.iterations} iterations "
        f"(distance to go {solution.decrement:.2g} sigma). {solution.status.value} Cut the log into shorter pieces, "
        f"or allow more iterations"
    )


def gaussian_part(
    tables: Iterable[Table], robot: int, poses: IntArray, known: Layout
) -> tuple[list[Table], list[Table]]:
    """A piece's tables in two parts: the rows that the submap's Gaussian holds, and those that travel raw.

    `poses` are the robot's own poses of the piece, `known` the variables that its measurements fix.
    """
    inside, raw = [], []
    for table in tables:
        keep = _holds(table, robot, poses, known)
        inside += [table.select(keep)] if keep.any() else []
        raw += [table.select(~keep)] if not keep.all() else []
    return inside, raw


def _holds(table: Table, robot: int, poses: IntArray, known: Layout) -> BoolArray:
    """Which rows the Gaussian of a robot's submap can hold."""
    if table.row.unary:
        return np.zeros(len(table), bool)  # absolute: written in the world's frame, which no submap knows
    target = table.keys[:, 1]
    other_robot = is_pose(target) & (robot_of(target) != robot)
    whole_robot = table.model == "relative_pose" and table.loss.name == "squared"
    own = np.isin(table.keys, poses).all(1) | (is_landmark(target) & known.contains(target))
    return np.where(other_robot, whole_robot & known.contains(target), own)


def _the_robot(piece: Dataset) -> int:
    owners = sorted({table.robot for table in piece.tables})
    if len(owners) != 1:
        raise ModelError(f"a submap is built from one robot's measurements, found those of {len(owners)} robots")
    return owners[0]
