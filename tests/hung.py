"""Teams of which one part hangs on the rest by what a test says, with their truth: for tests of what is weak."""

from dataclasses import replace

import numpy as np

from teamslam.geometry import rotations
from teamslam.model import Dataset, Table, is_landmark
from worlds import measure, team


def two_halves(world: str, shared: int, *, seed: int = 0, sigma: float = 0.02, poses: int = 8) -> Dataset:
    """Robots 1 and 2, each with landmarks of its own (odd and even numbers), that see landmarks 0, 1, ... in common, as
    many as `shared`, and never each other. Each sees all of its landmarks from everywhere."""
    log = team(world, robots=2, poses=poses, landmarks=12, sees=1.0, sigma=sigma, sigma_odometry=0.02, seed=seed)
    tables = []
    for table in log.tables:
        mark = table.keys[:, 1]
        mine = (mark < shared) | (mark % 2 == table.robot % 2)
        if table.source != "robots":
            tables.append(table.select(np.flatnonzero(~is_landmark(mark) | mine)))
    assert log.truth is not None
    return replace(log.with_tables(tables), truth=log.truth.only(log.with_tables(tables).layout.keys))


def tied_by_heading(
    log: Dataset, sigma_rad: float, sigma_m: float = 500.0, noise: float = 0.0, seed: int = 0
) -> Dataset:
    """The same with one sighting of robot 2 by robot 1 that says much of its heading and next to nothing of its place;
    `noise`: times the stated one that is in it."""
    assert log.truth is not None
    dim = log.robots[1]
    pair = np.stack([log.pose_keys[1][:1], log.pose_keys[2][:1]], -1)
    sigmas = np.array([sigma_m] * dim + [sigma_rad] * rotations(dim).DOF)
    drawn = max(noise, 1e-9) * sigmas
    seen: Table = measure(1, "robots", "relative_pose", dim, pair, drawn, log.truth, np.random.default_rng(seed))
    return log.with_tables([*log.tables, replace(seen, whitening=np.diag(1.0 / sigmas)[None])])
