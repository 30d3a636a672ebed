"""What other packagers say of teamslam is what pyproject.toml says."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RECIPE = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text()
NAMES = {"matplotlib": "matplotlib-base"}
"""conda-forge's names of packages that are called otherwise there."""


def listed(section: str) -> set[str]:
    """The entries of one list of the recipe, as `name>=version`."""
    found = re.search(rf"^  {section}:\n((?:    - .*\n)+)", RECIPE, re.MULTILINE)
    assert found, section
    return {line.removeprefix("    - ").replace(" ", "") for line in found[1].splitlines()}


def renamed(requirement: str) -> str:
    name, bound = re.fullmatch(r"([\w-]+)(>=[\d.]+)", requirement).groups()  # type: ignore[union-attr]
    return NAMES.get(name, name) + bound


def test_the_conda_recipe_needs_what_the_package_needs() -> None:
    project = PROJECT["project"]
    assert listed("run") == {renamed(each) for each in project["dependencies"]} | {
        "python" + project["requires-python"]
    }
    builds = {renamed(each) for each in PROJECT["build-system"]["requires"]}
    assert builds <= listed("build") | listed("host")
    assert f'version: "{project["version"]}"' in RECIPE


def test_the_image_installs_extras_that_there_are_and_is_given_all_sources() -> None:
    lines = (ROOT / "Dockerfile").read_text()
    extras = re.search(r"/source\[([\w,-]+)\]", lines)
    assert extras
    assert set(extras[1].split(",")) <= set(PROJECT["project"]["optional-dependencies"])
    given = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    assert given == {"CMakeLists.txt", "LICENSE", "README.md", "cpp", "pyproject.toml", "src"}
    assert all((ROOT / each).exists() for each in given)


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
def test_every_python_that_is_promised_is_named_where_it_is_tried(python: str) -> None:
    assert f"Programming Language :: Python :: {python}" in PROJECT["project"]["classifiers"]
    assert f'"{python}"' in (ROOT / ".github" / "workflows" / "check.yml").read_text()
