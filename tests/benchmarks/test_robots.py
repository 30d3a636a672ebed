"""Campaigns against teams of robots, small: what they show must hold, whatever the links and the processes do.

The whole ones are in `docs/benchmarks/robots.md`, each with its command.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SKIPPED = 77  # the exit code of what cannot run on this machine; it says why


def campaign(name: str, out: Path, *arguments: object) -> dict[str, Any]:
    """What a campaign wrote."""
    command = [sys.executable, f"benchmarks/{name}.py", "--json", str(out), *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode == SKIPPED:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, Any] = json.loads(out.read_text())
    return found


@pytest.mark.slow  # by the clock: a busy machine may not settle in its time; tests/robot has the law without a clock
def test_over_lossy_and_torn_networks_the_map_is_the_offline_one(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    found = campaign(
        "networks", tmp_path / "rows.json", "--robots", 3, "--poses", 24, "--speed", 4, "--weathers", "loss"
    )
    (row,) = found["rows"]
    assert row["maps_equal"] and row["equal_to_offline"] and row["cuts"] > 0


def test_robots_that_are_killed_lose_nothing(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    found = campaign("kills", tmp_path / "rows.json", "--robots", 2, "--poses", 24, "--speed", 4, "--kills", 3)
    (row,) = found["rows"]
    assert row["maps_equal"] and row["equal_to_offline"] and not row["told_and_gone"]


@pytest.mark.slow
def test_memory_handles_and_threads_stay_flat(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    found = campaign("soak", tmp_path / "rows.json", "--robots", 2, "--minutes", 0.2)
    assert found["flat"] and found["same"] and found["equal_to_offline"]
    assert {row["what"] for row in found["rows"]} == {"memory_mb", "handles", "threads"}


def test_packets_that_make_no_sense_change_nothing(tmp_path: Path) -> None:
    found = campaign("fuzzed", tmp_path / "rows.json", "--packets", 1000)
    calm, flooded = found["rows"]
    assert found["unharmed"] and calm["refused"] == 0
    assert flooded["refused"] == flooded["unsound"] - flooded["shut_out"] > 500


@pytest.mark.slow
def test_what_a_robot_carries_does_not_grow_with_robots_that_it_never_meets(tmp_path: Path) -> None:
    rows = campaign("crowd", tmp_path / "rows.json", "--teams", 4, 9)["rows"]
    all_, grouped = ({r["robots"]: r for r in rows if r["reach"] == reach} for reach in ("all", "groups"))
    assert all(row["settled_s"] is not None for row in rows)
    assert all(grouped[9][what] < 1.5 * grouped[4][what] for what in ("words_kb", "bodies_kb", "holds_kb"))
    assert grouped[9]["calls"] < 1.1 * grouped[4]["calls"]
    assert all_[9]["holds_kb"] > 2.0 * grouped[9]["holds_kb"]
