"""A finished run of a small simulated team, in each kind of world, as it is kept."""

import pytest

from teamslam.pipeline import Result, run
from teamslam.results import Record
from worlds import WORLDS, team


def finished(world: str, **options: object) -> Result:
    """A run on a small team."""
    return run(team(world, **options))  # type: ignore[arg-type]


@pytest.fixture(scope="session", params=WORLDS)
def result(request: pytest.FixtureRequest) -> Result:
    """One run for each world, made once."""
    return finished(request.param)


@pytest.fixture(scope="session")
def record(result: Result) -> Record:
    """What is kept of it."""
    return Record.of(result)
