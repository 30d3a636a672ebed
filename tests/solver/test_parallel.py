"""Parts worked on side by side come out as one after the other, in their order and to the bit."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from teamslam import kernel
from teamslam.joining import build, split
from teamslam.solver import each_side_by_side, meanwhile, side_by_side
from worlds import WORLDS, team


@pytest.mark.parametrize("world", WORLDS)
def test_submaps_built_side_by_side_are_the_same(world: str) -> None:
    pieces = split(team(world, robots=4, poses=40))
    for alone, beside in zip(map(build, pieces), side_by_side(build, pieces), strict=True):
        np.testing.assert_array_equal(alone.values.state, beside.values.state)
        np.testing.assert_array_equal(alone.information.data, beside.information.data)


def test_what_fails_is_raised_in_its_place_and_ends_the_rest() -> None:
    begun: list[int] = []

    def work(part: int) -> int:
        begun.append(part)
        if part > 3:
            time.sleep(1e-3)  # there is more to do than is done when the fourth part is found to have failed
        return 1 // (3 - part)

    found = each_side_by_side(work, range(1000))
    assert [next(found) for _ in range(3)] == [0, 0, 1]
    with pytest.raises(ZeroDivisionError):
        next(found)
    assert len(begun) < 1000


def test_who_stops_listening_starts_no_more() -> None:
    begun: list[int] = []
    found = each_side_by_side(lambda part: begun.append(part), range(100_000))
    next(found)
    found.close()
    assert len(begun) < 100_000


@pytest.mark.parametrize("nth", [1, 2, 3])
def test_nobody_works_on_after_an_interruption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nth: int) -> None:
    """One that comes while a thread is being started, of which the pool does not know yet."""
    start = threading.Thread.start
    begun = []

    def started(thread: threading.Thread) -> None:
        start(thread)
        begun.append(thread)
        if len(begun) == nth:
            raise KeyboardInterrupt

    def work(name: str) -> None:
        time.sleep(0.05)
        (tmp_path / name).mkdir()

    monkeypatch.setattr(threading.Thread, "start", started)
    monkeypatch.setattr(kernel, "threads", lambda: 4)
    with pytest.raises(KeyboardInterrupt):
        side_by_side(work, ["a", "b", "c", "d"])
    made = sorted(tmp_path.iterdir())
    for thread in begun:
        thread.join()
    assert sorted(tmp_path.iterdir()) == made


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_done_meanwhile_is_done_once_and_what_went_wrong_is_heard_by_who_asks(threads: int) -> None:
    """On another thread, and where there is none, by who asks."""
    done: list[int] = []

    def work() -> int:
        done.append(threading.get_ident())
        return 7

    before = kernel.threads()
    kernel.set_threads(threads)
    try:
        with meanwhile(work) as came:
            pass
        assert len(done) == threads - 1
        assert came() == 7 and len(done) == 1
        assert (threading.get_ident() in done) == (threads == 1)
        with meanwhile(lambda: 1 / 0) as failed:
            done.append(0)
    finally:
        kernel.set_threads(before)
    assert done[-1] == 0
    with pytest.raises(ZeroDivisionError):
        failed()
