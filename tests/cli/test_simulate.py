"""Simulated logs: the same seed gives the same files, options change what they say, wrong ones are refused."""

from pathlib import Path

import pytest

from teamslam.io import read
from teamslam.sim import PRESETS


@pytest.mark.parametrize("preset", list(PRESETS))
def test_every_preset_gives_a_log_with_truth(teamslam, tmp_path: Path, preset: str) -> None:
    """Named in the help, written, and read back."""
    assert f"{preset} " in teamslam("simulate", "--help").out
    called = teamslam("simulate", tmp_path / "log", "--preset", preset, "--poses", 5)
    assert called.code == 0 and "written" in called.out
    log = read(tmp_path / "log")
    assert log.truth is not None and all(len(keys) == 5 for keys in log.pose_keys.values())


def test_the_same_seed_gives_the_same_files_and_another_seed_others(teamslam, tmp_path: Path) -> None:
    """To the byte."""
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert teamslam("simulate", tmp_path / name, "--poses", 5, "--seed", seed).code == 0
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files)
    assert (tmp_path / "a" / "odometry_1.csv").read_bytes() != (tmp_path / "c" / "odometry_1.csv").read_bytes()


def test_sizes_and_dropouts_change_the_log(teamslam, tmp_path: Path) -> None:
    """As many robots as asked for; fewer sightings where some are lost."""
    teamslam("simulate", tmp_path / "all", "--robots", 2, "--poses", 8, "--landmarks", 12)
    teamslam("simulate", tmp_path / "few", "--robots", 2, "--poses", 8, "--landmarks", 12, "--dropouts", 0.5)
    whole, thin = read(tmp_path / "all"), read(tmp_path / "few")
    assert len(whole.robots) == 2
    seen = [sum(len(t) for t in log.tables if t.source == "landmarks") for log in (whole, thin)]
    assert 0 < seen[1] < seen[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "paperr"], ["paperr", "paper"]),
        (["--preset", "paper", "--robots", 9], ["paper", "--robots"]),
        (["--preset", "paper", "--outliers", 0.1], ["outliers"]),
        (["--sigma-odometry", 0.1], ["--sigma-odometry"]),
        (["--path", "square"], ["square", "circles"]),
        (["--robots", 0], ["robots", "0"]),
        (["--dropouts", 2], ["dropouts", "2"]),
        (["--seed", -1], ["seed", "-1"]),
    ],
)
def test_wrong_options_are_refused(teamslam, tmp_path: Path, options: list[object], words: list[str]) -> None:
    """With the name and the cure; nothing is written."""
    called = teamslam("simulate", tmp_path / "log", *options)
    assert called.code == 2 and called.out == "" and not (tmp_path / "log").exists()
    for word in words:
        assert word in called.err
