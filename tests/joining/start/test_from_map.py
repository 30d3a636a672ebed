"""A piece that starts from a map in which its robot is already: it is there, and stays there."""

import numpy as np
import pytest

from teamslam.joining import build_with_solution, from_map, full, join, split
from teamslam.joining.build import problem
from teamslam.joining.build.build import build_choices
from teamslam.joining.start.starts import starts
from teamslam.model import Dataset, Values
from teamslam.sim import Options, simulate
from teamslam.sim.scenario import Robot
from teamslam.sim.sense import Sensor

RANGES = Robot(landmarks=Sensor("range"), robots=None)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
def test_a_piece_starts_where_its_own_map_has_it(space: str) -> None:
    piece = split(simulate(Options(space=space, robots=1, poses=30, landmarks=15), 1))[0]
    submap, solution = build_with_solution(piece)
    start = from_map(piece, [submap])
    assert start is not None
    there = start.seen_from(start.pose(submap.base), submap.all_values.layout)
    step = there.minus(submap.all_values)
    assert np.abs(step).max() < 1e-9
    again, other = build_with_solution(piece, near=start)
    assert other.cost == pytest.approx(solution.cost, rel=1e-9) and other.iterations <= solution.iterations
    assert np.array_equal(again.keys, submap.keys)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
def test_pieces_of_a_team_that_start_from_its_map_join_to_what_they_join_to_anew(space: str) -> None:
    log = simulate(Options(space=space, robots=3, poses=20, landmarks=15), 2)
    whole = full(log)
    submaps = []
    for piece in split(log, poses_per_piece=8):
        start = from_map(piece, whole.maps)
        assert start is not None
        submaps.append(build_with_solution(piece, near=start)[0])
    anew = [build_with_solution(piece)[0] for piece in split(log, poses_per_piece=8)]
    one, other = join(submaps).map, join(anew).map
    assert one.cost == pytest.approx(other.cost, rel=1e-6)
    assert np.abs(one.values.minus(other.values)).max() < 1e-5


def test_a_map_without_a_pose_of_the_piece_starts_nothing() -> None:
    log = simulate(Options(robots=2, poses=20, landmarks=15), 3)
    one, other = split(log)
    assert from_map(one, [build_with_solution(other)[0]]) is None
    half = split(log, poses_per_piece=10)[0]
    assert from_map(one, [build_with_solution(half)[0]]) is None


def test_starts_are_made_once_whatever_turns_out_to_travel_raw(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Dataset] = []

    def counted(piece: Dataset, robot: int) -> list[Values]:
        asked.append(piece)
        return starts(piece, robot)

    monkeypatch.setattr(problem, "starts", counted)
    log = simulate(Options(space="2d", robots=1, poses=14, landmarks=12, team=(RANGES,)), 4)
    (piece,) = split(log)
    build_choices(piece)
    assert len(asked) == 1
