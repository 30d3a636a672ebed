"""The truth as a CSV file, told by its columns: `robot, stamp` and a pose, or `landmark` and a pose or point.

    robot,stamp,x,y,theta          or  x,y,z,qw,qx,qy,qz
    landmark,x,y                   or  x,y,z, or a pose

Stamps are in seconds, or counts of poses. It is what the plain format's files of truth hold, by itself: for scores.
"""

from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import read_csv
from teamslam.io.maps.estimate import MapEstimate
from teamslam.io.plain.columns import POINT, POSE, kind_of, read_poses, ticks_of
from teamslam.model import WORLD, Names, Values, landmark_number, pose_key

TICK_S = 1e-6
NAMED = ("robot", "landmark")


def sniff(path: Path) -> bool:
    """A CSV file with the columns robot and stamp, or landmark, and x and y, that is no part of a log."""
    if path.suffix != ".csv" or not path.is_file() or (path.parent / "team.toml").exists():
        return False
    with path.open("rb") as file:
        head = {
            name.strip().lower() for name in file.readline(1000).replace(b";", b",").replace(b"\t", b",").split(b",")
        }
    return {b"x", b"y"} <= head and ({b"robot", b"stamp"} <= head or b"landmark" in head)


def read(path: Path) -> list[MapEstimate]:
    """Poses of robots or places of landmarks, in a frame that nobody named. InputError names line and field."""
    csv = read_csv(path, words=NAMED)
    if not len(csv):
        raise InputError("the file holds no row", path=path)
    of_robots = csv.has("robot", "stamp")
    kind = kind_of(csv, poses_only=of_robots)
    columns = POSE[kind.dim] if kind.is_pose else POINT[kind.dim]
    csv.refuse_others([*(("robot", "stamp") if of_robots else ("landmark",)), *columns])
    data: Pose | Array = read_poses(csv, kind.dim) if kind.is_pose else csv.numbers(*columns)
    keys, names = _poses(csv) if of_robots else _landmarks(csv)
    _, first = np.unique(keys, return_index=True)
    again = np.setdiff1d(np.arange(len(keys)), first)
    if len(again):
        raise csv.fail(int(again[0]), "this stands in the file already", "stamp" if of_robots else "landmark")
    return [MapEstimate(Values.of({kind: (keys, data)}), None, WORLD, names)]


def _poses(csv: Csv) -> tuple[IntArray, Names]:
    words = csv.words("robot")
    names = Names(dict(enumerate(map(str, words.names), 1)), {}, TICK_S)
    return pose_key(words.codes + 1, ticks_of(csv, "stamp", TICK_S)), names


def _landmarks(csv: Csv) -> tuple[IntArray, Names]:
    words = csv.words("landmark")
    numbers = np.array([landmark_number(str(name)) for name in words.names], np.int64)
    return numbers[words.codes], Names(
        {}, {int(n): str(name) for n, name in zip(numbers, words.names, strict=True)}, TICK_S
    )
