"""A recording that was split is the recording that it was; recordings of several robots stay several."""

import shutil
import tomllib
from itertools import pairwise

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

import recordings
import tagged_room
import teamslam as ts
from teamslam.errors import InputError
from teamslam.io.bags import contents, opened, parts_beside, proposal, read_track, recordings_of
from teamslam.io.bags.team_file import read_team_file


def split(path, folder, name, shares=(0.4,)):
    """The parts of a recording, each as it is written by ROS, in files called by their numbers."""
    folder.mkdir(exist_ok=True)
    with AnyReader([path], default_typestore=recordings.store_of("mcap")) as reader:
        messages = list(reader.messages())
        ends = [0, *(round(share * len(messages)) for share in shares), len(messages)]
        parts = []
        for k, (start, stop) in enumerate(pairwise(ends)):
            part = folder / (f"{name}_{k}.bag" if path.suffix == ".bag" else f"{name}_{k}")
            writer = Writer1(part) if path.suffix == ".bag" else Writer2(
                part, version=9, storage_plugin=StoragePlugin.MCAP
            )  # fmt: skip
            with writer:
                known = {}
                for connection, received, raw in messages[start:stop]:
                    if connection.topic not in known:
                        known[connection.topic] = writer.add_connection(
                            connection.topic, connection.msgtype, typestore=reader.typestore
                        )
                    writer.write(known[connection.topic], received, raw)
            parts.append(part)
    return parts


@pytest.fixture(scope="module", params=["bag", "mcap"])
def team(request, tmp_path_factory):
    room = tagged_room.make(seconds=24.0, rate=1.5)
    return tagged_room.write(room, tmp_path_factory.mktemp("team"), request.param)


def recording_of(team, robot=0):
    return next((team.parent / f"robot{robot}").iterdir())


def test_a_list_of_parts_is_the_recording_that_was_split(team, tmp_path):
    folder = tmp_path / "team"
    shutil.copytree(team.parent, folder)
    whole, text = recording_of(team), team.read_text()
    parts = split(whole, folder, "drive", (0.3, 0.8))
    named = ", ".join(f'"{part.name}"' for part in reversed(parts))
    name = f'"robot0/{whole.name}"'
    assert name in text
    (folder / "team.toml").write_text(text.replace(name, f"[{named}]"))
    one, other = ts.read(team), ts.read(folder / "team.toml")
    assert len(one.tables) == len(other.tables) > 3
    for a, b in zip(one.tables, other.tables, strict=True):
        np.testing.assert_array_equal(a.keys, b.keys)
        np.testing.assert_array_equal(a.values, b.values)


def test_parts_are_told_from_recordings_of_several_robots(team, tmp_path):
    first, other = recording_of(team), recording_of(team, 1)
    parts = split(first, tmp_path / "a", "drive", (0.3, 0.8))
    assert recordings_of([parts[2], other, parts[0], parts[1]]) == [tuple(parts), (other,)]
    found = [contents(group) for group in recordings_of([*parts, other])]
    robots = tomllib.loads(proposal(*found))["robot"]
    assert [len(robot["recording"]) for robot in robots[:1]] == [3] and isinstance(robots[1]["recording"], str)
    assert recordings_of([parts[0], parts[2]]) == [(parts[0],), (parts[2],)]  # the one between is missing


def test_where_one_part_is_damaged_the_others_are_read(team, tmp_path):
    parts = split(recording_of(team), tmp_path, "drive", (0.3, 0.8))
    file = parts[1] if parts[1].is_file() else next(parts[1].glob("*.mcap"))
    data = bytearray(file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 400] = bytes(400)
    file.write_bytes(bytes(data))
    with opened(parts) as recording:
        ticks = read_track(recording, "/odom").ticks
    with opened(recording_of(team)) as recording:
        whole = read_track(recording, "/odom").ticks
    assert ticks[0] == whole[0] and ticks[-1] == whole[-1]
    assert set(ticks.tolist()) <= set(whole.tolist())


def test_two_robots_are_no_parts_of_one(team):
    with (
        opened([recording_of(team), recording_of(team, 1)]) as recording,
        pytest.raises(InputError, match="two of its parts hold /odom at the same time"),
    ):
        read_track(recording, "/odom")


def test_the_parts_beside_a_file_are_found_by_name_and_time(tmp_path):
    def bag(name, start, count=20):
        messages = [recordings.odometry("/odom", (start + k) * 10**8, (0.1 * k, 0, 0)) for k in range(count)]
        folder = tmp_path / "made"
        folder.mkdir()
        recordings.write(folder, "bag", messages).rename(tmp_path / name)
        folder.rmdir()
        return tmp_path / name

    drive = [bag(f"drive_2024-05-01-10-00-0{2 * k}_{k}.bag", 10**10 + 20 * k) for k in range(3)]
    later = bag("drive_2024-05-01-12-00-00_3.bag", 10**10 + 70_000)
    team = [bag(f"robot_{k}.bag", 10**10) for k in range(2)]
    assert parts_beside(drive[1]) == tuple(drive)
    assert parts_beside(later) == (later,)
    assert parts_beside(team[0]) == (team[0],)


def test_a_folder_of_ros_2_without_its_metadata_is_read(tmp_path):
    room = tagged_room.make(seconds=12.0, rate=1.5)
    team = tagged_room.write(room, tmp_path / "team", "mcap")
    whole = recording_of(team)
    folder = tmp_path / "killed"
    folder.mkdir()
    for k, part in enumerate(split(whole, tmp_path / "parts", "drive", (0.5,))):
        shutil.copy(next(part.glob("*.mcap")), folder / f"killed_{k}.mcap")
    with opened(whole) as one, opened(folder) as other:
        np.testing.assert_array_equal(read_track(one, "/odom").ticks, read_track(other, "/odom").ticks)
    assert 'recording = "killed"' in proposal(contents(folder))


@pytest.mark.parametrize(
    ("named", "given", "found"),
    [
        (['"a"'], ["x", "y"], [["x", "y"]]),
        (['["a", "b"]'], ["x"], ["x"]),
        (['"a"', '["b", "c"]'], ["x", "y", "z"], ["x", ["y", "z"]]),
        (['"a"', '"a"'], ["x"], ["x", "x"]),
        (['"a"', '["b", "c"]'], ["x", "y"], None),
    ],
)
def test_recordings_that_are_given_stand_for_parts(named, given, found, tmp_path):
    robots = "".join(f'[[robot]]\nname = "{k}"\nrecording = {name}\n' for k, name in enumerate(named))
    path = tmp_path / "team.toml"
    path.write_text(f"[tags]\nsize_m = 0.1\n{robots}")
    team = read_team_file(path)
    if found is None:
        with pytest.raises(InputError, match="names 3 recordings"):
            team.with_recordings(given, path)
    else:
        assert [robot.recording for robot in team.with_recordings(given, path).robot] == found
