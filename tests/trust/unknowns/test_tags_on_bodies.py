"""Tags that are not where a robot's description has them, of another edge, or seen by a lens off its centre."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

import clocks_room
from teamslam.errors import InputError
from teamslam.geometry import Pose, so3
from teamslam.io.bags.team_file import StatedClock, Unsure, UnsureTag, read_team_file, write_team_file
from teamslam.io.bags.unknowns import file_with
from teamslam.model import Dataset, Unknown
from teamslam.solver import Options
from teamslam.trust.unknowns import Found, Settled, sentences_of, settled

KNOWN = StatedClock(offset_sigma_s=0.0, drift_sigma=0.0)
SURE = Unsure(delay_s=0.0)
PRIOR = UnsureTag(xyz_m=0.01, rotation_rad=0.035, edge=0.02)
CERTAIN = UnsureTag()


@pytest.fixture(scope="module")
def stage():
    return clocks_room.filmed(2, 1.0, 1.0, preset="experiment")[2].stage


def log_of(planted, tag=CERTAIN, camera=SURE):
    """A log of the lab with what is planted, where the team file says so of all tags on cubes and of cameras."""
    seen, file, _ = clocks_room.filmed(2, 16.0, 2.5, planted, preset="experiment")
    robots = []
    for robot in seen:
        entry = msgspec.structs.replace(robot.entry.camera[0], sigma=camera)
        tags = [msgspec.structs.replace(one, sigma=tag) for one in robot.entry.tag]
        body = msgspec.structs.replace(robot.entry, camera=[entry], tag=tags, clock=KNOWN, truth_in_time=True)
        robots.append(replace(robot, entry=body, views=(replace(robot.views[0], entry=entry),)))
    return clocks_room.read(robots, msgspec.structs.replace(file, robot=[robot.entry for robot in robots]))


def moved(pose, rng):
    """A pose elsewhere, as a tape measures: a centimetre and two degrees."""
    move, turn = 0.01 * rng.normal(size=3), np.radians(2.0) * rng.normal(size=3)
    return Pose(so3.exp(turn) @ pose.rotation, pose.translation + move), np.append(move, turn)


def test_tags_on_cubes_are_found_where_they_are(stage):
    """Every number is right within its sigma, and most are told far better than they were known."""
    rng = np.random.default_rng(3)
    cubes = {number: pose for cube in stage.cubes for number, pose in cube.items()}
    off = {number: moved(pose, rng) for number, pose in cubes.items()}
    planted = clocks_room.Planted(faces={number: pose for number, (pose, _) in off.items()})
    log = log_of(planted, msgspec.structs.replace(PRIOR, edge=0.0))
    found = settled(log, Options())
    assert found.settled
    order = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
    z = []
    for one in found.found:
        number = int(one.unknown.of.split()[1])
        truth = off[number][1][order.index(one.unknown.name)]
        z.append((one.value - truth) / np.hypot(one.sigma, 4e-4))  # turns about axes do not commute
    told = [one for one in found.found if one.told]
    assert len(told) > 0.5 * len(found.found)
    assert max(np.abs(z)) < 4.5 and np.mean(np.square(z)) < 2.0
    stated = file_with(log.unknowns.recordings.file, log.unknowns.recordings.stated, found.log.unknowns.values)
    assert found.log.unknowns.file == stated


def test_the_edge_of_one_tag_is_found(stage):
    number = max(stage.cubes[1])
    found = settled(log_of(clocks_room.Planted(edges={number: 1.02}), UnsureTag(edge=0.02)), Options())
    assert {one.unknown.name for one in found.found} == {"edge"}
    for one in found.found:
        truth = 1.02 if one.unknown.of == f"tag {number} on robot2" else 1.0
        assert abs(one.value - truth) < 4.0 * one.sigma
    assert any(one.told and one.sigma < 0.005 for one in found.found)


def test_the_centre_of_a_lens_is_found():
    """From a robot on the ground, which sees the horizon always alike, with its place known."""
    log = log_of(clocks_room.Planted(centre=(1.5, -2.0)), camera=Unsure(delay_s=0.0, centre_px=3.0))
    found = {(one.unknown.of, one.unknown.name): one for one in settled(log, Options()).found}
    for robot in ("robot1, front", "robot2, front"):
        for name, truth in (("centre to the right", 1.5), ("centre down", -2.0)):
            one = found[robot, name]
            assert one.told and abs(one.value - truth) < 4.0 * one.sigma and one.sigma < 1.0


@pytest.mark.parametrize(("value", "as_stated"), [(0.0, True), (-6.3e-4, False)])
def test_only_what_is_as_it_was_stated_is_said_to_be(value, as_stated):
    """A number of which the rows tell little still moves, as far as its prior lets it."""
    unknown = Unknown("tag 100 on robot1", "x", "m", 0.0, 0.005, 1e-4, 0.2)
    found = Found(unknown, value, 0.003, False)
    said = sentences_of(Settled(Dataset({1: 2}, ()), (found,), np.eye(1), 1, True))[0]
    assert ("is as stated" in said) == as_stated
    assert ("-0.63 mm +- 3.00 mm, hardly better known than was stated, 0.00 mm +- 5.00 mm" in said) != as_stated


def test_a_team_file_keeps_what_is_known_of_tags(tmp_path):
    _, file, _ = clocks_room.filmed(2, 1.0, 1.0, preset="experiment")
    tags = [msgspec.structs.replace(one, sigma=PRIOR) for one in file.robot[0].tag]
    told = msgspec.structs.replace(file, robot=[msgspec.structs.replace(file.robot[0], tag=tags), *file.robot[1:]])
    write_team_file(told, tmp_path / "team.toml")
    assert read_team_file(tmp_path / "team.toml") == told


@pytest.mark.parametrize(
    ("where", "written", "says"),
    [
        ("[[robot.tag]]\nnumber = 100\nsigma = { xyz_m = -0.01 }", "tag.sigma", "0 or more"),
        ("[[truth]]\nnumber = 1\nsigma = { xyz_m = 0.01 }", "truth", "sigma"),
        (
            "[[robot.camera]]\nname = 'a'\ntags = '/t'\ncalibration = 'c.yaml'\ncentre_px = [nan, 0.0]",
            "robot[0].camera[0].centre_px[0]",
            "found nan",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path, where, written, says):
    path = tmp_path / "team.toml"
    path.write_text(f"[tags]\nsize_m = 0.1\n[[robot]]\nname = 'one'\nrecording = 'one.bag'\n{where}\n")
    with pytest.raises(InputError) as error:
        read_team_file(path)
    assert written in str(error.value) and says in str(error.value)
