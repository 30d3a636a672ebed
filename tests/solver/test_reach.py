"""A start is a guess: a search that it leads astray goes on from elsewhere."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

from solver.test_reached import any_problem
from strategies import seeds
from teamslam.errors import SolveError
from teamslam.geometry import Pose
from teamslam.model import Kind, Loss, Table, Values, landmark_key, pose_key, robot_of
from teamslam.solver import Options, Solution, Status, System, firm, optimise, reach, refuse_rounding
from teamslam.solver.kinks import at_kink
from worlds import WORLDS, team


@settings(max_examples=80)
@given(seeds)
def test_it_ends_where_a_search_ends_that_gets_there_and_never_higher(seed: int) -> None:
    system, start = any_problem(seed)
    few = Options(max_iterations=40)
    try:
        once = firm(system, optimise(system, start, few))
    except SolveError:  # no map can be made of where that ended
        return
    try:
        found: Solution | None = reach(system, start, few)
    except SolveError:
        found = None
    assert found is not None
    if once.converged and not once.senseless:
        assert np.array_equal(found.values.state, once.values.state)
    elif once.converged:
        assert found.converged and found.cost <= once.cost
    else:
        assert found.converged or found.cost <= once.cost


@settings(max_examples=80)
@given(seeds)
def test_who_needs_information_refuses_in_true_words(seed: int) -> None:
    """What it raises says "not determined" only of rows that leave a variable open: of their plain derivatives, by
    differences, without sigmas and losses."""
    system, start = any_problem(seed)
    try:
        found = reach(system, start, Options(max_iterations=40))
    except SolveError as problem:
        assert problem.key is not None
        if "not determined" not in str(problem):
            return
        step = 1e-6 * np.eye(system.free.dof)
        ahead, behind = ([system.retract(start, s * d) for d in step] for s in (1.0, -1.0))
        columns = [
            np.concatenate([(t.residual(a) - t.residual(b)).ravel() for t in system.tables]) / 2e-6
            for a, b in zip(ahead, behind, strict=True)
        ]
        assert np.linalg.matrix_rank(np.stack(columns, -1), rtol=1e-7) < system.free.dof
    else:
        firm(system, found)


@pytest.mark.parametrize("world", WORLDS)
def test_a_robot_whose_rows_are_all_forgiven_is_found_again(world: str) -> None:
    """Metres off at sigmas of 0.1 mm, a forgiving loss gives all its sightings the weight of nothing."""
    log = team(world, robots=2, sigma=1e-4, sigma_odometry=1e-4, sees=1.0, every=1)
    tables = [t if t.source == "odometry" else t.with_loss(Loss("geman_mcclure", 1.0)) for t in log.tables]
    assert log.truth is not None
    truth = log.truth.only(log.layout.keys)
    system = System(truth.layout, tables=tables, fixed=log.pose_keys[1][:1])
    best = optimise(system, truth)
    moved = np.zeros(truth.layout.dof)
    dim = log.robots[2]
    for key in truth.layout.keys[robot_of(truth.layout.keys) == 2].tolist():
        moved[truth.layout.unknowns(np.array([key]))[:dim]] = 4.0
    astray = truth.retract(moved)
    lost = optimise(system, astray)
    assert lost.status is Status.STUCK and math.isinf(lost.decrement)
    found = reach(system, astray)
    assert found.converged
    assert found.cost == pytest.approx(best.cost, rel=0.02)  # a row more or less is forgiven
    assert np.abs(found.values.minus(truth)).max() < 0.01


def test_rows_come_to_a_kink_where_what_is_seen_comes_to_stand_on_the_sensor() -> None:
    keys, mark = pose_key(1, np.arange(2)), np.array([landmark_key(0)])
    poses = Pose.from_xytheta(np.array([[0.0, 0.0, 0.3], [1.0, 0.0, -0.4]]))
    links = np.stack([keys, np.repeat(mark, 2)], -1)
    mount = Pose.from_xytheta(np.array([0.2, 0.0, 0.0]))
    table = Table(1, "landmarks", "bearing", 2, links, np.zeros((2, 1)), np.eye(1)[None], np.arange(2), sensor=mount)

    def at(place: np.ndarray) -> Values:
        return Values.of({Kind.POSE2: (keys, poses), Kind.POINT2: (mark, place[None])})

    before = at(np.array([3.0, 4.0]))
    on_the_second = (poses @ mount).translation[1]
    assert at_kink(table, before, at(on_the_second + 1e-9)).tolist() == [False, True]
    assert not at_kink(table, before, at(on_the_second + 1e-2)).any()
    assert not at_kink(table, at(on_the_second + 1e-9), at(on_the_second + 1e-9)).any()


def test_information_that_is_positive_by_rounding_alone_is_refused_and_names_the_variable() -> None:
    """A step of 1e-9 m beside a position known to 10 m: whatever is added last is rounding of the first."""
    keys = pose_key(1, np.arange(3))
    poses = Pose.from_xytheta(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    values = Values.of({Kind.POSE2: (keys, poses)})
    links = np.stack([keys[:-1], keys[1:]], -1)
    steps = np.concatenate([np.tile([1.0, 0.0], (2, 1)), np.tile(np.eye(2).ravel(), (2, 1))], -1)

    def system(sharp: float) -> System:
        stiff = Table(1, "odometry", "relative_pose", 2, links, steps, sharp * np.eye(3)[None], np.arange(2))
        weak = Table(1, "world", "position", 2, keys[:, None], poses.translation, 0.1 * np.eye(2)[None], np.arange(3))
        return System(values.layout, tables=[stiff, weak])

    refuse_rounding(system(1e3), optimise(system(1e3), values))
    tight = system(1e9)
    with pytest.raises(SolveError, match="robot 1"):
        refuse_rounding(tight, optimise(tight, values))
