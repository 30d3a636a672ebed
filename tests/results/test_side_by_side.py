import threading
import time
from pathlib import Path

import pytest

from teamslam.results.side_by_side import side_by_side
from teamslam.results.whole import whole_folder


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
        (draft / name).mkdir(parents=True)  # as files that make their folder

    monkeypatch.setattr(threading.Thread, "start", started)
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "run") as draft:
        side_by_side(work, ["a", "b", "c", "d"])
    for thread in begun:
        thread.join()
    assert list(tmp_path.iterdir()) == []


def test_all_is_done_and_the_first_that_failed_is_told() -> None:
    done: list[int] = []
    side_by_side(done.append, range(20))
    assert sorted(done) == [*range(20)]
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda n: 1 // n, [2, 0, 1])


def test_an_interruption_while_folders_are_exchanged_keeps_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine").touch()
    rename = Path.rename

    def interrupted(path: Path, to: Path) -> Path:
        moved = rename(path, to)
        if path == tmp_path / "run":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "run"):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["run"] and (tmp_path / "run" / "mine").exists()
