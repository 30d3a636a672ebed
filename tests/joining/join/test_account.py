"""The books of a run balance: what went in is in a map, or is left out by name."""

from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config, JoinOptions
from teamslam.geometry import Pose
from teamslam.io import read
from teamslam.model import Dataset, Sources, Table, landmark_key, pack, pose_key
from teamslam.pipeline import run
from worlds import team

CASES = Path(__file__).parents[4] / "shared" / "cases"
WAYS = [Config(), Config(join=JoinOptions(exact=True)), Config(method="full")]


def balance(log: Dataset, config: Config) -> None:
    joined = run(log, config).joined
    maps = [component.map for component in joined.components]
    keys = [*(m.keys for m in maps), *(lost.keys for lost in joined.left_out)]
    assert np.isin(log.layout.keys, np.concatenate(keys)).all()
    lost = [lost.keys for lost in joined.left_out]
    assert not any(np.isin(m.keys, gone).any() for m in maps for gone in lost)
    rows = Sources().merge(*(m.sources for m in maps))
    waiting = sum(len(table) for m in maps for table in m.raw)
    held = sum(s.stop - s.start for s in rows) - waiting
    assert held + sum(entry.count for entry in joined.left_out) == sum(map(len, log.tables))
    assert all(entry.reason for entry in joined.left_out)


@pytest.mark.parametrize("config", WAYS, ids=["join", "exact", "full"])
@pytest.mark.parametrize("model", ["point", "range_bearing", "bearing", "range"])
def test_what_goes_in_comes_out_or_is_named(model: str, config: Config) -> None:
    balance(team("2d", robots=2, poses=8, model=model, sigma=0.02, sigma_odometry=0.02), config)


@pytest.mark.parametrize("config", WAYS, ids=["join", "exact", "full"])
@pytest.mark.parametrize("case", ["silent-landmark", "slow-robust-piece-with-robots"])
def test_what_stays_open_is_named(case: str, config: Config) -> None:
    if not (CASES / case).is_dir():
        pytest.skip(f"the case '{case}' is not in {CASES}")
    log = read(CASES / case)
    balance(log, config)
    assert run(log, config).joined.left_out


def ahead_of_a_way(seed: int) -> Dataset:
    """Bearings alone from two poses to four landmarks, one of them dead ahead: noise decides whether its rays meet."""
    rng, poses, marks = np.random.default_rng(seed), pose_key(1, np.arange(2)), landmark_key(np.arange(4))
    way = Pose.from_xytheta(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    step = pack(Pose.from_xytheta(np.array([[1.0, 0.0, 0.0]]) + rng.normal(0.0, 0.01, (1, 3))))
    places = np.array([[5.0, 0.0], [3.0, 4.0], [2.0, -3.0], [-2.0, 1.0]])
    x, y = np.concatenate([places - place for place in way.translation]).T
    angles = np.arctan2(y, x) + rng.normal(0.0, 1e-3, 8)
    pairs = np.stack([np.repeat(poses, 4), np.tile(marks, 2)], -1)
    odometry = Table(1, "odometry", "relative_pose", 2, poses[None], step, 100.0 * np.eye(3)[None], np.arange(1))
    bearings = Table(1, "landmarks", "bearing", 2, pairs, angles[:, None], np.full((1, 1, 1), 1e3), np.arange(8))
    return Dataset({1: 2}, (odometry, bearings))


@pytest.mark.parametrize("config", WAYS, ids=["join", "exact", "full"])
@pytest.mark.parametrize("seed", range(10, 25))
def test_a_landmark_that_turns_out_to_be_open_ends_no_run(seed: int, config: Config) -> None:
    """Rays that miss each other draw it onto a sensor or away from all, which shows on the way only."""
    log = ahead_of_a_way(seed)
    balance(log, config)
    assert run(log, config).joined.converged
