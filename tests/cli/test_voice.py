"""How much commands say: -q, -v and --json hold for every command, and the shell completes them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from teamslam import __version__
from teamslam.cli.app import app
from teamslam.io import write
from worlds import team

COMMANDS = sorted(name for name in app if not name.startswith("-"))
CALLS = {
    "info": "info log",
    "run": "run log --out OUT --no-figures",
    "simulate": "simulate OUT --poses 6",
    "convert": "convert log OUT.jrl",
    "score": "score RUN log",
    "plot": "plot RUN --out OUT",
    "split": "split log --out OUT",
    "build": "build log --out OUT",
    "join": "join RUN/maps --out OUT --no-figures",
    "exchange": "exchange log",
    "paper": "paper --runs 1 --poses 4 --out OUT",
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from teamslam.cli import main

    folder = tmp_path_factory.mktemp("voice")
    write(team("2d", robots=2, poses=10), folder / "log", "plain")
    assert main(["run", str(folder / "log"), "--out", str(folder / "RUN"), "--no-figures", "-q"]) == 0
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_them(teamslam, command: str) -> None:
    called = teamslam(command, "--help")
    for word in ("--quiet", "-q", "--verbose", "-v", "--json"):
        assert word in called.out


@pytest.mark.parametrize("command", CALLS)
def test_quiet_is_silent_verbose_talks_beside_and_json_is_one_document(
    teamslam, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(place)

    def call(n: int, *flags: str):
        return teamslam(*CALLS[command].replace("OUT", str(tmp_path / f"out{n}")).split(), *flags)

    plain, quiet, verbose, data = call(0), call(1, "-q"), call(2, "-v"), call(3, "--json")
    assert {plain.code, quiet.code, verbose.code, data.code} == {plain.code}
    assert (quiet.out, quiet.err) == ("", "") and plain.out and plain.err == ""
    assert f"teamslam {__version__}: {command}" in verbose.err and f"{command} took" in verbose.err
    assert len(verbose.out.splitlines()) == len(plain.out.splitlines())
    document = json.loads(data.out)
    assert isinstance(document, dict) and document and data.err == ""
    for written in [document["written"]] if isinstance(document.get("written"), str) else document.get("written", []):
        assert Path(written).exists()


def test_json_says_what_the_table_says(teamslam, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    found = json.loads(teamslam("info", "log", "--json").out)
    assert found["robots"] == {"1": {"dim": 2, "poses": 10}, "2": {"dim": 2, "poses": 10}} and found["truth"]
    (part,) = json.loads(teamslam("score", "RUN", "log", "--json").out)["components"]
    assert f"{part['landmark_rmse_m']:.4f}" in teamslam("score", "RUN", "log").out
    sent = json.loads(teamslam("exchange", "log", "--json").out)
    assert sent["bytes"] == sum(message["bytes"] for message in sent["messages"]) > 0


def test_an_error_under_json_leaves_stdout_empty(teamslam) -> None:
    called = teamslam("info", "nowhere", "--json")
    assert called.code == 2 and called.out == "" and "no such file" in called.err


def test_verbose_names_the_stages_of_a_run(teamslam, place: Path, tmp_path: Path) -> None:
    said = teamslam("run", place / "log", "--out", tmp_path / "run", "--no-figures", "-v").err
    for stage in ("reading", "building submaps", "joining submaps", "verdict on the fit", "score"):
        assert f"{stage} ..." in said


def test_the_module_is_the_command() -> None:
    for arguments in (["--version"], ["info", "nowhere"], ["--help"]):
        module, command = (
            subprocess.run([*how, *arguments], capture_output=True, text=True)
            for how in ([sys.executable, "-m", "teamslam"], [Path(sys.executable).parent / "teamslam"])
        )
        assert (module.returncode, module.stdout, module.stderr) == (command.returncode, command.stdout, command.stderr)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_completes_commands_and_options(tmp_path: Path, shell: str) -> None:
    """What is installed names them all; bash itself is asked where it is there."""
    done = subprocess.run(
        [sys.executable, "-m", "teamslam", "--install-completion", "--shell", shell],
        env={**os.environ, "HOME": str(tmp_path), "SHELL": f"/bin/{shell}", "ZDOTDIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    scripts = [path.read_text() for path in tmp_path.rglob("*teamslam*") if path.is_file()]
    assert scripts and all(name in scripts[0] for name in (*COMMANDS, "json", "no-figures"))
