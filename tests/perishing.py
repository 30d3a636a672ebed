"""Jobs of a join that kill the worker they run on: importable, so that workers can be given them."""

import os
import signal
import time
from functools import partial
from pathlib import Path

from teamslam.model import Dataset
from teamslam.scale import Processes, TreeMap, join_in_tree
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


def piece_that_ends_the_run(robot: int, seed: int, marker: Path) -> Dataset:
    """The same, but at first the run that asks for it is killed; the worker's process id is left in `marker`."""
    if not marker.exists():
        marker.write_text(str(os.getpid()))
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)
    return piece_of(robot, seed)


def join_with_an_end(folder: Path, marker: Path) -> TreeMap:
    """Two leaves, one after another; the second one's job is `piece_that_ends_the_run`."""
    jobs = [partial(piece_of, 1, 3), partial(piece_that_ends_the_run, 2, 3, marker)]
    return join_in_tree(jobs, folder, workers=Processes(1))
