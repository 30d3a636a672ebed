"""Beacons on a level with all that range them are in a live robot's map, as they are in that of the whole log."""

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.joining import join, split
from teamslam.joining.start.blunt import SOURCE
from teamslam.model import Dataset, is_landmark
from teamslam.pipeline import run
from teamslam.robot import Atlas
from teamslam.sim import Options, Robot, Sensor, simulate


def fleet(seed: int) -> Dataset:
    """Two robots of the plane and five beacons hardly above their antennas."""
    beacons, eyes = Sensor(model="range", sigma_m=0.1, range_m=8.0), Sensor(model="relative_pose", every=3)
    team = (Robot(landmarks=beacons, robots=eyes),)
    return simulate(Options(space="planar", robots=2, poses=40, landmarks=5, height_m=0.1, team=team), seed)


def live(log: Dataset) -> Atlas:
    """What robot 1 knows, which closed one piece of its own and heard that of robot 2."""
    both = {
        piece.tables[0].robot: Atlas().with_stretch(0, 0, [piece], int(piece.pose_keys[piece.tables[0].robot][-1]))
        for piece in split(log)
    }
    return both[1].in_short(both[2].submaps, 1)


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_they_are_where_the_whole_log_has_them_and_as_sure(seed: int) -> None:
    log = fleet(seed)
    whole, atlas = run(log, Config(calibrate=False)).joined, live(log)
    mine, without = atlas.joined, join(short.submap for short in atlas.short.values())
    assert mine is not None and len(mine.components) == len(whole.components) == 1
    marks = whole.map.keys[is_landmark(whole.map.keys)]
    assert len(marks) == 5 and np.isin(marks, mine.map.keys).all()
    level = np.setdiff1d(marks, without.map.keys)
    assert len(level)
    for mark in level:
        mine_sigmas, sigmas = (np.sqrt(np.diag(j.covariances[0].of(int(mark)))) for j in (mine, whole))
        apart = np.subtract(*(j.map.values.positions(np.array([mark]), 3)[0] for j in (mine, whole)))
        assert (np.abs(apart) < 0.5 * sigmas).all()
        np.testing.assert_allclose(mine_sigmas, sigmas, rtol=0.1)


def test_what_others_are_sent_stays_as_it_was() -> None:
    """Levels are a robot's own reckoning: by nobody are they counted twice."""
    atlas = live(fleet(0))
    assert atlas.joined is not None
    sent = [*atlas.submaps, *(short.submap for short in atlas.short.values())]
    assert all(table.source != SOURCE for submap in sent for table in submap.raw)
