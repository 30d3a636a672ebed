"""Cameras that are not where they are said to be, tags of another edge, a lens of another length: found with maps."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

import clocks_room
import teamslam as ts
from teamslam.config import Config
from teamslam.geometry import Pose, so3
from teamslam.io.bags.team_file import StatedClock, Unsure
from teamslam.sim.film.stage import CAMERA
from teamslam.solver import Options
from teamslam.trust.unknowns import settled

OFF = np.array([0.012, -0.010, 0.012]), np.radians([1.2, -1.0, 1.2])  # 2 cm, 2 degrees
KNOWN = StatedClock(offset_sigma_s=0.0, drift_sigma=0.0)
TRUE = Pose(so3.exp(OFF[1]) @ CAMERA.rotation, CAMERA.translation + OFF[0])


UNSURE = Unsure(delay_s=0.0, xyz_m=0.02, rotation_rad=np.radians(2.0))


def log_of(planted, sigma, size_sigma=0.0):
    """A log of the lab with what is planted, where the team file says how uncertain it is."""
    seen, file, _ = clocks_room.filmed(2, 16.0, 2.5, planted, preset="experiment")
    seen = [unsure(robot, sigma) for robot in seen]
    tags = msgspec.structs.replace(file.tags, size_sigma=size_sigma)
    file = msgspec.structs.replace(file, tags=tags, robot=[robot.entry for robot in seen])
    return clocks_room.read(seen, file)


def unsure(robot, sigma):
    camera = msgspec.structs.replace(robot.entry.camera[0], sigma=sigma)
    entry = msgspec.structs.replace(robot.entry, camera=[camera], clock=KNOWN, truth_in_time=True)
    return replace(robot, entry=entry, views=(replace(robot.views[0], entry=camera),))


def test_a_camera_is_found_where_it_is():
    found = settled(log_of(clocks_room.Planted(camera=TRUE), UNSURE), Options())
    assert found.settled
    numbers = {(one.unknown.of, one.unknown.name): one for one in found.found}
    for robot in ("robot1, front", "robot2, front"):
        for axis, turn in zip("xyz", OFF[1], strict=True):
            one = numbers[robot, f"turn about {axis}"]
            assert one.told and abs(one.value - turn) < 4.0 * one.sigma + 4e-4  # turns about axes do not commute


@pytest.mark.parametrize(
    ("what", "planted", "sigma", "size_sigma", "value"),
    [
        ("edge", clocks_room.Planted(size=1.02), Unsure(delay_s=0.0), 0.03, 1.02),
        ("focal length", clocks_room.Planted(focal=1.01), Unsure(delay_s=0.0, focal=0.02), 0.0, 1.01),
    ],
)
def test_what_is_off_by_a_share_is_found_within_its_sigma(what, planted, sigma, size_sigma, value):
    for one in settled(log_of(planted, sigma, size_sigma), Options()).found:
        assert one.unknown.name == what and one.told
        assert abs(one.value - value) < 3.5 * one.sigma and one.sigma < 0.01


@pytest.mark.slow
def test_the_map_is_the_same_once_the_camera_is_estimated():
    def scored(log):
        score = ts.run(log, Config(method="full")).scores[0]
        return np.array([score.robot_position_rmse_m, score.landmark_rmse_m])

    right = scored(log_of(clocks_room.Planted(), Unsure(delay_s=0.0)))
    wrong = scored(log_of(clocks_room.Planted(camera=TRUE), Unsure(delay_s=0.0)))
    found = scored(log_of(clocks_room.Planted(camera=TRUE), UNSURE))
    assert (wrong > 2.0 * right).all()
    assert (found < right + 0.005).all() and (found < 0.5 * wrong).all()
