"""The books of a run balance: what went in is in a map, or is left out by name."""

from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config, JoinOptions
from teamslam.io import read
from teamslam.model import Dataset, Sources
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
