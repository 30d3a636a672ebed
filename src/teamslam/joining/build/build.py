"""Algorithm 1: a submap from a robot's own measurements, in its own frame, with the information at the optimum.

    start:  one or several guesses (see `starts`)
    solve:  minimise f(S) (paper, eq. 2), from every guess a few steps, from the lowest to the end
    keep :  S^ and I_S = J' W J at S^ (eq. 9), robust weights inside

A guess is a guess: it may be rough, and what cannot be solved from it is solved from another. A solve that stops short
of its optimum still gives the submap where what is left is little against one sigma; its solution says how much. Where
a piece has no optimum that is found, its submap is the robot's way alone.

What a Gaussian over S cannot hold travels beside it as raw measurements, and meets its other half at the join (see
`problem`).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining.build.problem import ROUGH, Begun, Problem, apart
from teamslam.model import Dataset, Submap, Values, is_landmark
from teamslam.solver import Options, Solution, Step, System, convex_start, firm, optimise, reach, refuse_rounding
from teamslam.solver.optimise import DEFAULTS

CURE = " Cut the log into shorter pieces, or allow more iterations"
"""What is advised where a piece is not solved; where the log itself is wrong, it does not help."""
LITTLE = 0.1  # [sigmas] from the optimum: the estimate and its information are as good as there


def build(
    piece: Dataset,
    *,
    id: str | None = None,
    version: int = 0,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Submap:
    """The submap of one robot's piece of log.

    Its frame is the pose of the piece that is held most firmly by what was seen (see `eyes`). Raises ModelError where
    the piece is not one robot's or its odometry is broken (`teamslam.split` gives pieces that are neither), SolveError
    where the measurements leave a variable open.
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
    near: Values | None = None,
) -> tuple[Submap, Solution]:
    """`build`, and the solver's account of it; from one start, if an estimate `near` the optimum is known."""
    return next(_usable_optima(piece, Begun.of(piece, near), id, version, options, progress))


def build_alternatives(piece: Dataset, *, options: Options = DEFAULTS) -> list[Submap]:
    """Every distinct local optimum that is found of a piece, lowest cost first: the first is what `build` gives.

    There is more than one only where dead reckoning loses the heading (see `wound`), or where a loss forgives. Which of
    them is right may show only when the team's submaps meet. All have one id: a join takes one of them. Raises as
    `build` does.
    """
    return [submap for submap, _ in _usable_optima(piece, Begun.of(piece), None, 0, options, None)]


def build_choices(piece: Dataset, *, options: Options = DEFAULTS) -> list[Submap]:
    """What a team's least squares over all measurements may start from: every distinct optimum, and after them, where
    dead reckoning loses the heading, the ways that were tried, bent and as they are.

    Alone a robot makes one and the same map of these, but the team's optimum may lie nearer to another. They stand at
    their own places with the best map's information: starts, and no measurements. A start need not be an optimum: where
    none is found, it is as near as was come, or the robot's way alone. Raises ModelError as `build` does, SolveError
    where not even that holds.
    """
    begun = Begun.of(piece)
    optima = [submap for submap, _ in _optima(piece, begun, None, 0, options, None)]
    base, layout = optima[0].base, optima[0].values.layout
    if len(begun.guesses) < 2:
        return optima
    ways = [guess for guess in begun.guesses if guess.layout.contains(optima[0].keys).all()]
    return optima + [replace(optima[0], values=way.seen_from(way.pose(base), layout)) for way in ways]


Optima = Iterator[tuple[Submap, Solution]]


def _usable_optima(
    piece: Dataset,
    begun: Begun,
    id: str | None,
    version: int,
    options: Options,
    progress: Callable[[Step], None] | None,
) -> Optima:
    """As `_optima`; where the lowest is too far from its optimum to stand for it, the robot's way alone."""
    found = _optima(piece, begun, id, version, options, progress)
    first = next(found)
    if not usable(first[1]):
        problem = SolveError(_not_converged(first[1]))
        try:
            found = _descended(Problem.bare(piece, begun), id, version, options, progress)
            first = next(found)
        except SolveError:
            raise problem from None
        if not usable(first[1]):
            raise problem
    yield first
    yield from found


def _optima(
    piece: Dataset,
    begun: Begun,
    id: str | None,
    version: int,
    options: Options,
    progress: Callable[[Step], None] | None,
) -> Optima:
    """The local optima of a piece as submaps, lowest first.

    Where it has none that can be solved for, that of the robot's way alone, and all that was seen from it travels raw:
    what one piece cannot tell the team may. Raises SolveError where there is not even that.
    """
    try:
        yield from _descended(Problem.of(piece, begun), id, version, options, progress)
        return
    except SolveError as error:
        problem = error
    try:
        yield from _descended(Problem.bare(piece, begun), id, version, options, progress)
    except SolveError:
        raise problem from None


def _descended(
    problem: "Problem", id: str | None, version: int, options: Options, progress: Callable[[Step], None] | None
) -> Optima:
    """The local optima of a problem as submaps, lowest first. Raises SolveError where there is none."""
    while True:
        try:
            found = problem.guesses if problem.begun.near else _distinct(problem.system, problem.guesses, options)
            first = reach(problem.system, found[0], options, progress)
            if first.senseless:
                first = min([first, *problem.driven(options, progress)], key=lambda solution: solution.cost)
            refuse_rounding(problem.system, first)
            first = problem.upright(problem.placed(first, options, progress), options, progress)
            undecided = problem.undecided(first, options)
            if not len(undecided):
                break
            problem = problem.without(undecided)
        except SolveError as error:
            # A landmark that turns out to be open costs nobody else anything: its sightings travel raw.
            if error.key is None or not is_landmark(error.key):
                raise
            problem = problem.without(np.array([error.key]))
    yield problem.submap(first, id, version), first
    for start in found[1:]:
        try:
            solution = optimise(problem.system, start, options, progress)
            refuse_rounding(problem.system, solution)
        except SolveError:
            continue
        if solution.converged:
            yield problem.submap(solution, id, version), solution


def _distinct(system: System, guesses: Sequence[Values], options: Options) -> list[Values]:
    """The basins that the guesses lie in, each by one start near its optimum, lowest cost first.

    Raises SolveError where none of them leads anywhere.
    """
    guesses = list(guesses)
    rough = replace(options, max_iterations=min(options.max_iterations, 3 * ROUGH), decrement=0.01)
    if system.rows == system.free.dof:
        guesses = guesses[:1]  # nothing is measured twice: one optimum, which fits all
    if system.convex() is system and len(guesses) == 1:
        return guesses
    tried: list[Solution] = []
    problem: SolveError | None = None
    for guess in guesses:
        try:
            # Where losses forgive, what is far off in a guess may be out of their sight.
            convex = convex_start(system, guess, rough)
            starts = [guess] if convex is guess else [guess, convex]
            tried += [firm(system, optimise(system, start, rough)) for start in starts]
        except SolveError as error:
            problem = error
    if not tried:
        assert problem is not None
        raise problem
    found: list[Solution] = []
    for solution in sorted(tried, key=lambda s: s.cost):
        if all(apart(system, solution, other) for other in found):
            found.append(solution)
    return [solution.values for solution in found]


def usable(solution: Solution) -> bool:
    """Whether an estimate may stand for its optimum: it is one, or little is left to go."""
    return solution.converged or solution.decrement <= LITTLE


def _not_converged(solution: Solution) -> str:
    return (
        f"a submap of {len(solution.values)} variables did not converge after {solution.iterations} iterations "
        f"(distance to go {solution.decrement:.2g} sigma). {solution.status.value}{CURE}"
    )
