"""The face: a dozen names or so, each documented, each imported when it is first used."""

import re
import subprocess
import sys

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


@pytest.mark.parametrize("module", ["teamslam.pipeline", "teamslam.results", "teamslam.cli.app"])
def test_the_whole_story_loads_only_what_it_surely_needs(module: str) -> None:
    """scipy.stats alone takes longer to import than a small team to map; the rest is loaded where it is used."""
    late = "{'scipy.stats', 'scipy.spatial', 'scipy.optimize', 'scipy.linalg', 'scipy.sparse.csgraph', 'matplotlib'}"
    code = f"import sys, {module}\nprint(sorted({late} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_example_in_the_documentation_names_only_what_is_there() -> None:
    """ts.something is exported."""
    used = set(re.findall(r"\bts\.(\w+)", teamslam.__doc__ or ""))
    assert used and used <= set(teamslam.__all__)
