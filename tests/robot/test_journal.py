"""A robot that was killed goes on from its journal as if nothing had happened; what is damaged is named."""

import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arrivals import in_time, shaken
from teamslam.errors import InputError
from teamslam.io import read, read_submaps, write
from teamslam.joining import build, split
from teamslam.live import begun, drive
from teamslam.model import Dataset, Names, Table, pose_key
from teamslam.robot import Options, Robot
from teamslam.robot.journal import Journal
from teamslam.robot.packets import Body
from teamslam.robot.rows import head_of
from teamslam.wire.messages import canonical, send
from worlds import team


def counted(log: Dataset) -> Dataset:
    return replace(log, names=Names(tick_s=1.0))


def with_loop(log: Dataset) -> Dataset:
    """A loop closure from the end of the log into its beginning."""
    odometry = next(t for t in log.of_robot(1).tables if t.source == "odometry")
    loop = replace(
        odometry,
        source="loops",
        keys=pose_key(1, np.array([[2, 30]])),
        values=odometry.values[:1],
        ids=np.array([0]),
    )
    return log.with_tables([*log.tables, loop])


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 1000), stops=st.lists(st.integers(0, 400), max_size=4), horizon=st.integers(0, 8))
def test_stopped_anywhere_it_ends_with_the_same_pieces(
    tmp_path_factory: pytest.TempPathFactory, seed: int, stops: list[int], horizon: int
) -> None:
    log = with_loop(counted(team("2d", robots=2, poses=40, landmarks=8, seed=seed)))
    options = Options(poses_per_piece=9, horizon_s=float(horizon))
    rows = shaken(in_time(log, 1), horizon, np.random.default_rng(seed))
    path = tmp_path_factory.mktemp("journal") / "journal.db"
    journal = Journal(path, head_of(log, 1))
    whole = robot = begun(log, 1, options, journal.recall())
    for number, row in enumerate(rows):
        whole, robot = whole.step([row]).close(), robot.step([row])
        journal.step(robot)
        robot = robot.close()
        if number in stops:  # the process is gone, and with it all that it held
            journal.close()
            journal = Journal(path, head_of(log, 1))
            robot = begun(log, 1, options, journal.recall())
    assert [piece.version for piece in robot.closed] == [piece.version for piece in whole.closed]
    robot = robot.finish()
    live = [piece for number in range(len(robot.closed)) for piece in robot.pieces(number)]
    offline = split(log.of_robot(1), poses_per_piece=9)
    assert [canonical(build(piece)) for piece in live] == [canonical(build(piece)) for piece in offline]


def test_bodies_are_remembered_as_they_were(tmp_path: Path) -> None:
    log = team("2d", robots=2, poses=10)
    submap = build(split(log.of_robot(2))[0])
    body = Body(send("sparse", submap, submap.values.layout.keys).data, 2, b"signed")
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        assert journal.bodies([body])
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        assert journal.recall().bodies == (body,)


def journaled(path: Path) -> tuple[Dataset, list[Table]]:
    log = counted(team("2d", robots=1, poses=30))
    rows = [table for _, tables in in_time(log, 1) for table in tables]
    robot = Robot.of(log, 1)
    with Journal(path, head_of(log, 1)) as journal:
        for table in rows:
            robot = robot.step([table])
            journal.step(robot)
    return log, rows


def test_a_record_that_is_damaged_is_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    log, rows = journaled(tmp_path / "journal.db")
    with sqlite3.connect(tmp_path / "journal.db") as base:
        (data,) = base.execute("SELECT data FROM records WHERE n = 7").fetchone()
        turned = bytes([data[0] ^ 1]) + data[1:]
        base.execute("UPDATE records SET data = ? WHERE n = 7", (turned,))
    base.close()
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        memory = journal.recall()
    assert len(memory.tables) == len(rows) - 1 and len(memory.damaged) == 1
    assert "record 7 is damaged and left out: its digest does not fit" in memory.damaged[0]


def test_a_torn_tail_is_cut(tmp_path: Path) -> None:
    log = counted(team("2d", robots=1, poses=30))
    path = tmp_path / "journal.db"
    journal, robot = Journal(path, head_of(log, 1)), Robot.of(log, 1)
    for _, tables in in_time(log, 1):
        robot = robot.step(tables)
        journal.step(robot)
    copy = tmp_path / "copy.db"  # as a machine without power would leave it: the last pages half written
    copy.write_bytes(path.read_bytes())
    wal = path.with_name("journal.db-wal").read_bytes()
    copy.with_name("copy.db-wal").write_bytes(wal[: len(wal) - 3000])
    journal.close()
    with Journal(copy, head_of(log, 1)) as torn:
        memory = torn.recall()
    took = robot.counts.taken
    assert not memory.damaged and 0 < sum(map(len, memory.tables)) < took
    ticks = [max(int(t.keys.max() & ((1 << 51) - 1)) for t in memory.tables if t.source == "odometry")]
    assert ticks[0] >= 20  # what was written before the last pages is there


def test_a_disk_that_is_full_ends_nothing_and_is_told(tmp_path: Path) -> None:
    log = counted(team("2d", robots=1, poses=60, landmarks=8))
    journal, robot = Journal(tmp_path / "journal.db", head_of(log, 1)), Robot.of(log, 1)
    base = journal._base
    base.execute("PRAGMA max_page_count = 4")
    for _, tables in in_time(log, 1):
        robot = robot.step(tables)
        journal.step(robot)
    assert "full" in journal.trouble and "records wait in memory" in journal.trouble
    assert not journal.bodies([Body(b"body")]) and robot.now is not None
    base.execute("PRAGMA max_page_count = 100000")  # there is room again
    assert journal.bodies([]) and not journal.trouble
    journal.close()
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as again:
        memory = again.recall()
    assert sum(map(len, memory.tables)) == robot.counts.taken and memory.bodies == (Body(b"body"),)


def test_the_journal_of_another_is_refused(tmp_path: Path) -> None:
    log = team("2d", robots=2, poses=10)
    Journal(tmp_path / "journal.db", head_of(log, 1)).close()
    with pytest.raises(InputError, match="the journal of another robot"):
        Journal(tmp_path / "journal.db", head_of(log, 2))
    (tmp_path / "text.db").write_text("this is no database, whatever it may be called\n" * 50)
    with pytest.raises(InputError, match="the journal cannot be opened"):
        Journal(tmp_path / "text.db", head_of(log, 1))
    with pytest.raises(InputError, match="the journal cannot be opened"):
        Journal(tmp_path / "nowhere" / "journal.db", head_of(log, 1))


def test_a_journal_is_of_one_process_at_a_time(tmp_path: Path) -> None:
    """A robot that is started twice would say different things under one name; a process that has ended is in nobody's
    way, however it ended."""
    log = team("2d", robots=1, poses=10)
    holds = "import sys, time; from teamslam.io import read; from teamslam.robot.journal import Journal; "
    holds += "from teamslam.robot.rows import head_of; j = Journal(sys.argv[2], head_of(read(sys.argv[1]), 1)); "
    holds += "print('there', flush=True); time.sleep(600)"
    write(log, tmp_path / "log", "plain")
    head = head_of(read(tmp_path / "log"), 1)
    command = [sys.executable, "-c", holds, str(tmp_path / "log"), str(tmp_path / "journal.db")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "there\n"
        with pytest.raises(InputError, match="this robot is running already; end it first"):
            Journal(tmp_path / "journal.db", head)
        other.kill()
    Journal(tmp_path / "journal.db", head).close()


def test_a_robot_that_is_killed_again_and_again_ends_with_the_offline_submaps(tmp_path: Path) -> None:
    """SIGKILL at random moments, also while it writes; each time it goes on from its journal."""
    log = team("2d", robots=1, poses=60, landmarks=8)
    write(log, tmp_path / "log", "plain")
    out, rng = tmp_path / "robot", np.random.default_rng(0)
    command = [sys.executable, "-c", "import sys; from teamslam.cli import main; sys.exit(main())"]
    command += ["robot", str(tmp_path / "log"), "--out", str(out), "--poses-per-piece", "12", "--resume"]
    for _ in range(5):
        process = subprocess.Popen([*command, "--speed", "30"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        began = len((out / "poses.csv").read_bytes()) if (out / "poses.csv").exists() else 0
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and process.poll() is None:
            if (out / "poses.csv").exists() and len((out / "poses.csv").read_bytes()) > began:
                break
            time.sleep(0.01)
        time.sleep(float(rng.uniform(0.0, 0.4)))
        process.send_signal(signal.SIGKILL)
        process.wait()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    offline = [build(piece) for piece in split(read(tmp_path / "log"), poses_per_piece=12)]
    assert sorted(map(canonical, read_submaps(out / "submaps"))) == sorted(map(canonical, offline))


def test_drive_writes_what_it_takes_before_it_tells(tmp_path: Path) -> None:
    log = counted(team("2d", robots=1, poses=12))
    with Journal(tmp_path / "journal.db", head_of(log, 1)) as journal:
        for moment in drive(Robot.of(log, 1), (tables for _, tables in in_time(log, 1)), journal=journal):
            assert sum(map(len, journal.recall().tables)) == moment.robot.counts.taken
