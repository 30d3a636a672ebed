"""A team that stands makes no garbage: what a robot does again and again for hours leaves nothing behind."""

import ctypes
import gc
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from teamslam.cli.convoy import status_bytes
from teamslam.cli.lasting import lasting
from teamslam.convoy import Driver
from teamslam.events import Events
from teamslam.fleet import Member
from teamslam.given_back import give_back
from teamslam.live import replayed
from teamslam.robot import Options, Robot
from teamslam.robot.journal import Journal
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.rows import head_of
from worlds import team

LOG = team("2d", robots=2, poses=18, landmarks=6, sees=0.5, sigma=0.1, sigma_odometry=0.1)


@contextmanager
def circles() -> Iterator[Counter[str]]:
    """Counts the objects that only Python's search for garbage would have freed."""
    found: Counter[str] = Counter()
    gc.collect()
    gc.disable()
    try:
        yield found
        gc.set_debug(gc.DEBUG_SAVEALL)
        gc.collect()
        found.update(getattr(each, "__qualname__", type(each).__qualname__) for each in gc.garbage)
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        gc.enable()


def mission(air: Air, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots drive, meet and stand; the first keeps a journal and tells how it stands."""
    now = 0.0
    monkeypatch.setattr("teamslam.convoy.monotonic", lambda: now)
    members = {n: Member(Robot.of(LOG, n, Options(9)), Peer(n, Habits(patience_s=1.0)), air.link(n)) for n in (1, 2)}

    def report(driver: Driver) -> None:
        said = driver.status(LOG.names)
        events.changed(said)
        assert json.loads(status_bytes(said))["robot"] == "1"

    with Journal(folder / "journal.db", head_of(LOG, 1)) as journal, closing(Events(folder / "events")) as events:
        driver = Driver(members[1], journal, report)
        for number, member in members.items():
            for _, tables in replayed(LOG, number):
                member.drive(tables)
            member.park()
        for now in range(1, 100):
            air.tick(now)
            driver.beat()
            members[2].talk(now)
    assert members[1].rounds.accounts[0].exactness is not None


def test_nothing_that_a_robot_does_again_and_again_makes_garbage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps, beats, joins, rounds and reports: all that is made goes with the last that knows of it, not when somebody
    looks for it. Else memory grows for as long as nobody does."""
    airs = Air(Weather(), 0), Air(Weather(), 0)
    for air, name in zip(airs, ("first", "again"), strict=True):  # what packages make once is made
        (tmp_path / name).mkdir()
        with circles() as found:
            mission(air, tmp_path / name, monkeypatch)
    assert not found


def test_a_command_that_lasts_looks_for_garbage_often_and_only_among_what_is_new() -> None:
    before, often = gc.get_threshold(), (700, 10, 10)
    gc.set_threshold(100_000, 20, 100)
    try:
        with lasting():
            assert gc.get_threshold() == often and gc.get_freeze_count() > 1000
        assert gc.get_threshold() == (100_000, 20, 100) and gc.get_freeze_count() == 0
    finally:
        gc.set_threshold(*before)


@pytest.mark.parametrize("value", [None, 0.5, "\u00e9", [], {}])
def test_a_report_is_json_that_reads_back(value: object) -> None:
    said = {"links": {"1": {"heard_s_ago": value}}, "holds": ["1/0, version 0"]}
    assert json.loads(status_bytes(said)) == said
    assert b"\n" in status_bytes(said)  # people read it too


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library is not glibc")
def test_what_was_freed_in_pieces_goes_back() -> None:
    pieces = [np.ones(1000) for _ in range(10_000)]
    kept = pieces[::100]
    del pieces
    before = resident()
    give_back()
    assert before - resident() > 40e6 and len(kept) == 100


OF_TWO_THREADS = """
import threading, numpy as np
from pathlib import Path
from teamslam.given_back import share

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

def work(kept):
    pieces = [np.ones(1000) for _ in range(5000)]
    kept += pieces[::100]

if {shared}:
    share()
kept = []
thread = threading.Thread(target=work, args=(kept,))
thread.start()
thread.join()
before = resident()
work(kept)
print(resident() - before)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library is not glibc")
def test_what_one_thread_has_freed_another_takes() -> None:
    """40 MB in pieces, first in one thread, then in another."""
    grown = [
        int(
            subprocess.run(
                [sys.executable, "-c", OF_TWO_THREADS.format(shared=s)], capture_output=True, check=True
            ).stdout
        )
        for s in (False, True)
    ]
    assert grown[0] > 30e6 and grown[1] < 5e6


def resident() -> int:
    """How many bytes of this process are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
