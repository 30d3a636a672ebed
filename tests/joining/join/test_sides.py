"""Robots that ranges alone tie to the rest come to lie on the side of it where they fit; what fits on both is told."""

from pathlib import Path

import numpy as np
import pytest

from ranging import write_ranging
from teamslam.config import Config, JoinOptions
from teamslam.joining.join.sides import Mirrored
from teamslam.model import Names
from teamslam.pipeline import run

STEPS, STEP = 50, 0.5


def corridor(folder: Path, seed: int) -> Path:
    """Two robots that meet in a corridor, each straight along it, and range anchors on one wall; red drives along +x,
    blue back."""
    along, still = STEP * np.arange(STEPS), np.zeros(STEPS)
    ways = {
        "red": np.stack([along, still, still], -1),
        "blue": np.stack([25.0 - along, still + 0.3, still + np.pi], -1),
    }
    anchors = {f"a{n}": (2.5 * n, 2.0) for n in range(11)}
    return write_ranging(folder, np.random.default_rng(seed), ways, anchors, sigma_m=0.08, reach_m=6.0)


@pytest.mark.parametrize("config", [Config(), Config(method="full"), Config(join=JoinOptions(exact=True))])
@pytest.mark.parametrize("seed", range(4))
def test_both_robots_come_to_lie_on_one_side_of_the_wall(tmp_path: Path, config: Config, seed: int) -> None:
    """Or it is said of one that it fits on the other side as well; and of all of it, of which nothing but ranges was
    measured, that it fits in a mirror."""
    result = run(corridor(tmp_path / "log", seed), config)
    assert len(result.joined.maps) == 1
    first, last = (result.joined.landmark(name).position for name in ("a0", "a10"))
    along = (last - first) / np.linalg.norm(last - first)
    ways = [result.joined.trajectory(robot).positions - first for robot in ("red", "blue")]
    aside = [along[0] * way[:, 1] - along[1] * way[:, 0] for way in ways]
    open_sides = any("fits on the other side" in remark for remark in result.joined.remarks)
    assert open_sides or np.sign(np.median(aside[0])) == np.sign(np.median(aside[1]))
    assert any("the whole map fits in a mirror too" in remark for remark in result.joined.remarks)


def test_what_a_bearing_tells_is_not_in_doubt(tmp_path: Path) -> None:
    """One robot sees on which side things are: the map is no mirror."""
    folder = corridor(tmp_path / "log", 1)
    rows = [f"red,{k},a{n},{np.arctan2(2.0, 2.5 * n - STEP * k)}" for k in range(0, STEPS, 5) for n in range(11)]
    (folder / "bearings.csv").write_text("robot,stamp,landmark,bearing\n" + "\n".join(rows) + "\n")
    with (folder / "team.toml").open("a") as team:
        team.write('\n[[log]]\nfile = "bearings.csv"\nmodel = "bearing"\nsigma = [0.02]\n')
    result = run(folder)
    assert not any("the whole map" in remark for remark in result.joined.remarks)
    assert result.joined.landmark("a3").position[1] > 1.0


def test_words() -> None:
    """Of a cost that is lower elsewhere no number is told."""
    names = Names(robots={1: "red"})
    assert "robot red fits on the other side of what it ranges too, for 3 more of cost" in Mirrored(1, 3.0).sentence(
        names
    )
    assert "the whole map fits in a mirror too, for no more of cost" in Mirrored(0, -1.0).sentence(names)
