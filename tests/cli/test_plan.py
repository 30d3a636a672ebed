"""`plan` says what a team will know, and its exit code whether all of it hangs together."""

import json
from pathlib import Path

import pytest

from teamslam.io import write
from teamslam.sim import simulate

MISSION = """
[[robot]]
name = "red"
way = [[0, 0], [8, 0]]
[[robot]]
name = "blue"
way = [[50, 0], [58, 0]]
[[landmark]]
name = "door"
at = [4, 1]
"""


def test_a_mission_that_hangs_together_and_one_that_does_not(teamslam, tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(MISSION, encoding="utf-8")
    called = teamslam("plan", path, "--out", tmp_path / "plan")
    assert called.code == 1
    assert "not tied to" in called.out
    found = json.loads((tmp_path / "plan" / "plan.json").read_text(encoding="utf-8"))
    assert found["robots"]["blue"]["end"] is None
    assert found["robots"]["red"]["end"]["place_m"] > 0.0
    assert found["open"][0] in called.out
    assert (tmp_path / "plan" / "plan.png").stat().st_size > 10_000
    path.write_text(MISSION.replace("[50, 0], [58, 0]", "[0, 2], [8, 2]"), encoding="utf-8")
    assert teamslam("plan", path).code == 0


@pytest.mark.slow
def test_a_preset_and_its_log_are_the_same_plan(teamslam, tmp_path: Path) -> None:
    write(simulate("2d", seed=2), tmp_path / "log", "plain")
    by_log = teamslam("plan", tmp_path / "log")
    by_preset = teamslam("plan", "--preset", "2d", "--seed", 2)
    assert by_log.code == by_preset.code == 0
    assert by_log.out == by_preset.out


def test_what_cannot_be_planned_is_refused(teamslam, tmp_path: Path) -> None:
    assert teamslam("plan").code == 2
    assert teamslam("plan", tmp_path / "none.toml").code == 2
    assert teamslam("plan", "--preset", "nowhere").code == 2
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("x")
    assert teamslam("plan", "--preset", "2d", "--out", tmp_path / "full").code == 2
