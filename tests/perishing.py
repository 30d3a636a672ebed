"""Jobs of a join that kill the worker they run on: importable, so that workers can be given them."""

import os
import signal
from pathlib import Path

from teamslam.model import Dataset
from worlds import team


def small_log(seed: int) -> Dataset:
    """A log of two robots."""
    return team("2d", robots=2, poses=8, seed=seed)


def piece_of(robot: int, seed: int) -> Dataset:
    """One robot's piece of it."""
    return small_log(seed).of_robot(robot)


def piece_after_a_death(robot: int, seed: int, marker: Path) -> Dataset:
    """The same, but the first worker that is asked dies."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return piece_of(robot, seed)


def piece_of_death(robot: int, seed: int) -> Dataset:
    """Every worker that is asked dies."""
    os.kill(os.getpid(), signal.SIGKILL)
    return piece_of(robot, seed)
