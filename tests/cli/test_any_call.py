"""Any call at all, of words and numbers that make little sense, ends with a code and one message: never a traceback,
never something half-written, and never is anything lost that was there."""

import contextlib
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.cli import main

PATHS = (
    "log", "one", "pieces", "submaps", "run", "empty", "file.txt", "rubbish.bin", "void.csv", "exact.toml",
    "wrong.toml", "nowhere", "/dev/null", ".", "..", "/", "", "run/report.json", "run/maps", "pieces/1_robot_1.piece",
    "log/team.toml", "~", "log/", "a" * 300, "\udcff\udcfe", "log\nx", "[red]",
)  # fmt: skip
PLACES = tuple(path for path in PATHS if not path.startswith(("/", "..")))  # to write to
NUMBERS = (
    "0", "1", "2", "3", "-1", "-0", "nan", "inf", "-inf", "1e-300", "1e300", "1e400", "0.5", "1.5", "", "x", "٣", "1_0",
    "99999999999999999999999", "2147483648", "0x10", "1e-9", " 3",
)  # fmt: skip
WORDS = (
    "", "join", "full", "huber", "cauchy", "squared", "plain", "g2o", "jrl", "pyfg", "mrclam", "png", "pdf", "planar",
    "2d", "3d", "paper", "circles", "star", "all", "1", "1/0", "ß", "--", "-", "[red]",
)  # fmt: skip
FEW = ("0", "1", "2", "5", "-1", "nan", "x")
NEW = ("new", "new.g2o", "new.jrl", "new.pyfg")
COMMANDS: dict[str, tuple[tuple[str, ...], dict[str, tuple[str, ...]]]] = {
    "run": (("log", "one"), {
        "--method": WORDS, "--exact": (), "--gap": NUMBERS, "--loss": WORDS, "--loss-scale": NUMBERS, "--config": PATHS,
        "--format": WORDS, "--force": (), "-q": ()}),
    "join": (("submaps", "run/maps"), {"--truth": PATHS, "--pieces": PATHS, "--without": WORDS, "--force": ()}),
    "build": (("pieces", "log"), {"--version": NUMBERS, "--poses-per-piece": NUMBERS, "--format": WORDS, "-q": ()}),
    "split": (("log", "one"), {"--poses-per-piece": NUMBERS, "--keyframe": NUMBERS, "--format": WORDS}),
    "exchange": (("log", "one"), {
        "--topology": WORDS, "--shift": NUMBERS, "--information": NUMBERS, "--to-the-bit": (), "--landmarks": (),
        "--keyframe": NUMBERS, "--poses-per-piece": NUMBERS, "--ledger": (*PLACES, "new")}),
    "info": (("log", "one"), {"--format": WORDS}),
    "score": (("run", "submaps", "log"), {}),
    "plot": (("run",), {"--type": WORDS, "--dpi": NUMBERS}),
    "convert": (("log", "one", "run"), {"--to": WORDS, "--format": WORDS}),
    "simulate": ((), {
        "--preset": WORDS, "--seed": NUMBERS, "--robots": NUMBERS, "--poses": FEW, "--landmarks": NUMBERS,
        "--path": WORDS, "--outliers": NUMBERS, "--dropouts": NUMBERS, "--sigma-observation": NUMBERS, "--to": WORDS}),
}  # fmt: skip


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with an example of everything that a command takes, and of what none takes."""
    folder, before = tmp_path_factory.mktemp("world"), Path.cwd()
    os.chdir(folder)
    for call in (
        "simulate log --preset 2d --robots 2 --poses 5 --landmarks 6",
        "simulate one --preset 2d --robots 1 --poses 4 --landmarks 0",
        "split log --out pieces",
        "build pieces --out submaps",
        "run log --out run --no-figures",
    ):
        assert called(call.split())[0] == 0, call
    Path("empty").mkdir()
    Path("file.txt").write_text("rubbish 1 2 3\n")
    Path("rubbish.bin").write_bytes(bytes(range(256)))
    Path("void.csv").write_text("")
    Path("exact.toml").write_text("[join]\nexact = true\n")
    Path("wrong.toml").write_text("[join]\nexct = true\n")
    yield folder
    os.chdir(before)


def called(arguments: list[str]) -> tuple[int, str, str]:
    """Exit code, output and complaints of a call."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(arguments)
    return code, out.getvalue(), err.getvalue()


@st.composite
def calls(draw: st.DrawFn) -> list[str]:
    """A command with more or less what it takes, and any options of its own."""
    command = draw(st.sampled_from(sorted(COMMANDS)))
    takes, options = COMMANDS[command]
    call = [command]
    if takes:
        call.append(draw(st.sampled_from(takes) | st.sampled_from(PATHS)))
    if command in ("score", "join", "build") and draw(st.booleans()):
        call.append(draw(st.sampled_from(takes) | st.sampled_from(PATHS)))
    if command in ("convert", "simulate"):
        call.append(draw(st.sampled_from(NEW) | st.sampled_from(PLACES)))
    if command in ("run", "join", "build", "split", "plot"):
        call += ["--out", draw(st.sampled_from(NEW[:1]) | st.sampled_from(PLACES))]
    if command in ("run", "join"):
        call.append("--no-figures")
    for option in draw(st.lists(st.sampled_from(sorted(options)), unique=True, max_size=3)) if options else ():
        call += [option, *([draw(st.sampled_from(options[option]))] if options[option] else [])]
    return call


@settings(max_examples=60)
@given(call=calls())
def test_any_call_ends_in_words(world: Path, call: list[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in world.iterdir()}
    try:
        code, out, err = called(call)
    finally:
        fresh = [path for path in world.iterdir() if path not in before]
        for path in fresh:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert code in (0, 1, 2, 3, 4)
    assert "Traceback" not in err and not any(path.name.startswith(".") for path in fresh)
    assert all(path.exists() for path in before)
    if code == 2:
        assert err.startswith("teamslam: ") and out == "" and not fresh
