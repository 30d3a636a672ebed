"""Trajectories in TUM's text format: `stamp x y z qx qy qz qw` a line, [s] and [m], one file for each robot.

Planar poses are written at height 0 with a rotation about z, and read as poses in space.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose, concatenate
from teamslam.io.files.delimited import read_columns
from teamslam.io.files.text import rows_of_text, write_text
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.model import WORLD, Dropped, Kind, Names, Values, is_pose, pose_key, robot_of
from teamslam.model.keys import MAX_INDEX

TICK_S = 1e-6
FIELDS = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")


def write_trajectory(path: str | Path, stamps_s: Array, poses: Pose) -> None:
    """Writes stamps (n,) and Poses (n,), planar ones lifted. Law: read_trajectory gives the same."""
    lifted = poses.lift(3)
    w, x, y, z = np.moveaxis(lifted.quaternion_wxyz(), -1, 0)
    rows = np.column_stack([stamps_s, lifted.translation, x, y, z, w])
    write_text(Path(path), "\n".join([*rows_of_text(rows), ""]))


def read_trajectory(path: str | Path) -> tuple[Array, Pose]:
    """Stamps (n,) [s], rising, and Poses (n,) in space. InputError names the line and field at fault."""
    path = Path(path)
    columns = read_columns(path, FIELDS)
    if not len(columns.values):
        raise InputError("the file holds no pose", path=path)
    stamps, quaternions = columns.values[:, 0], columns.values[:, 4:]
    back = np.flatnonzero(np.diff(stamps) <= 0.0)
    if len(back):
        line = int(columns.lines[back[0] + 1])
        raise InputError("time steps back or stands still; stamps should rise", path=path, line=line, field="stamp")
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(quaternions, axis=-1)
    wrong = np.flatnonzero(~((lengths > 0.9) & (lengths < 1.1)))
    if len(wrong):
        raise InputError(
            f"a quaternion has length 1, found {lengths[wrong[0]]:.3g} (qx qy qz qw)",
            path=path,
            line=int(columns.lines[wrong[0]]),
        )
    return stamps, Pose.from_quaternion(columns.values[:, 1:4], quaternions[:, [3, 0, 1, 2]])


def sniff(path: Path) -> bool:
    """A file *.tum, or a folder of them."""
    return any(path.glob("*.tum")) if path.is_dir() else path.suffix == ".tum"


def read(path: Path) -> list[MapEstimate]:
    """The trajectories in a file, or in all files *.tum of a folder, as one map in a frame that nobody named. A robot
    is called as its file is; stamps are taken to the microsecond."""
    files = sorted(path.glob("*.tum")) if path.is_dir() else [path]
    if not files:
        raise InputError("there is no file *.tum in this folder", path=path)
    keys, poses = [], []
    for robot, file in enumerate(files, 1):
        stamps, way = read_trajectory(file)
        ticks = np.rint(stamps / TICK_S).astype(np.int64)
        if ticks[0] < 0 or ticks[-1] > MAX_INDEX or (np.diff(ticks) == 0).any():
            raise InputError(
                f"stamps are from 0 to {MAX_INDEX * TICK_S:.0f} s, a microsecond apart or more",
                path=file,
                field="stamp",
            )
        keys.append(pose_key(robot, ticks))
        poses.append(way)
    values = Values.of({Kind.POSE3: (np.concatenate(keys), concatenate(poses))})
    return [MapEstimate(values, None, WORLD, Names({n: file.stem for n, file in enumerate(files, 1)}, {}, TICK_S))]


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes one file for each robot of each map: the path itself for a single one, else `<path>_<robot>.tum`; of a
    path without an ending, a folder of them."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        if not path.suffix:
            write_trajectories(found.values, found.names, file)
        elif len(found.robots) == 1:
            _write_robot(found.values, found.names, found.robots[0], file)
        else:
            for robot, name in file_names(found.robots, found.names).items():
                _write_robot(found.values, found.names, robot, file.with_stem(f"{file.stem}_{name}"))
    poses = sum(int(is_pose(found.values.layout.keys).sum()) for found in maps)
    rest = sum(len(found.values) for found in maps) - poses
    counts = [
        (poses, "covariances of poses: TUM has no place for them"),
        (rest, "landmarks: TUM has no place for them"),
    ]
    return tuple(Dropped(count, reason) for count, reason in counts if count)


def write_trajectories(values: Values, names: Names, folder: str | Path) -> list[Path]:
    """Writes one file for each robot that has poses among the values, `<robot>.tum`; returns the files."""
    keys = values.layout.keys
    robots = np.unique(robot_of(keys[is_pose(keys)])).tolist()
    files = []
    for robot, name in file_names(robots, names).items():
        files.append(Path(folder) / f"{name}.tum")
        _write_robot(values, names, robot, files[-1])
    return files


def _write_robot(values: Values, names: Names, robot: int, path: Path) -> None:
    keys = values.layout.keys
    own = np.sort(keys[is_pose(keys) & (robot_of(keys) == robot)])
    dim = 2 + int(values.layout.kinds[values.layout.index(own)].max() % 2)
    write_trajectory(path, names.stamps_s(own), values.poses_of(own, dim))


def file_names(robots: Iterable[int], names: Names) -> dict[int, str]:
    """Robots' names as names of files, each its own."""
    found: dict[int, str] = {}
    for robot in robots:
        plain = _safe(names.robot(robot))
        taken = {name.lower() for name in found.values()}
        found[robot] = plain if plain.lower() not in taken else f"{plain}_{robot}"
    return found


def _safe(name: str) -> str:
    """A robot's name as the name of a file."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name) or "_"
