"""`teamslam robot` told by a file, with rows that come as lines: as a robot has it that drives."""

import csv
import functools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from teamslam.duty import Duty, read_duty
from teamslam.errors import InputError
from teamslam.events import happened
from teamslam.io import read, read_submaps, write
from teamslam.io.plain.lines import Lines
from teamslam.joining import build, split
from teamslam.live import spoken
from teamslam.robot import Options
from teamslam.team import SubmapSet
from teamslam.wire.messages import canonical
from worlds import team


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("team") / "log"
    write(team("2d", robots=2, poses=20, landmarks=6, sees=0.6), path, "plain")
    return path


def lines_of(log: Path, robot: str) -> list[str]:
    """A plain log's rows of one robot as lines, those of each time together, odometry first."""
    rows = []
    for path in sorted(log.glob(f"*_{robot}.csv")):
        with path.open() as file:
            for row in csv.DictReader(file):
                when = float(row.get("to_stamp") or row["stamp"])
                cells = {k: v if k in ("other", "landmark") else float(v) for k, v in row.items()}
                rows.append((when, "to_stamp" not in row, json.dumps({"file": path.name} | cells)))
    return [line for _, _, line in sorted(rows, key=lambda row: row[:2])]


def played(out: Path, lines: list[str], *options: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "teamslam", "robot", *map(str, options), "--out", str(out)]
    return subprocess.run(command, input="\n".join(lines) + "\n", capture_output=True, text=True, check=False)


def test_rows_as_lines_make_the_submaps_of_the_log(log: Path, tmp_path: Path) -> None:
    lines = lines_of(log, "2")
    called = played(tmp_path / "two", lines, log, "--lines", "--robot", 2, "--poses-per-piece", 8)
    assert called.returncode == 0, called.stderr
    offline = [build(piece) for piece in split(read(log).of_robot(2), poses_per_piece=8)]
    assert sorted(map(canonical, read_submaps(tmp_path / "two" / "submaps"))) == sorted(map(canonical, offline))


class Shut:
    """A robot in a process whose disk takes nothing any more from the moment on that it is told to: no file grows, and
    none is begun in its folder. So it ends for whoever writes, whether a disk is full or was made read-only."""

    def __init__(self, out: Path, *options: object) -> None:
        resource = pytest.importorskip("resource")
        if not hasattr(resource, "prlimit"):
            pytest.skip("no limits of another process here")
        root: list[str] = []
        if os.geteuid() == 0:  # whom no folder is closed to
            if shutil.which("setpriv") is None:
                pytest.skip("root without setpriv")
            rights = "-dac_override,-dac_read_search"
            root = ["setpriv", "--bounding-set", rights, "--inh-caps", rights]
        self.out, self._limits, pipe = out, resource, subprocess.PIPE
        command = [*root, sys.executable, "-m", "teamslam", "robot", *map(str, options), "--out", str(out)]
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)

    def within(self, seconds: float, there: Callable[[], bool]) -> bool:
        """Whether something comes about in a time, while it runs."""
        until = time.monotonic() + seconds
        while not there() and time.monotonic() < until and self.process.poll() is None:
            time.sleep(0.02)
        return there()

    def shut(self) -> None:
        for folder in (self.out, self.out / "submaps"):
            folder.chmod(0o555)
        self._limits.prlimit(self.process.pid, self._limits.RLIMIT_FSIZE, (0, self._limits.RLIM_INFINITY))

    def ended(self, words: str = "") -> tuple[int, str]:
        """Its exit code and what it said, with some words more for it."""
        self.told, said = self.process.communicate(words, timeout=120.0)
        for folder in (self.out, self.out / "submaps"):
            folder.chmod(0o755)
        return self.process.returncode, said


def test_on_a_disk_that_shuts_for_good_it_maps_on_and_ends_in_words(log: Path, tmp_path: Path) -> None:
    """Each file is named. With a disk that takes something, and its rows told once more, its submaps are the same."""
    taken, lines, out = Counter[str](), list[str](), tmp_path / "two"
    for row in map(json.loads, lines_of(log, "2")):
        lines.append(json.dumps(row | {"id": taken[row["file"]]}))
        taken[row["file"]] += 1
    options = (log, "--lines", "--robot", 2, "--poses-per-piece", 8, "--resume")
    robot = Shut(out, *options)
    assert robot.process.stdin is not None
    robot.process.stdin.write("\n".join(lines[: len(lines) // 2]) + "\n")
    robot.process.stdin.flush()
    assert robot.within(90.0, lambda: (out / "poses.csv").exists() and (out / "poses.csv").read_text().count("\n") > 12)
    robot.shut()
    code, said = robot.ended("\n".join(lines[len(lines) // 2 :]) + "\n")
    assert code == 1 and "Traceback" not in said
    assert all(file in said for file in ("journal.db", "poses.csv", "submaps")), said
    assert all(line.startswith("teamslam: ") for line in said.splitlines()), said
    again = played(out, lines, *options)
    assert again.returncode == 0, again.stderr
    offline = [build(piece) for piece in split(read(log).of_robot(2), poses_per_piece=8)]
    assert sorted(map(canonical, read_submaps(out / "submaps"))) == sorted(map(canonical, offline))


def test_a_disk_that_is_shut_when_a_robot_leaves_its_team_costs_its_map_and_no_more(log: Path, tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{probe.getsockname()[1]}"
    out = tmp_path / "two"
    options = (log, "--robot", 2, "--poses-per-piece", 8, "--listen", place, "--resume")

    def parked() -> bool:
        try:
            return bool(json.loads((out / "status.json").read_text())["parked"])
        except (OSError, ValueError):
            return False

    robot = Shut(out, *options)
    assert robot.within(90.0, parked)
    robot.shut()
    assert robot.process.stderr is not None and "status.json" in robot.process.stderr.readline()
    told = (out / "status.json").stat().st_mtime_ns
    robot.process.send_signal(signal.SIGTERM)
    code, said = robot.ended()
    assert code == 1 and not (out / "maps").exists()
    for line, file in zip(said.splitlines(), ("submaps", "the map is not written"), strict=True):
        assert line.startswith("teamslam: ") and file in line, said
    robot = Shut(out, *options)
    assert robot.within(90.0, lambda: parked() and (out / "status.json").stat().st_mtime_ns != told)
    robot.process.send_signal(signal.SIGTERM)
    assert robot.ended() == (0, "")
    assert f"robot 2 of team team listens at {place}" in robot.told
    assert f"written: {out}: 3 submaps, 1 robot, 1 part of the map" in robot.told
    offline = [build(piece) for piece in split(read(log).of_robot(2), poses_per_piece=8)]
    assert [canonical(part) for part in read_submaps(out / "maps")] == [canonical(SubmapSet.of(*offline).join().map)]


def test_rows_over_the_network_make_the_submaps_of_the_log(log: Path, tmp_path: Path) -> None:
    zenoh = pytest.importorskip("zenoh")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{probe.getsockname()[1]}"
    out, taken, rows = tmp_path / "two", Counter[str](), list[str]()
    for row in map(json.loads, lines_of(log, "2")):
        rows.append(json.dumps(row | {"id": taken[row["file"]]}))
        taken[row["file"]] += 1
    robot = Shut(
        out, log, "--robot", 2, "--poses-per-piece", 8, "--listen", place, "--remote", "--events", tmp_path / "events"
    )

    def said(*path: str) -> Any:
        try:
            found = json.loads((out / "status.json").read_text())
        except (OSError, ValueError):
            return None
        return functools.reduce(lambda at, name: at[name], path, found)

    assert robot.within(90.0, lambda: said("robot") == "2")
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [f"tcp/{place}"]}}))
    with zenoh.open(config) as session:
        for packet, there in (
            ("\n".join(rows), lambda: said("rows", "taken") == len(rows)),
            ("no row\n", lambda: "wrong" in (tmp_path / "events").read_text()),
            ("", lambda: said("parked")),
        ):

            def heard(packet: str = packet, there: Callable[[], Any] = there) -> bool:
                """Whether it has been, though it may be told more than once."""
                session.put("teamslam/team/rows/2", packet)
                return bool(there())

            assert robot.within(90.0, heard)
    robot.process.send_signal(signal.SIGTERM)
    code, complaints = robot.ended()
    assert code == 1 and "made no sense and" in complaints
    offline = [build(piece) for piece in split(read(log).of_robot(2), poses_per_piece=8)]
    assert sorted(map(canonical, read_submaps(out / "submaps"))) == sorted(map(canonical, offline))


def test_stopped_on_the_way_it_goes_on_with_the_lines_that_follow(log: Path, tmp_path: Path) -> None:
    """Rows are counted on from those in the journal, and names of landmarks are remembered."""
    named = [line.replace('"landmark": "', '"landmark": "tag ') for line in lines_of(log, "2")]
    half = next(n for n, line in enumerate(named) if '"to_stamp"' in line and n > len(named) // 2)
    duty = tmp_path / "duty.toml"
    duty.write_text(
        f'log = "{log}"\nrobot = "2"\nout = "two"\nlines = true\nresume = true\nevents = "events.jsonl"\n'
        "[steps]\nposes_per_piece = 8\n"
    )
    whole = played(tmp_path / "whole", named, log, "--lines", "--robot", 2, "--poses-per-piece", 8)
    assert whole.returncode == 0, whole.stderr
    for part in (named[:half], [*named[half:], '{"file": "landmarks_2.csv", "stamp": "noon"}', "nonsense"]):
        called = played(tmp_path / "two", part, "--config", duty)
    assert called.returncode == 1 and called.stderr.count("line ") == 2
    maps = [sorted(map(canonical, read_submaps(tmp_path / name / "submaps"))) for name in ("two", "whole")]
    assert maps[0] == maps[1]
    known = {name for submap in read_submaps(tmp_path / "two" / "submaps") for name in submap.names.landmarks.values()}
    assert known and all(name.startswith("tag ") for name in known)
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    kinds = [event["event"] for event in events]
    assert kinds.count("begun") == 2 and kinds.count("wrong") == 2 and kinds.count("ended") == 2
    assert events[-1]["code"] == 1 and {"2/0"} <= {e["id"] for e in events if e["event"] == "submap"}


def test_a_duty_says_all_and_the_command_line_wins(tmp_path: Path) -> None:
    path = tmp_path / "duty.toml"
    path.write_text(
        'log = "log"\nout = "/var/red"\n[steps]\nlandmarks = 9\n[team]\nlisten = "10.0.0.3:7447"\n'
        'certificates = "secrets"\nmembers = [1, 2]\n[habits]\nrate = 20000\n'
    )
    duty = read_duty(path)
    assert duty.log == tmp_path / "log" and duty.out == Path("/var/red") and duty.steps == Options(landmarks=9)
    address = duty.address(2)
    assert address is not None and address.certificates == tmp_path / "secrets" and address.members == (1, 2)
    assert duty.habits.rate == 20000 and Duty().address(1) is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rowbot = 1", "field 'rowbot': unknown option; did you mean 'robot'?"),
        ("[steps]\nposes_per_peace = 3", "field 'steps.poses_per_peace': unknown option; did you mean"),
        ('[steps]\nlandmarks = "many"', "field 'steps.landmarks'"),
        ("[steps]\nlandmarks = 0", "at least 1 landmark"),
        ("speed = 0.0", "a speed is above 0"),
        ("lines = true\nspeed = 2.0", "leave out speed"),
        ("log = 3", "field 'log'"),
        ("[team]\nmembers = 3", "field 'team.members'"),
        ("[habits]\nrate = -1.0", "a number above 0"),
        ("log = [", "not valid TOML"),
    ],
)
def test_a_duty_that_makes_no_sense_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "duty.toml"
    path.write_text(text + "\n")
    with pytest.raises(InputError, match=r"duty\.toml") as error:
        read_duty(path)
    assert says in str(error.value)


def test_what_is_not_said_is_asked_for(teamslam, log: Path, tmp_path: Path) -> None:
    assert "LOG is not given" in teamslam("robot", "--out", tmp_path / "out").err
    assert "--out is not given" in teamslam("robot", log).err
    called = teamslam("robot", log, "--lines", "--out", tmp_path / "out")
    assert called.code == 2 and "say which robot this is, one of 1, 2" in called.err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("[1]", "line 1: expected an object"),
        ('{"stamp": 1.0}', "line 1, field 'file': expected one of"),
        ('{"file": "landmarks_2.csv", "robot": "1"}', "line 1, field 'robot': this robot is 2, found 1"),
        ('{"file": "landmarks_2.csv", "stamp": -1, "landmark": 3, "x": 1, "y": 1}', "line 1, field 'stamp'"),
        ('{"file": "landmarks_2.csv", "stamp": 1, "landmark": 3, "x": 1, "yy": 1}', "x, y (plane)"),
    ],
)
def test_a_line_that_makes_no_sense_is_named(log: Path, line: str, says: str) -> None:
    with pytest.raises(InputError) as error:
        Lines(log, "2").row(line)
    assert says in str(error.value)


def test_blank_lines_count_where_a_line_makes_no_sense(log: Path) -> None:
    """The number is that of the line as an editor counts them."""
    said: list[str] = []
    stream = ["\n", '{"file": 1}\n', "  \n", "\n", "[1]\n"]
    told = list(spoken(Lines(log, "2"), stream, lambda error: said.append(str(error)), 60.0))
    assert told == [] and ["line 2" in said[0], "line 5" in said[1]] == [True, True]


def test_what_happened_is_told_once() -> None:
    before = {"holds": ["1/0, version 0"], "missing": 2, "refused_packets": {"why": 1}, "links": {"all": {}}}
    after = {
        "holds": ["1/0, version 1", "2/0, version 0"], "missing": 0, "refused_packets": {"why": 3}, "parked": True,
        "links": {"all": {}, "2": {}}, "rows": {"late": 4}, "journal": "full", "revoked": ["3"],
    }  # fmt: skip
    assert list(happened(after, after)) == []
    assert list(happened(before, after)) == [
        {"event": "submap", "id": "1/0", "version": 1},
        {"event": "submap", "id": "2/0", "version": 0},
        {"event": "met", "robot": "2"},
        {"event": "late", "rows": 4},
        {"event": "refused", "reason": "why", "packets": 2},
        {"event": "revoked", "robot": "3"},
        {"event": "complete"},
        {"event": "journal", "trouble": "full"},
        {"event": "parked"},
    ]
