"""Exit codes are kept apart, each seen by a process: what a script is told in one number."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.cli import codes
from teamslam.io import write
from worlds import team

MODULE = [sys.executable, "-m", "teamslam"]
BROKEN = (
    "import sys, teamslam.io as io\nio.read_log = lambda *a, **k: 1 / 0\n"
    "from teamslam.cli import main\nsys.exit(main())"
)
STOPPED = (
    "import os, signal, sys, teamslam.io as io\nio.read_log = lambda *a, **k: os.kill(os.getpid(), signal.{})\n"
    "from teamslam.cli import main\nsys.exit(main())"
)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole team; one in two parts; one whose rows contradict each other; one of a lone pose, which is no map; one
    whose headings nothing tells."""
    folder = tmp_path_factory.mktemp("logs")
    whole = team("2d", robots=2, poses=20)
    write(whole, folder / "whole")
    parts = [t for t in whole.tables if t.source == "odometry" or (t.source == "landmarks" and t.robot == 1)]
    write(whole.with_tables(parts), folder / "parts")
    wild = [replace(t, whitening=t.whitening * 100.0) for t in whole.tables]
    write(whole.with_tables(wild), folder / "misfit")
    lost = team("2d", robots=1, poses=20, model="range")
    sightings = [t.select(np.arange(1)) for t in lost.tables if t.source == "landmarks"]
    write(lost.with_tables(sightings), folder / "nothing")
    odometry = [t for t in whole.tables if t.source == "odometry"]
    heading = np.array([1.0, 1.0, 0.0])
    blind = [replace(t, whitening=t.whitening * heading[:, None] * heading) for t in odometry]
    write(whole.with_tables(blind), folder / "blind")
    (folder / "stop.toml").write_text("[solver]\nmax_iterations = 1\n")
    return folder


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("run whole --out OUT --no-figures", codes.DONE),
        ("run whole --out OUT --no-figures --method full --config stop.toml", codes.PARTLY),
        ("run parts --out OUT --no-figures", codes.PARTLY),
        ("run nowhere --out OUT", codes.BAD_INPUT),
        ("run", codes.BAD_INPUT),
        ("ruin", codes.BAD_INPUT),
        ("info whole -q -v", codes.BAD_INPUT),
        ("run misfit --out OUT --no-figures", codes.MISFIT),
        ("run nothing --out OUT --no-figures", codes.NO_MAP),
        ("build nothing --out OUT", codes.DONE),  # its pose and its raw row: what others know may place it
        ("build blind --out OUT", codes.NO_MAP),
    ],
)
def test_codes_of_what_may_come_of_a_command(logs: Path, tmp_path: Path, command: str, code: int) -> None:
    out = tmp_path / "out"
    done = subprocess.run(
        [*MODULE, *command.replace("OUT", str(out)).split()], cwd=logs, capture_output=True, text=True
    )
    assert done.returncode == code, (done.stdout, done.stderr)
    assert out.exists() == (code in (codes.DONE, codes.PARTLY, codes.MISFIT)) and "Traceback" not in done.stderr
    assert (done.stdout == "") == (code in (codes.BAD_INPUT, codes.NO_MAP))
    assert ("is robot 1 at pose 0 alone" in done.stdout) == command.startswith("build nothing")


def test_a_mistake_of_ours_has_a_code_of_its_own_and_its_traceback(logs: Path) -> None:
    done = subprocess.run([sys.executable, "-c", BROKEN, "info", "whole"], cwd=logs, capture_output=True, text=True)
    assert done.returncode == codes.BUG and "ZeroDivisionError" in done.stderr and "please report" in done.stderr


@pytest.mark.parametrize(("sent", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_has_the_code_that_shells_give_it(logs: Path, sent: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STOPPED.format(sent), "info", "whole"], cwd=logs, capture_output=True, text=True
    )
    assert done.returncode == code == codes.interrupted(getattr(signal, sent))


def test_a_broken_pipe_is_not_a_map_in_parts(logs: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([*MODULE, "info", "whole", "--json"], cwd=logs, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert done.returncode == codes.BROKEN_PIPE and done.stderr == b""


def test_all_codes_differ_and_are_documented() -> None:
    known = [
        codes.DONE,
        codes.PARTLY,
        codes.BAD_INPUT,
        codes.MISFIT,
        codes.NO_MAP,
        codes.BUG,
        codes.BROKEN_PIPE,
        130,
        143,
    ]
    page = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    table = page[page.index("| exit code") : page.index("Results go to")]
    assert len(set(known)) == len(known) and all(str(code) in table for code in known)
