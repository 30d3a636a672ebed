"""Convergence is reached from anywhere, numbers are finite, and what is said of the end is true."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings

from oracle import scipy_optimum
from strategies import seeds
from teamslam import read, split
from teamslam.errors import SolveError, TeamslamError
from teamslam.geometry import Pose
from teamslam.joining import build_with_solution
from teamslam.model import LOSSES, Dataset, Kind, Loss, Names, Table, Values, landmark_key, pack, pose_key
from teamslam.solver import Covariances, Options, Solution, Status, System, optimise
from thinned import thinned
from worlds import WORLDS, team

CASES = Path(__file__).parents[3] / "shared" / "cases"


def left(system: System, values: Values, curvature: Literal["none", "all"] = "none") -> float:
    """The Newton decrement by dense algebra [sigmas], in the directions that double precision tells from nothing; with
    all curvature where asked, since ranges may hold a landmark at the height of their sensors by that alone."""
    at = system.linearise(values, curvature=curvature)
    curved = at.hessian.to_csr().toarray()
    scale = np.sqrt(np.maximum(np.diag(curved), 1e-12))
    eigenvalues, vectors = np.linalg.eigh(curved / scale / scale[:, None])
    seen = eigenvalues > 1e-11
    along = (vectors.T @ (at.gradient / scale))[seen]
    return float(np.sqrt(np.sum(along**2 / eigenvalues[seen])))


# --- any problem ------------------------------------------------------------------------------------------------------


def any_problem(seed: int) -> tuple[System, Values]:
    """A small team under any model and loss, its sources known up to a million times better than others, outliers
    among them, and a start that may be far off."""
    rng = np.random.default_rng(seed)
    world = str(rng.choice(WORLDS))
    model = str(rng.choice(["point", "range", "range_bearing", "bearing"] if world == "2d" else ["point", "range"]))
    dataset = team(
        world,
        robots=int(rng.integers(1, 3)),
        poses=int(rng.integers(3, 6)),
        landmarks=3,
        model=model,
        robot_model=str(rng.choice(["relative_pose", "range", "point"])),
        sees=0.8,
        every=1,
        sigma=10.0 ** rng.uniform(-3, -0.5),
        seed=int(rng.integers(1000)),
    )
    loss = Loss(str(rng.choice(list(LOSSES))), float(rng.choice([0.5, 1.0, 3.0])))
    tables = []
    for table in dataset.tables:
        values = table.values.copy()
        if table.source != "odometry" and table.model in ("point", "range"):
            wrong = rng.random(len(table)) < 0.2
            values[wrong] += rng.normal(0.0, 2.0, values[wrong].shape)
        sharper = replace(table, values=values, whitening=table.whitening * 10.0 ** rng.uniform(-3, 3))
        tables.append(sharper if table.source == "odometry" else sharper.with_loss(loss))
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    system = System(start.layout, tables=tables, fixed=dataset.pose_keys[1][:1], names=dataset.names)
    return system, system.retract(start, rng.normal(0.0, 10.0 ** rng.uniform(-3, -0.3), system.free.dof))


@settings(max_examples=150)
@given(seeds)
def test_every_solve_ends_with_finite_numbers_and_a_true_status(seed: int) -> None:
    system, start = any_problem(seed)
    try:
        solution = optimise(system, start)
    except SolveError as problem:
        assert "not determined" in str(problem)
        return
    numbers = [solution.cost, solution.chi2, *(s.decrement for s in solution.history)]
    assert np.isfinite(numbers).all() and np.isfinite(solution.values.state).all()
    assert solution.cost <= system.cost(start) * (1.0 + 1e-9)
    assert not math.isnan(solution.decrement)
    if math.isinf(
        solution.decrement
    ):  # nobody can tell how far it is: short of an optimum, at information with no factor
        assert not solution.converged
        with pytest.raises(SolveError, match="not determined"):
            system.factor(solution.values).factorise(solution.hessian.numbers)
    if solution.status is Status.CONVERGED:
        assert left(system, solution.values, "all") <= 1e-2 * max(1.0, 1e-3 * math.sqrt(solution.cost))


@pytest.mark.parametrize(("world", "loss"), thinned(2, list(WORLDS), list(LOSSES)))
def test_the_optimum_is_scipys_from_the_same_start(world: str, loss: str) -> None:
    dataset = team(world, robots=2, poses=4, landmarks=3, sees=0.8, every=1, sigma=0.1, seed=11)
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    tables = [t.with_loss(Loss(loss, 5.0)) for t in dataset.tables]
    system = System(start.layout, tables=tables, fixed=dataset.pose_keys[1][:1])
    solution = optimise(system, start)
    least, where = scipy_optimum(system, start)
    assert solution.converged and solution.cost == pytest.approx(least, rel=1e-8)
    np.testing.assert_allclose(solution.values.minus(where), 0.0, atol=1e-5)


@pytest.mark.parametrize("world", WORLDS)
def test_at_the_limit_of_iterations_the_decrement_is_that_of_the_last_point(world: str) -> None:
    dataset = team(world, robots=2, poses=5, landmarks=4)
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    system = System(start.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1])
    wild = system.retract(start, np.random.default_rng(5).normal(0.0, 0.5, system.free.dof))
    for limit in (1, 2, 4):
        solution = optimise(system, wild, Options(max_iterations=limit))
        assert solution.status is Status.MAX_ITERATIONS
        assert solution.decrement == pytest.approx(left(system, solution.values), rel=1e-6)


# --- saddles ----------------------------------------------------------------------------------------------------------


def between_two(loss: str, apart: float) -> tuple[System, Values]:
    """A landmark seen from one pose at two places, `apart` sigmas from each other: midway, each pulls alike."""
    keys = np.array([[pose_key(1, 0), landmark_key(1)]] * 2)
    sights = np.array([[2.0, -0.05 * apart], [2.0, 0.05 * apart]])
    table = Table(1, "marks", "point", 2, keys, sights, 10.0 * np.eye(2)[None], np.arange(2), loss=Loss(loss, 1.0))
    start = Values.of(
        {
            Kind.POSE2: (np.array([pose_key(1, 0)]), Pose.identity(2, (1,))),
            Kind.POINT2: (np.array([landmark_key(1)]), np.array([[2.3, 0.0]])),
        }
    )
    return System(start.layout, tables=[table], fixed=np.array([pose_key(1, 0)])), start


@pytest.mark.parametrize("loss", ["cauchy", "geman_mcclure"])
@pytest.mark.parametrize("apart", [2.5, 4.0, 8.0, 20.0])
@pytest.mark.parametrize("rule", ["levenberg_marquardt", "gauss_newton", "dogleg"])
def test_a_saddle_between_two_basins_is_left(loss: str, apart: float, rule: str) -> None:
    """Reweighting sees no way to either side, from a start that is as far from both."""
    system, start = between_two(loss, apart)
    midway = system.retract(start, np.array([-0.3, 0.0]))
    solution = optimise(system, start, Options(rule=rule))
    assert solution.converged
    assert solution.cost < system.cost(midway) - 1e-3
    curved = system.linearise(solution.values, curvature="all").hessian.to_csr().toarray()
    assert np.linalg.eigvalsh(curved)[0] > 0.0


def test_where_basins_are_one_their_middle_is_the_optimum() -> None:
    system, start = between_two("cauchy", 1.0)
    solution = optimise(system, start)
    np.testing.assert_allclose(solution.values.positions(np.array([landmark_key(1)]), 2), [[2.0, 0.0]], atol=1e-7)


# --- stiff beside weak ------------------------------------------------------------------------------------------------


def stiff_loop(information: float) -> tuple[System, Values]:
    """A square of four poses that does not close, every other edge stiff."""
    keys = pose_key(1, np.arange(4))
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    steps = np.array([[1.1, 0, 1.57079633], [1, 0.1, 1.57079633], [1, 0, 1.62079633], [1, 0, 1.55079633]])
    stiffness = np.sqrt(np.array([information, 1.0, information, 1.0]))
    table = Table(
        1,
        "odometry",
        "relative_pose",
        2,
        keys[ends],
        pack(Pose.from_xytheta(steps)),
        stiffness[:, None, None] * np.eye(3),
        np.arange(4),
    )
    corners = np.array([[0, 0, 0], [1, 0, 1.57079633], [1, 1, 3.14159265], [0, 1, -1.57079633]])
    start = Values.of({Kind.POSE2: (keys, Pose.from_xytheta(corners))})
    return System(start.layout, tables=[table], fixed=keys[:1]), start


@pytest.mark.parametrize("power", range(0, 13, 2))
def test_stiff_edges_beside_weak_ones(power: int) -> None:
    system, start = stiff_loop(10.0**power)
    solution = optimise(system, start)
    assert solution.converged and solution.iterations < 30
    if power == 12:
        assert solution.cost == pytest.approx(0.00115612, rel=1e-5)
    elif power <= 4:
        assert solution.cost == pytest.approx(scipy_optimum(system, start)[0], rel=1e-6)


# --- numbers that are not finite --------------------------------------------------------------------------------------


def small(**changes: object) -> tuple[System, Values, Dataset]:
    dataset = team("2d", robots=1, poses=4, landmarks=2, sees=1.0)
    assert dataset.truth is not None
    odometry, seen = dataset.tables
    start = dataset.truth.only(dataset.layout.keys)
    tables = [odometry, replace(seen, **changes)]
    return System(start.layout, tables=tables, fixed=dataset.pose_keys[1][:1], names=Names(tick_s=1.0)), start, dataset


def test_a_start_that_is_not_finite_is_named() -> None:
    system, start, dataset = small()
    state = start.state.copy()
    state[start.layout.state_start[start.layout.index(dataset.landmark_keys[1])]] = np.nan
    with pytest.raises(SolveError, match="value of landmark 1 is not finite"):
        optimise(system, Values(start.layout, state))


def test_a_row_beyond_all_numbers_is_named() -> None:
    whitening = np.tile(np.eye(2), (8, 1, 1))
    whitening[5] *= 1e200
    system, start, dataset = small(whitening=whitening)
    robot, landmark = (int(key) for key in dataset.tables[1].keys[5])
    names = Names(tick_s=1.0)
    with pytest.raises(SolveError, match="landmarks, row 5 of the log of robot 1") as said:
        optimise(system, start)
    assert names.describe(robot) in str(said.value) and names.describe(landmark) in str(said.value)


def test_a_step_beyond_all_numbers_is_refused() -> None:
    """A landmark at the end of all numbers: going there overflows, and is no error."""
    system, start, dataset = small()
    key = int(dataset.landmark_keys[1])
    state = start.state.copy()
    state[start.layout.state_start[start.layout.index(key)]] = 1e150
    solution: Solution | None = None
    try:
        solution = optimise(system, Values(start.layout, state))
    except TeamslamError as problem:
        assert "not finite" in str(problem) or "not determined" in str(problem)
    if solution is not None:
        assert math.isfinite(solution.cost) and math.isfinite(solution.decrement)


# --- published logs' pieces ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "case, cost",
    [
        ("slow-robust-piece-2d", 19.7313858),
        ("slow-robust-piece-with-robots", 25.1248761),
        ("straight-drive-nan", None),  # many optima: finite, and one of them
        ("stiff-edges", 0.00115612),
    ],
)
def test_pieces_that_once_failed(case: str, cost: float | None) -> None:
    if not (CASES / case).is_dir():
        pytest.skip(f"case '{case}' is not in {CASES}")
    (piece,) = split(read(CASES / case))
    submap, solution = build_with_solution(piece)
    assert solution.converged and math.isfinite(solution.decrement)
    assert np.isfinite(submap.values.state).all()
    if cost is not None:
        assert solution.cost == pytest.approx(cost, rel=1e-5)


def test_what_curvature_alone_holds_has_no_small_variance() -> None:
    """Ranges too short from sensors at one height: the landmark rests at that height, though nothing measures it."""
    poses, mark = pose_key(1, np.arange(4)), landmark_key(np.arange(1))
    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]])
    way = Pose(np.tile(np.eye(3), (4, 1, 1)), corners)
    short = np.linalg.norm(corners - [1.0, 2.0, 0.0], axis=1)[:, None] - 0.3
    links = np.stack([poses, np.repeat(mark, 4)], -1)
    table = Table(1, "ranges", "range", 3, links, short, np.full((1, 1, 1), 10.0), np.arange(4))
    start = Values.of({Kind.POSE3: (poses, way), Kind.POINT3: (mark, np.array([[1.2, 2.1, 0.001]]))})
    solution = optimise(System(start.layout, tables=[table], fixed=poses), start)
    assert solution.converged
    assert abs(float(solution.values.positions(mark, 3)[0, 2])) < 1e-9
    free = start.layout.select(start.layout.keys == mark[0])
    try:
        (covariance,) = Covariances(free, solution.hessian).all
    except SolveError as problem:
        assert problem.key == mark[0]
    else:
        assert covariance[2, 2] > 1e15 and covariance[0, 0] < 0.01 and covariance[1, 1] < 0.01
