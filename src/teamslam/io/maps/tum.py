"""Trajectories in TUM's text format: `stamp x y z qx qy qz qw` a line, [s] and [m], one file for each robot.

Planar poses are written at height 0 with a rotation about z, and read as poses in space.
"""

from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.delimited import read_columns
from teamslam.io.files.text import rows_of_text, write_text
from teamslam.model import Names, Values, is_pose, robot_of

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


def write_trajectories(values: Values, names: Names, folder: str | Path) -> list[Path]:
    """Writes one file for each robot that has poses among the values, `<robot>.tum`; returns the files."""
    keys = np.sort(values.layout.keys[is_pose(values.layout.keys)])
    files = []
    for robot in np.unique(robot_of(keys)).tolist():
        own = keys[robot_of(keys) == robot]
        dim = 2 + int(values.layout.kinds[values.layout.index(own)].max() % 2)
        files.append(Path(folder) / f"{_safe(names.robot(robot))}.tum")
        write_trajectory(files[-1], names.stamps_s(own), values.poses_of(own, dim))
    return files


def _safe(name: str) -> str:
    """A robot's name as the name of a file."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name) or "_"
