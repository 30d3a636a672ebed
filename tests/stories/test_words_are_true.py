"""What a run prints and writes is true in every situation that reaches it: situations times commands, each number
computed again by formulas of its own (see `by_hand`) from the files that lie in the folder."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import by_hand
from stories.test_two_teams import apart
from teamslam.cli import main
from teamslam.io import write
from teamslam.model import Dataset, Table, is_landmark
from teamslam.sim import PRESETS, simulate
from worlds import measure, mixed_team, team


def known_only(log: Dataset, wanted: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    """The log with a truth of some of its variables."""
    assert log.truth is not None
    return replace(log, truth=log.truth.select(wanted(log.truth.layout.keys)))


def with_gps(log: Dataset) -> Dataset:
    """The log with positions of its first robot in the world."""
    assert log.truth is not None
    keys = log.pose_keys[1][::3][:, None]
    gps = measure(1, "gps", "position", 2, keys, 0.05, log.truth, np.random.default_rng(0))
    return log.with_tables([*log.tables, gps])


def hinged() -> Dataset:
    """Two robots with one landmark in common: it joins them nowhere, and is in both maps."""
    whole = team("2d", robots=2, poses=10, landmarks=9, sees=1.0)

    def wanted(table: Table) -> np.ndarray:
        target = table.keys[:, 1]
        mine = np.isin(target, [0, 1, 2, 3, 4] if table.robot == 1 else [4, 5, 6, 7, 8])
        return (table.source == "odometry") | (is_landmark(target) & mine)

    return whole.with_tables(t.select(wanted(t)) for t in whole.tables)


SITUATIONS: dict[str, tuple[Callable[[], Dataset], int]] = {
    "two robots": (lambda: team("2d", robots=2, poses=12), 1),
    "robots on the ground, landmarks in space": (lambda: team("planar", poses=10), 1),
    "space": (lambda: team("3d", robots=2, poses=8), 1),
    "ground and air": (mixed_team, 1),
    "stamps": (lambda: simulate(replace(PRESETS["2d"], robots=2, poses=40), 3), 1),
    "one robot": (lambda: team("2d", robots=1, poses=12), 1),
    "one robot that saw nothing": (lambda: team("2d", robots=1, poses=6, landmarks=0), 1),
    "no landmarks": (lambda: team("2d", robots=3, poses=8, landmarks=0), 1),
    "two maps": (apart, 2),
    "two maps with a landmark in both": (hinged, 2),
    "the world's frame": (lambda: with_gps(team("2d", robots=2, poses=12)), 1),
    "no truth": (lambda: replace(team("2d", robots=2, poses=8), truth=None), 1),
    "truth of landmarks": (lambda: known_only(team("2d", robots=2, poses=8), lambda keys: is_landmark(keys)), 1),
    "truth of some poses": (lambda: known_only(team("2d", robots=2, poses=12), lambda keys: keys % 5 != 0), 1),
    "truth of one landmark": (lambda: known_only(team("2d", robots=2, poses=8), lambda keys: keys == 3), 1),
}

COMMANDS: dict[str, tuple[list[str], str]] = {
    "join": ([], ""),
    "full": (["--method", "full"], ""),
    "exact": (["--exact"], ""),
    "in pieces, one by one": ([], '[split]\nposes_per_piece = 4\n[join]\norder = "sequential"\n'),
    "in pieces, by a tree": ([], '[split]\nposes_per_piece = 4\n[join]\norder = "tree"\n'),
    "in pieces, exact": (["--exact"], "[split]\nposes_per_piece = 4\n"),
}

BARE = ("join", "in pieces, one by one", "in pieces, by a tree")  # a join that does not go on in rounds
CALLS = [(situation, command) for situation in SITUATIONS for command in COMMANDS]


@cache
def log_of(situation: str) -> Dataset:
    return SITUATIONS[situation][0]()


def rows_in(printed: str) -> dict[str, str]:
    """The rows of what was printed, by name."""
    rows = (re.match(r"  (\S.*?)  +(\S.*)", line) for line in printed.splitlines())
    return {row[1]: row[2] for row in rows if row}


def number(text: str) -> float:
    """The first number in a text."""
    found = re.search(r"-?\d[\d,]*(\.\d+)?(e[+-]?\d+)?", text)
    assert found, text
    return float(found[0].replace(",", ""))


@pytest.fixture(scope="session")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], tuple[int, str, Path]]:
    """The exit code of a command in a situation, what it printed, and its folder; each is called once."""
    base = tmp_path_factory.mktemp("true")
    logs: dict[str, Path] = {}

    @cache
    def call(situation: str, command: str) -> tuple[int, str, Path]:
        import contextlib
        import io

        if situation not in logs:
            logs[situation] = base / f"log {len(logs)}"
            write(log_of(situation), logs[situation], "plain")
        options, text = COMMANDS[command]
        out = base / f"{situation} {command}"
        if text:
            (base / "options.toml").write_text(text)
            options = [*options, "--config", str(base / "options.toml")]
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            code = main(["run", str(logs[situation]), "--out", str(out), "--no-figures", *options])
        return code, printed.getvalue(), out

    return call


@pytest.mark.parametrize(("situation", "command"), CALLS)
def test_numbers_are_those_of_the_files(outcome, situation: str, command: str) -> None:
    code, printed, folder = outcome(situation, command)
    log, rows = log_of(situation), rows_in(printed)
    report = json.loads((folder / "report.json").read_text())
    parts = by_hand.components(folder)
    assert len(parts) == SITUATIONS[situation][1] == report["components"] == len(report["parts"])
    assert code == (0 if len(parts) == 1 else 1)
    assert ("components" in rows) == (len(parts) > 1)

    # What went in, and what came out.
    assert rows["went in"] == counts(len(log.robots), sum(map(len, log.pose_keys.values())), len(log.landmark_keys))
    once = sum(sum((t.keys[:, -1] == key).sum() for t in log.tables) == 1 for key in log.landmark_keys)
    assert rows.get("unchecked", "0 landmarks").split()[0] == str(report["seen_once"]) == str(once)
    assert sum(part["poses"] for part in report["parts"]) == sum(len(part.rotations) for part in parts)
    assert [part["landmarks"] for part in report["parts"]] == [len(p.places) - len(p.rotations) for p in parts]

    # The cost of the map that is written, of so many numbers.
    costs = [by_hand.cost(log, part) for part in parts]
    assert report["cost"] == pytest.approx(sum(c for c, _, _ in costs), rel=1e-7, abs=1e-12)
    assert number(rows["cost"]) == pytest.approx(report["cost"], rel=1e-5)
    assert [part["cost"] for part in report["parts"]] == [pytest.approx(c, rel=1e-7, abs=1e-12) for c, _, _ in costs]
    numbers = sum(n for _, n, _ in costs)
    assert (report["numbers_used"], report["numbers_measured"]) == (numbers, log.dof)
    assert (f"all {numbers:,} numbers" in rows["cost"]) == (numbers == log.dof)
    unknowns = sum(unknown_numbers(log, part) for part in parts) - sum(
        frame_numbers(log, part) for part, (_, _, absolute) in zip(parts, costs, strict=True) if not absolute
    )
    assert report["dof"] == numbers - unknowns

    # Errors against the truth.
    if log.truth is None:
        assert rows["errors"] == "unknown: no truth" and report["compared"] is None
        return
    if situation == "truth of one landmark":
        assert "nothing can be compared" in rows["errors"] and report["landmark_rmse_m"] is None
        return
    for kind, row, field in (
        ("robot", "robot position RMSE", "robot_position_rmse_m"),
        ("landmark", "landmark RMSE", "landmark_rmse_m"),
    ):
        found = [by_hand.rmse(log, part, kind) for part in parts]
        known = sum(count for _, count in found)
        assert report["compared"]["poses" if kind == "robot" else "landmarks"] == known
        if not known:
            assert report[field] is None and rows[row].startswith(
                ("unknown: the truth knows none", "none: there are no")
            )
            continue
        pooled = np.sqrt(sum(count * value**2 for value, count in found if count) / known)
        assert report[field] == pytest.approx(pooled, rel=1e-5)
        assert number(rows[row]) == pytest.approx(pooled, abs=5.1e-5)
        mapped = sum(name[0] == kind for part in parts for name in part.places)
        assert (f"{known} of {mapped}" in rows[row]) == (known < mapped)


def counts(robots: int, poses: int, landmarks: int) -> str:
    each = ((robots, "robot"), (poses, "pose"), (landmarks, "landmark"))
    return ", ".join(f"{n:,} {noun}{'s' * (n != 1)}" for n, noun in each)


def unknown_numbers(log: Dataset, part: by_hand.Written) -> int:
    """Numbers of all variables of a component."""
    spatial = {
        by_hand.variable(log, int(k)): int(kind) % 2 for k, kind in zip(log.layout.keys, log.layout.kinds, strict=True)
    }
    return sum((6 if spatial[v] else 3) if v in part.rotations else (3 if spatial[v] else 2) for v in part.places)


def frame_numbers(log: Dataset, part: by_hand.Written) -> int:
    """Numbers of a component's frame: its first robot's pose."""
    robots = {log.names.robot(r): dim for r, dim in log.robots.items()}
    first = next(name for kind, name, _ in part.rotations if kind == "robot")
    return 3 if robots[first] == 2 else 6


@pytest.mark.parametrize(("situation", "command"), [c for c in CALLS if c[1] in BARE])
def test_exactness_is_the_way_to_full_least_squares(outcome, situation: str, command: str) -> None:
    """Within a factor of two of the true gap where that shows; what is said of the join itself is said by its name."""
    _, printed, folder = outcome(situation, command)
    _, _, best = outcome(situation, "full")
    rows, report = rows_in(printed), json.loads((folder / "report.json").read_text())
    least = json.loads((best / "report.json").read_text())["cost"]
    gap = report["cost"] - least
    assert gap >= -1e-9 * max(least, 1.0)
    stated = report["exactness"]["gradient_norm"] ** 2
    if gap > 1e-8 * max(least, 1.0):
        assert 0.5 * gap < stated < 2.0 * gap
        assert "to rounding" not in rows["exactness"]
        share = number(rows["exactness"])
        assert share == pytest.approx(gap / report["cost"] if report["cost"] > 1.0 else gap, rel=1.0)
    else:
        assert stated < 1e-7 * max(least, 1.0)
    differs = abs(report["join_cost"] - report["cost"]) > 1e-6 * report["cost"] and report["cost"] > 1e-12
    assert ("cost of the join" in rows) == differs
    if differs:
        assert number(rows["cost of the join"]) == pytest.approx(report["join_cost"], rel=1e-5)


@pytest.mark.parametrize("situation", SITUATIONS)
def test_exact_is_full(outcome, situation: str) -> None:
    """The same cost, and no word of another one."""
    full, *exact = (
        json.loads((outcome(situation, command)[2] / "report.json").read_text())
        for command in ("full", "exact", "in pieces, exact")
    )
    assert full["join_cost"] is None and full["exactness"] is None
    for report in exact:
        assert report["cost"] == pytest.approx(full["cost"], rel=1e-9, abs=1e-9)
        assert report["join_cost"] is None and report["exactness"]["max_shift_sigma"] < 1e-3


@pytest.mark.parametrize("situation", SITUATIONS)
def test_nothing_to_join_is_said_of_one_submap_only(outcome, situation: str) -> None:
    for command in (command for place, command in CALLS if place == situation):
        _, printed, folder = outcome(situation, command)
        report = json.loads((folder / "report.json").read_text())
        alone = [part["submaps"] == 1 and part["iterations"] == 0 for part in report["parts"]]
        assert ("nothing to join" in rows_in(printed)["status"]) <= any(alone)
        assert [
            part["status"] == "One submap, nothing to join." for part in report["parts"]
        ] == alone or command == "full"
