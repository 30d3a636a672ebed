"""split, build, join: a log in pieces, pieces in submaps, submaps in a map; exchange: what sending them costs."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from stress.world import numbered
from teamslam.io import read_submaps, write, write_submaps
from teamslam.joining import build, split
from teamslam.model import Dataset
from teamslam.wire.pieces import read_piece
from worlds import team


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small team's log with truth."""
    path = tmp_path_factory.mktemp("team") / "log"
    write(team("2d", poses=20, landmarks=6, sees=0.6), path, "plain")
    return path


def test_in_steps_it_is_the_map_that_run_makes(teamslam, log: Path, tmp_path: Path) -> None:
    """By the noise as it is stated: what a piece shows of its noise by itself is not what a team shows of it."""
    assert teamslam("split", log, "--out", tmp_path / "pieces", "--poses-per-piece", 8).code == 0
    assert teamslam("build", tmp_path / "pieces", "--out", tmp_path / "submaps", "--no-calibrate").code == 0
    assert len(list((tmp_path / "pieces").iterdir())) == len(read_submaps(tmp_path / "submaps")) >= 6
    beside = ["--truth", log, "--pieces", tmp_path / "pieces"]
    called = teamslam("join", tmp_path / "submaps", "--out", tmp_path / "map", *beside, "--no-figures")
    assert called.code == 0 and "refused" in called.out

    (tmp_path / "options.toml").write_text("calibrate = false\n\n[split]\nposes_per_piece = 8\n")
    run = teamslam("run", log, "--out", tmp_path / "run", "--config", tmp_path / "options.toml", "--no-figures")
    assert run.code == 0
    a, b = (read_submaps(tmp_path / name / "maps")[0] for name in ("map", "run"))
    np.testing.assert_allclose(a.values.minus(b.values), 0.0, atol=1e-9)
    ours, theirs = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("map", "run"))
    for field in ("robots", "poses", "landmarks", "dof", "components"):
        assert ours[field] == theirs[field], field
    assert ours["robot_position_rmse_m"] == pytest.approx(theirs["robot_position_rmse_m"], rel=1e-6)
    assert ours["exactness"] == pytest.approx(theirs["exactness"], rel=1e-6)
    assert ours["exactness"]["rounds"] == 1
    assert ours["refused"] == ours["without"] == []
    assert ours["input"] == str(tmp_path / "submaps")


def test_what_submaps_carry_and_no_map_can_use_is_left_out_or_waits(teamslam, tmp_path: Path) -> None:
    log = team("2d", robots=2, poses=6, landmarks=4, sees=1.0, model="bearing", robot_model="range")
    seen = next(t for t in log.tables if t.source == "landmarks" and t.robot == 1)
    once = np.flatnonzero(seen.keys[:, 1] == seen.keys[0, 1])[:1]
    rest = [t.select(t.keys[:, 1] != seen.keys[0, 1]) for t in log.tables if t.source == "landmarks"]
    others = [t for t in log.tables if t.source != "landmarks"]
    faint = log.with_tables(numbered([*others, *rest, seen.select(once)]))
    submaps = [build(piece) for piece in split(faint)]
    write_submaps(submaps, tmp_path / "both")
    called = teamslam("join", tmp_path / "both", "--out", tmp_path / "map", "--no-figures")
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    run = teamslam("run", _written(faint, tmp_path / "log"), "--out", tmp_path / "run", "--no-figures")
    by_run = json.loads((tmp_path / "run" / "report.json").read_text())
    assert [lost["kind"] for lost in report["left_out"]] == ["landmark"]
    assert report["left_out"] == by_run["left_out"] and report["left_out"][0]["rows"] == 1
    assert called.code == run.code == 1 and report["left_out"][0]["what"] in called.out

    write_submaps(submaps[:1], tmp_path / "one")
    teamslam("join", tmp_path / "one", "--out", tmp_path / "alone", "--no-figures")
    alone = json.loads((tmp_path / "alone" / "report.json").read_text())
    count = sum(len(t) for t in faint.tables if t.source == "robots" and t.robot == 1)
    (waits,) = alone["remarks"]
    assert waits.startswith(f"{count} rows of robots of robot 1 speak of poses of robot 2")


def _written(log: Dataset, path: Path) -> Path:
    write(log, path, "plain")
    return path


def test_an_exact_run_stops_at_the_stated_gap(teamslam, log: Path, tmp_path: Path) -> None:
    found = {}
    for gap in ("1e-2", "1e-12"):
        called = teamslam("run", log, "--out", tmp_path / gap, "--exact", "--gap", gap, "--no-figures")
        assert called.code == 0
        found[gap] = json.loads((tmp_path / gap / "report.json").read_text())["exactness"]
        assert found[gap]["relative_cost_gap"] <= float(gap)
    assert found["1e-2"]["rounds"] < found["1e-12"]["rounds"]


def test_a_log_is_built_without_a_detour(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("build", log, "--out", tmp_path / "submaps", "--version", 4, "-q")
    assert (called.code, called.out, called.err) == (0, "", "")
    assert {s.version for s in read_submaps(tmp_path / "submaps")} == {4}


def test_a_damaged_piece_is_refused_and_the_others_are_built(teamslam, log: Path, tmp_path: Path) -> None:
    teamslam("split", log, "--out", tmp_path / "pieces")
    first, *_ = sorted((tmp_path / "pieces").iterdir())
    whole = first.read_bytes()
    first.write_bytes(whole[:-9])
    called = teamslam("build", tmp_path / "pieces", "--out", tmp_path / "submaps")
    assert called.code == 1 and first.name in called.err and "its digest does not fit" in called.err
    assert len(read_submaps(tmp_path / "submaps")) == 2
    called = teamslam("build", first, "--out", tmp_path / "none")
    assert called.code == 2 and "none of these pieces" in called.err and not (tmp_path / "none").exists()


def test_a_step_too_early_or_too_late_says_which_command_is_meant(teamslam, log: Path, tmp_path: Path) -> None:
    teamslam("split", log, "--out", tmp_path / "pieces")
    teamslam("build", tmp_path / "pieces", "--out", tmp_path / "submaps")
    early = teamslam("join", tmp_path / "pieces", "--out", tmp_path / "map")
    late = teamslam("build", tmp_path / "submaps", "--out", tmp_path / "again")
    assert (early.code, late.code) == (2, 2)
    assert "`teamslam build`" in early.err and "`teamslam join`" in late.err


def test_a_version_that_is_none_is_refused(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("build", log, "--out", tmp_path / "submaps", "--version", -1)
    assert called.code == 2 and "counted from 0" in called.err


def test_bad_submaps_are_refused_with_the_reason_and_the_rest_is_joined(teamslam, log: Path, tmp_path: Path) -> None:
    teamslam("build", log, "--out", tmp_path / "submaps")
    first = sorted((tmp_path / "submaps").iterdir())[0]
    (tmp_path / "submaps" / "cut.submap").write_bytes(first.read_bytes()[:-40])
    called = teamslam("join", tmp_path / "submaps", "--out", tmp_path / "map", "--no-figures")
    assert called.code == 1 and "cut off" in called.err
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert [Path(r["name"]).name for r in report["refused"]] == ["cut.submap"]
    assert report["robots"] == 3


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Submaps of a team whose sightings of each other travel raw, as ranges and bearings do."""
    path = tmp_path_factory.mktemp("seen") / "submaps"
    pieces = split(team("2d", poses=20, landmarks=6, sees=0.6, robot_model="range_bearing"))
    write_submaps([build(piece) for piece in pieces], path)
    return path


@pytest.mark.parametrize("what", ["a robot", "a submap"])
def test_without_a_robot_it_is_as_if_it_had_never_been_there(teamslam, seen: Path, tmp_path: Path, what: str) -> None:
    first, gone, last = sorted(seen.iterdir())
    name = {"a robot": "2", "a submap": read_submaps(gone)[0].id}[what]
    called = teamslam("join", seen, "--out", tmp_path / "without", "--without", name, "--no-figures")
    assert called.code == 0 and "1 left out" in called.out
    assert teamslam("join", first, last, "--out", tmp_path / "never", "--no-figures").code == 0
    maps = [next((tmp_path / out / "maps").iterdir()).read_bytes() for out in ("without", "never")]
    assert maps[0] == maps[1]
    reports = [json.loads((tmp_path / out / "report.json").read_text()) for out in ("without", "never")]
    assert [report["without"] for report in reports] == [[read_submaps(gone)[0].id], []]
    assert [report["robots"] for report in reports] == [2, 2]


def test_without_somebody_unknown_says_who_there_is(teamslam, seen: Path, tmp_path: Path) -> None:
    called = teamslam("join", seen, "--out", tmp_path / "map", "--without", "nobody")
    assert called.code == 2 and "no robot is called 'nobody'" in called.err and "1, 1/0, 2" in called.err
    assert not (tmp_path / "map").exists()


@pytest.mark.parametrize("workers", [[], ["--workers", "1"]])
def test_what_is_left_of_a_team_is_joined_though_others_saw_who_was_refused(
    teamslam, seen: Path, tmp_path: Path, workers: list[str]
) -> None:
    for file in seen.iterdir():
        content = file.read_bytes()
        (tmp_path / file.name).write_bytes(content[:-1] if file.name.startswith("2") else content)
    called = teamslam("join", tmp_path, "--out", tmp_path / "map", *workers)
    assert called.code == 1 and "refused" in called.err
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert report["robots"] == 2 and report["exactness"] is None


def test_where_nothing_can_be_joined_nothing_is_written(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("join", log, "--out", tmp_path / "map")
    assert called.code == 2 and "none of the formats" in called.err and not (tmp_path / "map").exists()
    assert teamslam("join", "--out", tmp_path / "map").code == 2


def test_what_is_there_is_not_written_over(teamslam, log: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    for command in ("split", "build", "join"):
        called = teamslam(command, log, "--out", tmp_path)
        assert called.code == 2 and "not empty" in called.err


@pytest.mark.parametrize("options", [(), ("--topology", "all"), ("--to-the-bit",), ("--keyframe", 5), ("--landmarks",)])
def test_exchange_shows_every_link_and_none_dearer_than_raw(teamslam, log: Path, options: tuple[object, ...]) -> None:
    called = teamslam("exchange", log, *options)
    assert called.code == 0
    links = re.findall(r"^ *(\d) to (\d) .*$", called.out, re.MULTILINE)
    assert len(links) == (6 if "all" in options else 2)
    for line in called.out.splitlines():
        if re.match(r" *(\d to \d|all) ", line):
            _, raw, sparse, partial, condensed, sent = numbers(line)
            assert sent <= min(raw, sparse, partial, condensed)
    assert ("left out" in called.out) is ("--keyframe" in options)
    assert ("to the bit" in called.out) is ("--to-the-bit" in options)


def test_the_ledger_holds_every_message_on_every_link(teamslam, log: Path, tmp_path: Path) -> None:
    options = ["--topology", "all", "--poses-per-piece", 8, "--ledger", tmp_path / "messages.csv"]
    called = teamslam("exchange", log, *options)
    assert called.code == 0
    with (tmp_path / "messages.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    total = next(line for line in called.out.splitlines() if line.lstrip().startswith("all"))
    assert len(lines) == numbers(total)[0]
    assert sum(int(line["bytes"]) for line in lines) == numbers(total)[-1]
    assert len({(line["sender"], line["receiver"], line["submap"]) for line in lines}) == len(lines)


def numbers(line: str) -> list[int]:
    """The six columns of numbers after the link's name."""
    cells = re.split(r"  +", line.strip())
    return [int(cell.replace(",", "")) for cell in cells[1:7]]


def test_a_piece_is_called_what_its_submap_is_called(teamslam, log: Path, tmp_path: Path) -> None:
    teamslam("split", log, "--out", tmp_path / "pieces", "--poses-per-piece", 8)
    for file in (tmp_path / "pieces").iterdir():
        piece = read_piece(file)
        assert isinstance(piece.content, Dataset)
        assert piece.id == build(piece.content).id
