"""Every command explains itself with worked examples; wrong calls and wrong input end with code 2 and one message."""

import subprocess
import sys
from pathlib import Path

import pytest

from teamslam.cli.app import app

COMMANDS = sorted(name for name in app if not name.startswith("-"))


def test_help_names_every_command_and_the_exit_codes(teamslam) -> None:
    """A newcomer finds the way in."""
    called = teamslam("--help")
    assert called.code == 0
    for word in (*COMMANDS, "Exit codes", "teamslam demo"):
        assert word in called.out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_worked_examples_and_exit_codes(teamslam, command: str) -> None:
    """Help shows at least one whole call, and what the exit codes mean."""
    called = teamslam(command, "--help")
    assert called.code == 0
    assert f"\n teamslam {command}" in called.out
    assert "Exit codes:" in called.out


def test_version_is_the_packages(teamslam) -> None:
    """One number, in one place."""
    from importlib.metadata import version

    import teamslam as package

    assert teamslam("--version").out.strip() == package.__version__ == version("teamslam")


def test_help_loads_no_heavy_package() -> None:
    """Neither numpy nor matplotlib is needed to print help."""
    code = (
        "import sys\nfrom teamslam.cli import main\n"
        "try:\n    main(['run', '--help'])\nexcept SystemExit:\n    pass\n"
        "print('HEAVY', sorted({'numpy', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "HEAVY []" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ruin"], ["ruin"]),
        (["run"], ["run"]),
        (["run", "x", "--ou", "y"], ["--out"]),
        (["run", "x", "--metod", "full"], ["mean --method? See: teamslam run --help"]),
        (["run", "nowhere", "--out", "y"], ["nowhere", "no such file"]),
        (["info", "nowhere"], ["nowhere", "no such file"]),
        (["info", "."], ["none of the formats", "mrclam"]),
        (["convert", "nowhere", "x"], ["nowhere"]),
        (["score", "nowhere", "x"], ["nowhere"]),
        (["plot", "nowhere"], ["nowhere", "teamslam run"]),
        (["plot", "nowhere", "--type", "gif"], ["gif", "png, pdf or svg"]),
        (["run", "nowhere", "--out", "y", "--method", "gues"], ["gues", "join, full"]),
        (["run", "nowhere", "--out", "y", "--loss", "hub"], ["hub", "huber"]),
        (["run", "nowhere", "--out", "y", "--loss-scale", "2"], ["--loss"]),
        (["run", "nowhere", "--out", "y", "--gap", "1e-3"], ["--exact"]),
        (["run", "nowhere", "--out", "y", "--exact", "--gap", "-1"], ["gap is above 0", "-1"]),
        (["run", "nowhere", "--out", "y", "--loss", "huber", "--loss-scale", "-2"], ["scale", "-2"]),
        (["run", "nowhere", "--out", "y", "--config", "none.toml"], ["none.toml"]),
    ],
)
def test_bad_calls_end_with_code_2_and_one_message(
    teamslam, arguments: list[str], words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was found and what to do, on stderr, without a traceback; nothing is written."""
    monkeypatch.chdir(tmp_path)
    called = teamslam(*arguments)
    assert called.code == 2
    for word in words:
        assert word in called.err
    assert "Traceback" not in called.err and called.out == ""
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_cannot_be_written_is_one_message(teamslam, tmp_path: Path) -> None:
    """A file where a folder should be: code 2, no traceback, nothing half."""
    (tmp_path / "file").write_text("x")
    called = teamslam("paper", "--runs", "1", "--poses", "4", "--out", tmp_path / "file" / "deeper")
    assert called.code == 2 and "file" in called.err and "Traceback" not in called.err
