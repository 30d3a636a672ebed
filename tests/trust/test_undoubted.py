"""Names that lie beyond doubt are put right without being asked for, and nobody else is accused."""

from pathlib import Path

import numpy as np
import pytest

import faults
import tagged_room
import teamslam as ts
from teamslam.joining import join
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.sim import simulate
from teamslam.trust import named_beyond_doubt
from thinned import thinned

PLANTS = [(preset, seed, rows) for preset in ("2d", "planar", "3d") for seed in (11, 12) for rows in (1, 2, None)]


def misread_in(log: Dataset, seed: int, rows: int | None) -> tuple[Dataset, int, int, int]:
    """The log with so many sightings of a landmark called by a number that their robot sees nowhere else (None: all of
    them), and which robot, landmark and number; drawn at random of those that three others know."""
    rng = np.random.default_rng(seed)
    seen = {t.robot: np.unique(t.keys[:, -1], return_counts=True) for t in log.tables if t.source == "landmarks"}
    draws = []
    for robot, (marks, counts) in seen.items():
        known = [m for m, n in zip(marks.tolist(), counts.tolist(), strict=True) if n > (rows or 0)]
        elsewhere = [set(other[0].tolist()) for who, other in seen.items() if who != robot]
        free = [m for m in log.landmark_keys.tolist() if m not in marks and sum(m in at for at in elsewhere) > 1]
        draws += [(robot, mark, other) for mark in known for other in free]
    robot, mark, other = draws[int(rng.integers(len(draws)))]
    return faults.misread(log, robot, mark, other, rows=rows), robot, mark, other


@pytest.mark.parametrize("plant", thinned(5, PLANTS))
def test_a_number_that_was_misread_bends_no_map(plant: tuple[str, int, int | None]) -> None:
    """The map fits, is as near to the truth as without the fault, and the robot that misread is named, and no other."""
    preset, seed, rows = plant
    log = simulate(preset, seed)
    honest = run(log)
    lie, robot, _, other = misread_in(log, seed, rows)
    result = run(lie)
    (cause,) = result.apart
    assert cause.robots == (robot,) and f"landmark {other}" in cause.sentence
    assert result.verdict.level in ("fits", "loose") and not result.verdict.causes
    assert not [*result.suspicions.sentences()]
    found, true = result.scores[0], honest.scores[0]
    assert found.robot_position_rmse_m < 1.3 * true.robot_position_rmse_m
    assert found.nees_per_dof == pytest.approx(true.nees_per_dof, rel=0.25)


@pytest.mark.slow
def test_a_tag_that_was_moved_before_two_robots_is_told_to_be_that(tmp_path: Path) -> None:
    """Each of them saw it at both places about as often, and a loss that forgives lets one believe in the first and the
    other in the second: it is one landmark that was moved, and no name that lies."""
    room = tagged_room.make(2, 24.0, 2.0)
    rotation, place = room.walls[0]
    room.moved[0] = (
        len(room.ticks_ns) // 2,
        (rotation, place + rotation @ [np.sign(rotation[1, 0] * -place[1]), 0, 0]),
    )
    result = run(ts.read(tagged_room.write(room, tmp_path / "team", seed=2)))
    (cause,) = result.apart
    assert cause.kind == "landmark" and "landmark 0 was moved by 1.00 m" in cause.sentence
    assert result.verdict.level in ("fits", "loose") and not [*result.suspicions.sentences()]


@pytest.mark.parametrize("preset", ["2d", "planar", "3d"])
def test_honest_names_are_left_alone(preset: str) -> None:
    """Nobody even looks where submaps agree, and the map is that of the log as it is."""
    for seed in (21, 22, 23):
        log = simulate(preset, seed)
        result = run(log)
        assert not result.apart and result.dataset is log
        assert named_beyond_doubt(log, result.submaps, join(result.submaps)) == ((), None)
