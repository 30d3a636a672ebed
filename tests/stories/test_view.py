"""`teamslam view` with the real server and a real browser: what is switched changes, and Ctrl-C ends it cleanly."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from browser import browsing, complaints, opened
from teamslam.cli import main
from teamslam.io import write
from teamslam.results import read_run, with_residuals
from worlds import apart, team

CALL = "import sys; from teamslam.cli import main; sys.exit(main(sys.argv[1:]))"
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A team in space, joined and by full least squares."""
    place = tmp_path_factory.mktemp("runs")
    write(team("3d"), place / "log", "plain")
    found = [place / "joined", place / "full"]
    for folder, method in zip(found, ("join", "full"), strict=True):
        assert main(["run", str(place / "log"), "--out", str(folder), "--method", method, "-q", "--no-figures"]) == 0
    return found


@pytest.fixture
def served(runs: list[Path]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command as a process of its own, and the address it says."""
    pytest.importorskip("viser")
    command = [sys.executable, "-c", CALL, "view", *map(str, runs), "--no-browser", "--port", "18080"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env={**os.environ, "PYTHONUNBUFFERED": "1"})  # fmt: skip
    assert process.stdout is not None and process.stderr is not None
    try:
        said = process.stdout.readline()
        assert "look at http://" in said, process.stderr.read()
        yield process, said.split()[2]
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        process.stderr.close()


def test_a_connection_that_asks_nothing_is_no_error(served: tuple[subprocess.Popen[str], str]) -> None:
    """Browsers connect ahead of need, and go away again."""
    process, address = served
    where = urlsplit(address)
    assert where.hostname is not None and where.port is not None
    with socket.create_connection((where.hostname, where.port), PATIENCE_S) as ahead:
        ahead.sendall(b"GET")
        ahead.shutdown(socket.SHUT_WR)
        ahead.recv(100)
    with socket.create_connection((where.hostname, where.port), PATIENCE_S) as one:  # heard after the other
        one.sendall(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        assert one.recv(100)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0
    assert process.stderr is not None and process.stderr.read() == ""


def test_a_browser_sees_it_and_ctrl_c_ends_it(served: tuple[subprocess.Popen[str], str]) -> None:
    """The scene is drawn; a switch off and on, and another time, change it; then nobody listens, nothing is said."""
    process, address = served
    with browsing() as chrome:
        opened(chrome, address)
        whole = settled(chrome)
        for word in ("ways", "full", "2"):
            switch(chrome, word).click()
            without = changed(chrome, whole)
            switch(chrome, word).click()
            assert changed(chrome, without) != without
            whole = settled(chrome)
        knob = until(lambda: next(iter(chrome.find_elements("css selector", "[role=slider]")), None))
        knob.send_keys("\ue011")  # Home: the beginning
        changed(chrome, whole)
        of_the_driver = ("GL Driver Message", "[.WebGL-", "deprecated")  # and of the viewer's own client
        ours = [said for said in complaints(chrome) if not any(word in said for word in of_the_driver)]
        assert ours == []
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0
    assert process.stderr is not None and process.stderr.read() == ""
    parts = urlsplit(address)
    with socket.socket() as knocking:
        assert knocking.connect_ex((parts.hostname, parts.port)) != 0


def shot(chrome: Any) -> bytes:
    """What the scene looks like."""
    found: bytes = chrome.find_element("css selector", "canvas").screenshot_as_png
    return found


def settled(chrome: Any) -> bytes:
    """The scene once it is there and stands still."""
    until(lambda: chrome.find_elements("css selector", "canvas") and chrome.find_elements("css selector", "input"))
    before = b""

    def still() -> bytes | None:
        nonlocal before
        now = shot(chrome)
        same, before = now == before and len(now) > 8000, now
        return now if same else None

    return until(still)


def changed(chrome: Any, before: bytes) -> bytes:
    """The scene as it is once it is another."""
    until(lambda: shot(chrome) != before)
    return settled(chrome)


def switch(chrome: Any, word: str) -> Any:
    """The switch that stands beside a word (or after the end of a path)."""
    asked = """
      for (const box of document.querySelectorAll('input[type=checkbox]')) {
        for (let up = box.parentElement, n = 0; up && n < 6; up = up.parentElement, n++) {
          const said = up.textContent.trim();
          if (said) { if (said === arguments[0] || said.endsWith('/' + arguments[0])) return box; break; }
        }
      }"""
    return until(lambda: chrome.execute_script(asked, word))


def until(found: Any) -> Any:
    """What comes to be found, before patience ends."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if result := found():
            return result
        time.sleep(0.3)
    raise AssertionError("it did not come about")


def test_runs_of_one_log_lie_on_each_other_and_parts_beside(runs: list[Path], tmp_path: Path) -> None:
    """The joined and the full map of one log agree where they are placed; two components do not overlap."""
    from teamslam.viewer import placed

    both = placed({run.name: with_residuals(read_run(run), run) for run in runs})
    ways = [run.frames[0].act(run.page.parts[0].ways[1].places) for run in both]
    np.testing.assert_allclose(ways[0], ways[1], atol=0.05)
    write(apart(), tmp_path / "log", "plain")
    main(["run", str(tmp_path / "log"), "--out", str(tmp_path / "run"), "-q", "--no-figures"])
    (run,) = placed({"run": read_run(tmp_path / "run")})
    ends = [
        frame.act(np.concatenate([part.marks.places, *(way.places for way in part.ways)]))[:, 0]
        for part, frame in zip(run.page.parts, run.frames, strict=True)
    ]
    assert len(ends) == 2 and ends[0].max() < ends[1].min()


def test_no_run_to_look_at(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and what to give."""
    assert main(["view"]) == 2 and "folders that `teamslam run` wrote" in capsys.readouterr().err
