"""The map in a process of its own: the same submaps and poses, only news goes over, and it may end at any time."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from teamslam.beside import Beside, News, news_of
from teamslam.joining import build, split
from teamslam.live import Mapper, drive, mapped, replayed
from teamslam.model import Dataset
from teamslam.robot import Atlas, Options, Robot
from teamslam.wire.messages import canonical
from worlds import team

PIECES = Options(poses_per_piece=10)


def driven(log: Dataset, number: int = 1, poses: int = 1000) -> Robot:
    robot = Robot.of(log, number, PIECES)
    for _, tables in list(replayed(log, number))[:poses]:
        robot = robot.step(tables).close()
    return robot


def test_rounds_in_a_process_are_rounds_here_and_only_news_goes_over() -> None:
    log = team("2d", robots=2, poses=40, landmarks=8, sees=0.6)
    heard = [build(piece) for piece in split(log.of_robot(2), poses_per_piece=12)]
    here, there = Atlas(), Atlas()
    sent: list[News] = []
    with Beside() as beside:
        for poses, known in ((60, heard[:1]), (200, heard[:3]), (1000, heard[1:])):
            robot = driven(log, 1, poses)
            sent.append(news_of(there, robot, known, set(sent[-1].heard) if sent else set()))
            here, expected = mapped(here, robot, known)
            there, found = beside.submit(mapped, there, robot, known).result(60.0)
            assert [canonical(s) for s in there.submaps] == [canonical(s) for s in here.submaps]
            assert (found is None) == (expected is None)
            if found is not None and expected is not None:
                np.testing.assert_array_equal(found.covariance, expected.covariance)
                np.testing.assert_array_equal(found.state, expected.state)
    numbers = [number for news in sent for number, *_ in news.pieces]
    assert numbers == sorted(set(numbers)) and len(numbers) == len(driven(log).closed)
    assert [len(news.fresh) for news in sent] == [1, 2, len(heard) - 3]


def test_the_map_comes_back_where_it_is_shown_and_only_there() -> None:
    log = team("2d", robots=2, poses=40, landmarks=8, sees=0.6)
    heard = [build(piece) for piece in split(log.of_robot(2), poses_per_piece=12)]
    expected, _ = mapped(Atlas(), driven(log), heard)
    for shown in (True, False):
        with Beside(shown=shown) as beside:
            made, _ = beside.submit(mapped, Atlas(), driven(log), heard).result(60.0)
            parts = expected.parts if shown else ()
            assert [canonical(s) for s in beside.parts] == [canonical(s) for s in parts]
            assert not made.parts
    assert {1, 2} <= set(expected.parts[0].robots_in_it)


def test_where_the_process_ends_the_robot_maps_on() -> None:
    log = team("2d", robots=1, poses=40)
    rows = [tables for _, tables in replayed(log, 1)]
    between = [s for moment in drive(Robot.of(log, 1, PIECES), rows) for s in moment.submaps]
    with Beside() as beside:
        os.kill(beside._process.pid or 0, signal.SIGKILL)
        found = [s for moment in drive(Robot.of(log, 1, PIECES), rows, executor=beside) for s in moment.submaps]
        mapper, robot = Mapper(beside), driven(log)
        robot, _ = mapper.attend(robot)
        until = time.monotonic() + 60.0
        while not mapper.trouble and time.monotonic() < until:
            robot, _ = mapper.attend(robot)
            time.sleep(0.01)
        assert "has ended" in mapper.trouble and mapper.attend(robot)[1]
    assert sorted(map(canonical, found)) == sorted(map(canonical, between))


def test_where_the_robot_is_killed_the_process_ends_too(tmp_path: Path) -> None:
    script = tmp_path / "robot.py"
    script.write_text(
        "import time\nfrom teamslam.beside import Beside\n"
        "if __name__ == '__main__':\n    b = Beside()\n    print(b._process.pid, flush=True)\n    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        child = int(robot.stdout.readline())
        robot.kill()
    until = time.monotonic() + 60.0
    while _runs(child) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _runs(child)


def _runs(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
