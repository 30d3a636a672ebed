"""Beacons on a level with all that range them are in a live robot's map, as they are in that of the whole log."""

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.joining import Joined, split
from teamslam.model import Dataset, is_landmark
from teamslam.pipeline import run
from teamslam.robot import Atlas
from teamslam.sim import Options, Robot, Sensor, simulate


def fleet(seed: int) -> Dataset:
    """Two robots of the plane and five beacons hardly above their antennas."""
    beacons, eyes = Sensor(model="range", sigma_m=0.1, range_m=8.0), Sensor(model="relative_pose", every=3)
    team = (Robot(landmarks=beacons, robots=eyes),)
    return simulate(Options(space="planar", robots=2, poses=40, landmarks=5, height_m=0.1, team=team), seed)


def live(log: Dataset) -> Joined:
    """The map of robot 1, which closed a piece of its own every 20 poses and heard those of robot 2."""
    both = {1: Atlas(), 2: Atlas()}
    for number, piece in enumerate(split(log, poses_per_piece=20)):
        robot = piece.tables[0].robot
        end = int(piece.pose_keys[robot][-1])
        both[robot] = both[robot].with_stretch(number, 0, [piece], end)
    joined = both[1].in_short(both[2].submaps, 1).joined
    assert joined is not None
    return joined


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_they_are_where_the_whole_log_has_them_and_as_sure(seed: int) -> None:
    log = fleet(seed)
    whole, mine = run(log, Config(calibrate=False)).joined, live(log)
    assert len(mine.components) == len(whole.components) == 1
    marks = whole.map.keys[is_landmark(whole.map.keys)]
    assert len(marks) == 5 and np.isin(marks, mine.map.keys).all()
    for mark in marks:
        blocks = [joined.covariances[0].of(int(mark)) for joined in (mine, whole)]
        apart = np.subtract(*(joined.map.values.positions(np.array([mark]), 3)[0] for joined in (mine, whole)))
        assert np.abs(apart / np.sqrt(np.diag(blocks[0]) + np.diag(blocks[1]))).max() < 2.0
        ratio = np.sqrt(np.diag(blocks[0]) / np.diag(blocks[1]))
        assert (ratio > 0.4).all() and (ratio < 3.0).all()


def test_what_others_are_sent_stays_as_it_was() -> None:
    """Levels are a robot's own reckoning: counted once by each, and by nobody twice."""
    log = fleet(0)
    atlas = Atlas()
    for number, piece in enumerate(split(log.with_tables(t for t in log.tables if t.robot == 1), poses_per_piece=20)):
        atlas = atlas.with_stretch(number, 0, [piece], int(piece.pose_keys[1][-1]))
    short = atlas.in_short()
    assert short.joined is not None
    assert all(table.source != "levels" for submap in short.submaps for table in submap.raw)
