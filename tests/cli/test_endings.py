"""How commands end where the world does not play along: Ctrl-C, pipes, disks, terminals, names. Each is a process of
its own, and says one line; nothing is left half-written."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from teamslam.io import write
from teamslam.model import Names
from thinned import thinned
from worlds import team

CALL = "import sys; from teamslam.cli import main; sys.exit(main())"
# The signal comes when a module is first looked for, or a file first opened: at a known place, not at a known time.
AT_IMPORT = """
import importlib.abc, os, signal, sys
class Watch(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.{signal})
from teamslam.cli import main
sys.meta_path.insert(0, Watch())
sys.exit(main())
"""
AT_OPENING = """
import os, signal, sys
done = []
def hear(event, arguments):
    if event == "open" and not done and {name!r} in str(arguments[0]) and {{*"wx"}} & {{*str(arguments[1] or "wx")}}:
        done.append(1)
        os.kill(os.getpid(), signal.{signal})
sys.addaudithook(hear)
from teamslam.cli import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("team") / "log"
    write(team("2d", robots=2, poses=10), path, "plain")
    return path


def call(
    *arguments: object, code: str = CALL, cwd: Path | None = None, limit: int | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """A command as a process; `limit`: no file may grow longer [bytes]."""
    ulimit: Callable[[], None] | None = None
    if limit is not None:
        ulimit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # noqa: E731
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        preexec_fn=ulimit,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **environment},
        encoding="utf-8",
    )


def one_line(said: str) -> str:
    assert said.count("\n") == 1 and said.startswith("teamslam: "), said
    return said


@pytest.mark.parametrize(
    "module", ["cyclopts", "teamslam.pipeline", "numpy", "scipy.sparse", "teamslam.kernel.library"]
)
def test_ctrl_c_while_importing_is_one_line(log: Path, tmp_path: Path, module: str) -> None:
    done = call("run", log, "--out", tmp_path / "run", code=AT_IMPORT.format(name=module, signal="SIGINT"))
    assert done.returncode == 130 and done.stdout == ""
    assert one_line(done.stderr) == "teamslam: interrupted; nothing is left half-written\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("file", "ended"),
    thinned(2, ["config.toml", "map.npz", "landmarks.csv", "report.json"], [("SIGINT", 130), ("SIGTERM", 143)]),
)
def test_a_signal_while_writing_leaves_nothing_half(
    log: Path, tmp_path: Path, file: str, ended: tuple[str, int]
) -> None:
    sent, code = ended
    done = call("run", log, "--out", tmp_path / "run", code=AT_OPENING.format(name=file, signal=sent))
    assert done.returncode == code and "nothing is left half-written" in one_line(done.stderr)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_drawing_keeps_the_map_and_says_how_to_draw(log: Path, tmp_path: Path) -> None:
    done = call("run", log, "--out", "run", code=AT_OPENING.format(name=".map.png", signal="SIGINT"), cwd=tmp_path)
    assert done.returncode == 130 and "`teamslam plot run`" in one_line(done.stderr)
    assert call("plot", "run", cwd=tmp_path).returncode == 0
    assert (tmp_path / "run" / "figures" / "map.png").exists()


def test_ctrl_c_on_workers_is_one_line_and_the_same_command_goes_on(tmp_path: Path) -> None:
    write(team("2d", robots=4, poses=60), tmp_path / "log", "plain")
    command = [sys.executable, "-c", CALL, "run", "log", "--out", "run", "--workers", "2", "--no-figures"]
    running = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while running.poll() is None and not list(tmp_path.glob("run.parts/pieces/*")):
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGINT)
    out, err = running.communicate()
    if running.returncode != 0:  # else it was quicker than we
        assert (running.returncode, out) == (130, "")
        assert "run.parts" in one_line(err) and "goes on from there" in err
    assert not (tmp_path / "run").exists() or running.returncode == 0
    done = subprocess.run([*command, "--force"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and not (tmp_path / "run.parts").exists()


@pytest.mark.parametrize("command", [["info", "LOG"], ["--help"], ["run", "--help"]])
def test_a_pipe_that_nobody_reads_is_no_error_to_speak_of(log: Path, command: list[str]) -> None:
    """As of other programs: 128 + SIGPIPE, and not a word."""
    arguments = [str(log) if word == "LOG" else word for word in command]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-c", CALL, *arguments], stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_what_cannot_be_printed_for_want_of_room_is_one_line(log: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-c", CALL, "info", log], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2 and "No space left" in one_line(done.stderr)


def test_closed_streams_are_no_traceback(log: Path) -> None:
    for closed, what, code in ((">&-", log, 0), ("2>&-", "nowhere", 2), (">&- 2>&-", log, 0)):
        shell = f'"{sys.executable}" -c "{CALL}" info "{what}" {closed}'
        assert subprocess.run(shell, shell=True, capture_output=True).returncode == code


@pytest.mark.parametrize(
    ("command", "limit", "file"),
    [
        ("run LOG --out out --no-figures", 100, "out/config.toml"),
        ("run LOG --out out --no-figures", 2000, "out/maps/1_"),
        ("split LOG --out out", 300, "out/1_robot_1.piece"),
        ("build LOG --out out", 300, "out/1_1_0.submap"),
        ("convert LOG out.g2o", 300, "out.g2o"),
        ("convert LOG out", 300, "out/"),
        ("simulate out --poses 5", 300, "out/"),
        ("exchange LOG --ledger out.csv", 20, "out.csv"),
    ],
)
def test_a_full_disk_names_the_file_and_leaves_nothing(
    log: Path, tmp_path: Path, command: str, limit: int, file: str
) -> None:
    done = call(*command.replace("LOG", str(log)).split(), cwd=tmp_path, limit=limit)
    assert done.returncode == 2 and "File too large" in one_line(done.stderr)
    assert done.stderr.startswith(f"teamslam: {file}")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_too_full_for_figures_keeps_the_map(log: Path, tmp_path: Path) -> None:
    done = call("run", log, "--out", "run", cwd=tmp_path, limit=40_000)
    assert done.returncode == 1 and "(run/figures/map.png: File too large); the map is whole in run" in one_line(
        done.stderr
    )
    assert "written: run\n" in done.stdout and (tmp_path / "run" / "report.json").exists()
    assert not any((tmp_path / "run" / "figures").iterdir())


@pytest.mark.parametrize("command", ["run LOG --out OUT", "split LOG --out OUT", "convert LOG OUT", "simulate OUT"])
def test_a_folder_that_may_not_be_written_is_one_line(log: Path, tmp_path: Path, command: str) -> None:
    """/proc takes no file from anybody, root not excepted."""
    for place in (tmp_path / "file" / "out", Path("/proc/out")):
        (tmp_path / "file").write_text("x")
        done = call(*command.replace("LOG", str(log)).replace("OUT", str(place)).split())
        assert done.returncode == 2 and str(place) in one_line(done.stderr)


@pytest.mark.parametrize("command", ["demo --out FILE", "paper --runs 1 --out FILE", "plot RUN --out FILE"])
def test_an_output_that_is_a_file_is_told_before_any_work(log: Path, tmp_path: Path, command: str) -> None:
    (tmp_path / "file").write_text("mine")
    assert call("run", log, "--out", tmp_path / "run", "--no-figures").returncode == 0
    done = call(*command.replace("FILE", str(tmp_path / "file")).replace("RUN", str(tmp_path / "run")).split())
    assert done.returncode == 2 and "the output is a file" in one_line(done.stderr) and done.stdout == ""
    assert (tmp_path / "file").read_text() == "mine"


def test_the_folder_that_one_stands_in_is_filled(log: Path, tmp_path: Path) -> None:
    """And stays the same folder."""
    (tmp_path / "here").mkdir()
    before = (tmp_path / "here").stat().st_ino
    for force in ([], ["--force"]):
        done = call("run", log, "--out", ".", *force, "--no-figures", cwd=tmp_path / "here")
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "here").stat().st_ino == before and (tmp_path / "here" / "report.json").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["here"]
    assert not any(p.name.startswith(".") for p in (tmp_path / "here").iterdir())


def test_the_input_is_not_replaced_by_the_output(log: Path, tmp_path: Path) -> None:
    assert call("run", log, "--out", tmp_path / "run", "--no-figures").returncode == 0
    done = call("join", tmp_path / "run" / "maps", "--out", tmp_path / "run", "--force")
    assert done.returncode == 2 and "holds the input" in one_line(done.stderr)
    assert (tmp_path / "run" / "maps").exists()


def test_a_backend_that_nobody_knows_is_not_asked(log: Path, tmp_path: Path) -> None:
    """Figures are written and never shown."""
    done = call("run", log, "--out", tmp_path / "run", MPLBACKEND="nonsense")
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "run" / "figures" / "map.png").exists()


NASTY = ["$x{$", "[red]door[/red]", "a\nb", 'q"u,o;te', "naïve ☃ 門", "_hidden", ":smile:", "\x1b[31mred", "a/b", ".."]


def test_any_name_goes_through_every_command_and_terminal(tmp_path: Path) -> None:
    """Formulas, markup, line breaks, quotes, letters that a terminal or a font lacks."""
    names = Names({1: "[bold]$R^{$", 2: "_two", 3: "a/b\n☃"}, dict(enumerate(NASTY)), 1.0)
    write(replace(team("2d", poses=8, landmarks=len(NASTY), sees=0.8), names=names), tmp_path / "log", "plain")
    commands = [
        "info log",
        "run log --out run",
        "split log --out pieces",
        "build pieces --out submaps",
        "join submaps --out map --pieces pieces --truth log",
        "score run log",
        "exchange log --ledger ledger-ENCODING.csv",
    ]
    for encoding in ("utf-8", "ascii"):
        for command in (command.replace("ENCODING", encoding) for command in commands):
            if encoding == "ascii" and "--out" in command:
                continue  # written already
            done = call(*command.split(), cwd=tmp_path, PYTHONIOENCODING=encoding, TERM="dumb")
            assert (done.returncode, done.stderr) == (0, ""), command
            assert "[bold]$R^{$" in done.stdout or "--out" in command
            assert "\x1b" not in done.stdout and (encoding == "utf-8" or done.stdout.isascii())


def test_an_exhausted_memory_is_one_line(tmp_path: Path) -> None:
    done = call("simulate", tmp_path / "log", "--landmarks", 10**13)
    assert done.returncode == 2 and "not enough memory" in one_line(done.stderr)
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_ends_looks_nothing_through() -> None:
    """What is frozen no collection goes through; what was registered first is asked last."""
    asked = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count() > 10_000))\n"
    assert call("--version", code=asked + CALL).stdout.split()[-1] == "True"
