"""What is not to be believed is said, and left out or put right where that was asked for."""

import json
from pathlib import Path

import numpy as np
import pytest

import faults
from teamslam.io import write
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import exchanged, stretched
from thinned import thinned

OPTIONS = Options(space="planar", robots=4, landmarks=20)


def report(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text())


def test_an_honest_team_has_nothing_to_say(teamslam, tmp_path: Path) -> None:
    write(simulate(OPTIONS, 1), tmp_path / "log", "plain")
    called = teamslam("run", tmp_path / "log", "--out", tmp_path / "map", "--no-figures")
    assert called.code == 0 and "suspicious" not in called.out and "wrong" not in called.out
    found = report(tmp_path / "map")
    assert found["rejected"] is None and found["suspicions"]["sentences"] == []


@pytest.mark.parametrize("method", thinned(3, [(), ("--exact",), ("--method", "full")]), ids=str)
def test_exchanged_names_are_put_right(teamslam, tmp_path: Path, method: tuple[str, ...]) -> None:
    """The map is that of the log with the right names, whatever made it."""
    log = simulate(OPTIONS, 1)
    marks = [np.unique(t.keys[:, 1]) for t in log.tables if t.source == "landmarks"]
    one, other = (int(k) for k in np.intersect1d(marks[1], np.concatenate([marks[0], marks[2]]))[:2])
    write(log, tmp_path / "right", "plain")
    write(exchanged(log, 2, one, other), tmp_path / "wrong", "plain")
    told = teamslam("run", tmp_path / "wrong", "--out", tmp_path / "told", "--no-figures")
    assert "suspicious" in told.out and "--repair puts it right" in told.out
    assert f"landmark {one}" in told.out and not report(tmp_path / "told")["suspicions"]["mended"]
    called = teamslam("run", tmp_path / "wrong", "--out", tmp_path / "mended", "--repair", "--no-figures", *method)
    assert called.code == 0 and "put right" in called.out
    teamslam("run", tmp_path / "right", "--out", tmp_path / "map", "--no-figures", *method)
    mended, right = report(tmp_path / "mended"), report(tmp_path / "map")
    assert mended["suspicions"]["labels"][0]["kind"] == "exchanged"
    assert mended["landmark_rmse_m"] == pytest.approx(right["landmark_rmse_m"], rel=1e-4)
    assert mended["cost"] == pytest.approx(right["cost"], rel=1e-6)


def test_a_number_misread_once_is_put_right_without_being_asked(teamslam, tmp_path: Path) -> None:
    """It is said who misread what, on the terminal and in the report, and nobody is suspected."""
    log = simulate(OPTIONS, 1)
    seen = {t.robot: t.keys[:, 1].tolist() for t in log.tables if t.source == "landmarks"}
    others = [m for m in log.landmark_keys.tolist() if m not in seen[2] and sum(m in of for of in seen.values()) > 1]
    mark = max(set(seen[2]), key=seen[2].count)
    write(faults.misread(log, 2, mark, others[0], rows=1), tmp_path / "wrong", "plain")
    called = teamslam("run", tmp_path / "wrong", "--out", tmp_path / "map", "--no-figures")
    assert called.code == 0 and "suspicious" not in called.out
    assert f"robot 2 sees landmark {others[0]} " in called.out
    assert "what it sees is a landmark of its own" in called.out
    found = report(tmp_path / "map")
    assert [(each["kind"], each["robots"]) for each in found["apart"]] == [("place", ["2"])]
    assert found["fit"]["verdict"] in ("fits", "loose") and found["suspicions"]["sentences"] == []


def test_a_liar_is_named_and_left_out(teamslam, tmp_path: Path) -> None:
    write(stretched(simulate(OPTIONS, 1), 3, 1.1), tmp_path / "log", "plain")
    told = teamslam("run", tmp_path / "log", "--out", tmp_path / "told", "--no-figures")
    assert "robot 3 contradicts the others" in told.out and report(tmp_path / "told")["suspicions"]["robots"] == ["3"]
    without = teamslam("run", tmp_path / "log", "--out", tmp_path / "mended", "--repair", "--no-figures")
    assert "robot 3 was left out by --repair" in without.out and "measured nothing" not in without.out
    mended = report(tmp_path / "mended")
    assert [part["robots"] for part in mended["parts"]] == [["1", "2", "4"]]
    assert mended["robot_position_rmse_m"] < report(tmp_path / "told")["robot_position_rmse_m"]


def test_wrong_sightings_are_left_out_and_listed(teamslam, tmp_path: Path) -> None:
    kind = Robot(landmarks=Sensor(outliers=0.2), robots=Sensor("relative_pose", every=5, outliers=0.2))
    write(simulate(Options(space="planar", robots=3, landmarks=20, team=(kind,)), 2), tmp_path / "log", "plain")
    called = teamslam("run", tmp_path / "log", "--out", tmp_path / "map", "--reject", "--no-figures")
    found = report(tmp_path / "map")
    assert called.code == 0 and found["fit"]["verdict"] == "fits"
    assert f"{found['rejected']['count']:,} of " in called.out and "sightings of landmarks of robot 1" in called.out
    row = found["rejected"]["rows"][0]
    assert row["robot"] == "1" and row["source"] == "landmarks" and row["target"].startswith("landmark ")
    again = teamslam("run", tmp_path / "log", "--out", tmp_path / "again", "--config", tmp_path / "map" / "config.toml")
    assert again.code == 0 and report(tmp_path / "again")["rejected"]["count"] == found["rejected"]["count"]


def test_the_probability_needs_its_option(teamslam, tmp_path: Path) -> None:
    write(simulate(OPTIONS, 1), tmp_path / "log", "plain")
    called = teamslam("run", tmp_path / "log", "--out", tmp_path / "map", "--wrong", "0.1")
    assert called.code == 2 and "--wrong needs --reject" in called.err
