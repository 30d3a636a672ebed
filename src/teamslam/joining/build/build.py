"""Algorithm 1: a submap from a robot's own measurements, in its own frame, with the information at the optimum.

    start:  dead reckoning, every target where it was first seen; of a long log, by pieces that are joined
    solve:  minimise f(S) (paper, eq. 2); where the heading may be lost by a turn, from several starts, lowest cost
    keep :  S^ and I_S = J' W J at S^ (eq. 9), robust weights inside

Dead reckoning is a start while the heading is known; a log on which it is not is cut into pieces on which it is,
their submaps are built and joined, and what they show together is the start for the whole. So a submap may be as long
as the log.

What a Gaussian over S cannot hold travels beside it as raw measurements, and meets its other half at the join:
sightings that leave part of their target open (a range or bearing to a robot has no heading), and robust sightings of
robots, since a pose seen once leaves no residual by which a wrong sighting could be known.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import ModelError, SolveError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.build.split import split
from teamslam.joining.join.join import join
from teamslam.joining.start.dead_reckoning import dead_reckoning, own_chain, place_targets
from teamslam.joining.start.odometry import odometry_along, odometry_links
from teamslam.joining.start.triangulate import triangulate
from teamslam.joining.start.wound import wound
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
    submap, solution = next(_optima(piece, id, version, options, progress))
    if not solution.converged:
        raise SolveError(_not_converged(solution))
    return submap, solution


def build_alternatives(piece: Dataset, *, options: Options = DEFAULTS) -> list[Submap]:
    """Every distinct local optimum that is found of a piece, lowest cost first: the first is what `build` gives.

    There is more than one only where dead reckoning loses the heading (see `wound`). Which of them is right may
    show only when the team's submaps meet. All have one id: a join takes one of them. Raises as `build` does.
    """
    found = list(_optima(piece, None, 0, options, None))
    if not found[0][1].converged:
        raise SolveError(_not_converged(found[0][1]))
    return [submap for submap, _ in found]


def build_choices(piece: Dataset, *, options: Options = DEFAULTS) -> list[Submap]:
    """What a team's least squares over all measurements may start from: `build_alternatives`, and after them, where
    dead reckoning loses the heading, the ways that were tried, bent and as they are.

    Alone a robot makes one and the same map of these, but the team's optimum may lie nearer to another. They stand at
    their own places with the best map's information: starts, and no measurements.
    """
    optima = build_alternatives(piece, options=options)
    ways, keys = _ways(piece, _the_robot(piece)), optima[0].values.layout.keys
    if len(ways) < 2:
        return optima
    return optima + [replace(optima[0], values=w.only(keys)) for w in ways if w.layout.contains(keys).all()]


def _optima(
    piece: Dataset, id: str | None, version: int, options: Options, progress: Callable[[Step], None] | None
) -> Iterator[tuple[Submap, Solution]]:
    """The local optima of a piece as submaps, lowest first."""
    robot = _the_robot(piece)
    poses = own_chain(piece, robot)
    base = int(poses[0])
    starts = _starts(piece, robot, options)
    inside, raw = gaussian_part(piece.tables, robot, poses, starts[0].layout)
    held = np.unique(np.concatenate([poses, *(t.keys.ravel() for t in inside)]))
    starts = [s.only(held) for s in starts if s.layout.contains(held).all()]
    system = System(starts[0].layout, tables=inside, fixed=np.array([base]), names=piece.names)
    for rank, start in enumerate(_distinct(system, starts, options)):
        solution = optimise(system, convex_start(system, start, options), options, progress)
        if rank > 0 and not solution.converged:
            continue
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
        yield submap, solution


def _distinct(system: System, starts: Sequence[Values], options: Options) -> list[Values]:
    """The basins that the starts lie in, each by one start near its optimum, lowest cost first."""
    if len(starts) == 1:
        return list(starts)
    rough = replace(options, max_iterations=min(options.max_iterations, 3 * ROUGH), decrement=0.01)
    tried = [optimise(system, convex_start(system, start, rough), rough) for start in starts]
    found: list[Solution] = []
    for solution in sorted(tried, key=lambda s: s.cost):
        if all(_apart(system, solution, other) for other in found):
            found.append(solution)
    return [solution.values for solution in found]


def _apart(system: System, one: Solution, other: Solution) -> bool:
    """Whether two estimates of one system are more than a sigma apart."""
    keys = system.free.keys
    difference = one.values.only(keys).minus(other.values.only(keys))
    return float(difference @ (other.information @ difference)) > 1.0


def _starts(piece: Dataset, robot: int, options: Options) -> list[Values]:
    """Start values of everything that the piece's measurements fix, in the frame of its first pose."""
    if ways := _ways(piece, robot):
        return ways
    parts = split(piece, heading_sigma=HEADING_SIGMA)
    rough = replace(options, max_iterations=min(options.max_iterations, ROUGH), decrement=max(options.decrement, 0.1))
    try:
        return [join((_rough(part, robot, rough) for part in parts), options=rough).map.all_values]
    except SolveError:
        return [_dead_reckoned(piece, robot)]


def _rough(part: Dataset, robot: int, options: Options) -> Submap:
    """A part's submap that only serves as a start: as near to an optimum as it gets, or else the way that its odometry
    tells."""
    try:
        return next(_optima(part, None, 0, options, None))[0]
    except SolveError:
        poses = own_chain(part, robot)
        return build(part.with_tables(_odometry(part, robot, poses)), options=options)


def _odometry(part: Dataset, robot: int, poses: IntArray) -> Iterator[Table]:
    """One relative pose between each two neighbours of the robot's poses, and nothing else."""
    which, row, _ = odometry_links(part, robot, poses)
    for number, table in enumerate(part.tables):
        if (which == number).any():
            yield table.select(np.sort(row[which == number]))


def _dead_reckoned(piece: Dataset, robot: int) -> Values:
    """Everything where dead reckoning puts it."""
    kinds = _local_kinds(piece.layout, piece.robots[robot])
    return triangulate(place_targets(dead_reckoning(piece, robot), piece.tables, kinds), piece.tables)


def _ways(piece: Dataset, robot: int) -> list[Values]:
    """Starts by dead reckoning, as it is and bent; none where the piece is too long for it to be a start."""
    if len(split(piece, heading_sigma=HEADING_SIGMA)) > 1:
        return []
    kinds = _local_kinds(piece.layout, piece.robots[robot])
    way = dead_reckoning(piece, robot)
    variances, _ = odometry_along(piece, robot, way.layout.keys)
    return [triangulate(place_targets(bent, piece.tables, kinds), piece.tables) for bent in wound(way, variances)]


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
