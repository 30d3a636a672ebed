"""The face: a dozen names or so, each documented, each imported when it is first used."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import teamslam


def documented() -> set[str]:
    """The names in the first column of the table in the package's documentation."""
    rows = [line for line in (teamslam.__doc__ or "").splitlines() if line.startswith("| ")][1:]
    return {name.strip() for row in rows for name in row.split("|")[1].split(",")}


def test_what_is_exported_is_what_is_documented() -> None:
    """No name without a word about it, no word about a name that is not there."""
    assert documented() == set(teamslam.__all__)
    assert sorted(teamslam.__all__) == teamslam.__all__


@pytest.mark.parametrize("name", teamslam.__all__)
def test_every_name_is_there_and_explains_itself(name: str) -> None:
    """With a documentation of its own."""
    found = getattr(teamslam, name)
    assert name in dir(teamslam)
    assert (found.__doc__ or "").strip()


def test_an_unknown_name_is_refused_with_those_there_are() -> None:
    """As any module does, and with help."""
    with pytest.raises(AttributeError, match=r"offers .*Dataset"):
        teamslam.Datset  # noqa: B018


def test_importing_the_package_loads_nothing_heavy() -> None:
    """Names are imported on first use; matplotlib never, until a figure is drawn."""
    code = (
        "import sys, teamslam\nheavy = {'numpy', 'scipy', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))\nteamslam.join, teamslam.run, teamslam.read\n"
        "print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", "False"]


@pytest.mark.parametrize("module", ["teamslam.pipeline", "teamslam.results", "teamslam.cli.app", "teamslam.joining"])
def test_the_whole_story_loads_only_what_it_surely_needs(module: str) -> None:
    """scipy.stats alone takes longer to import than a small team to map; the rest is loaded where it is used, what
    scipy.sparse takes along of numpy as well."""
    parts = ("stats", "special", "spatial", "optimize", "linalg", "sparse.csgraph")
    late = {"matplotlib", "numpy.f2py", "numpy.testing", *(f"scipy.{part}" for part in parts)}
    code = f"import sys, {module}\nprint(sorted({late} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_numpy_is_whole_once_scipy_is_loaded() -> None:
    """Who asks for what scipy.sparse was loaded without is given it, by name, by a star and in a list of names."""
    code = (
        "import teamslam.model, numpy\nnumpy.testing.assert_equal(1, 1)\nprint(*{'f2py', 'testing'} - {*dir(numpy)})\n"
        "from numpy import *\ntesting.assert_equal(1, 1)\nprint(f2py.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["numpy.f2py"]


def test_the_example_in_the_documentation_names_only_what_is_there() -> None:
    """ts.something is exported."""
    used = set(re.findall(r"\bts\.(\w+)", teamslam.__doc__ or ""))
    assert used and used <= set(teamslam.__all__)


FUNCTIONS = [name for name in teamslam.__all__ if name.islower()]
FIRST = {name: () for name in FUNCTIONS} | {  # what the other arguments are, where there must be some
    "score": (None,), "verdict": (None,), "write": ("x",), "write_run": ("x",), "write_submaps": ("x",)
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("given", [None, 5, 2.5, ["x"], object(), {}], ids=lambda given: type(given).__name__)
def test_what_is_something_else_gets_a_sentence(name: str, given: object, tmp_path: Path) -> None:
    """Whatever is handed to a function in place of what it takes: what was expected, and what was found."""
    with pytest.raises(teamslam.TeamslamError, match=r"expected .*found (nothing|an? \w+)|nothing to join"):
        getattr(teamslam, name)(given, *(tmp_path / "x" if other == "x" else other for other in FIRST[name]))
    assert not any(tmp_path.iterdir())


def test_neighbours_in_the_story_are_told_apart(tmp_path: Path) -> None:
    """A path for a log, a log for submaps, a run for a map or a join, no truth, a word for a number."""
    log = teamslam.simulate("2d", robots=2, poses=6)
    team = teamslam.run(log)
    for call, words in {
        lambda: teamslam.build("two"): "expected a piece of a log .*ts.split.*found a str",
        lambda: teamslam.split("two"): "expected a log .*ts.read.*found a str",
        lambda: teamslam.full("two"): "expected a log .*ts.read.*found a str",
        lambda: teamslam.join(log): "expected submaps .*ts.build.*found a Dataset",
        lambda: teamslam.join(team.map): "expected submaps .*in a list, found a Submap",
        lambda: teamslam.score(team, log.truth): "expected a map .*team.map.*found a Result",
        lambda: teamslam.score(team.map, None): "expected a truth .*log.truth.*found nothing",
        lambda: teamslam.verdict(log, team): "expected what ts.join.*run.verdict.*found a Result",
        lambda: teamslam.write(team, tmp_path / "x"): "expected a log .*found a Result",
        lambda: teamslam.write_run(team.joined, tmp_path / "x"): "expected a run .*found a Joined",
        lambda: teamslam.simulate("2d", robots="three"): "'robots': expected a number, such as .*found a str",
    }.items():
        with pytest.raises(teamslam.TeamslamError, match=words):
            call()
