"""Poses as they are told while a robot drives: a file that grows by a line at a time.

Columns as in `trajectory.csv`, with the pose in whose frame each is written: `frame` names its robot, `frame_stamp_s`
its time ('world' and nothing in the world's frame).
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.answers.columns import POSE_COLUMNS, POSE_ERRORS, triangle
from teamslam.io.files.growing import Growing
from teamslam.model import Names, index_of, robot_of
from teamslam.model.keys import WORLD
from teamslam.robot import Estimate


class PoseFile:
    """A table of poses that is written while they come, at the end of what is there already; `rows` counts them. A disk
    that is full ends nothing (`trouble`): lines wait."""

    def __init__(self, path: Path, names: Names, dim: int) -> None:
        self.rows, self._names, self._above = 0, names, np.triu_indices(len(POSE_ERRORS[dim]))
        self._file = Growing(path)
        if not path.stat().st_size:
            columns = (*POSE_COLUMNS[dim], *triangle(POSE_ERRORS[dim]))
            self._line(("robot", "stamp_s", "frame", "frame_stamp_s", *columns))

    def __enter__(self) -> "PoseFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def trouble(self) -> str:
        """What is wrong with the disk now, in words."""
        return self._file.trouble

    def add(self, now: Estimate | None) -> None:
        """One line more; none where nothing is known yet. What waits for the disk is tried again."""
        if now is None:
            self._file.add("")
            return
        names = self._names
        frame: tuple[object, object] = ("world", "")
        if now.frame != WORLD:
            frame = (names.robot(int(robot_of(now.frame))), _stamp(names, now.frame))
        numbers = [*now.pose.numbers().tolist(), *now.covariance[self._above].tolist()]
        self._line((names.robot(int(robot_of(now.key))), _stamp(names, now.key), *frame, *numbers))
        self.rows += 1

    def _line(self, cells: Sequence[object]) -> None:
        text = io.StringIO(newline="")
        csv.writer(text).writerow(cells)
        self._file.add(text.getvalue())


def _stamp(names: Names, key: int) -> float:
    return float(index_of(key) * names.tick_s)
