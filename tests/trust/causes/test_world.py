"""Rows of the world in other units, mirrored or of another world are named, beside a map that is right without them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from teamslam.geometry import Array, rotations
from teamslam.model import Dataset, Table, is_landmark
from teamslam.pipeline import run
from teamslam.sim import simulate
from teamslam.trust.cause import Cause
from teamslam.trust.causes.world import mistakes_in_the_world
from thinned import thinned

SIGMA = 0.02
NORTH_FIRST = [1, 0, 2]

PLANTS: dict[str, tuple[str, str, Callable[[Array], Array]]] = {
    "feet": ("unit", "feet", lambda z: z / 0.3048),
    "millimetres": ("unit", "millimetres", lambda z: z * 1e3),
    "mirrored": ("axes", "left and right", lambda z: z * np.where(np.arange(z.shape[-1]) == 1, -1.0, 1.0)),
    "north": ("axes", "left and right", lambda z: z[:, NORTH_FIRST[: z.shape[-1]]]),
    "both": ("unit", "left and right", lambda z: 100.0 * z[:, NORTH_FIRST[: z.shape[-1]]]),
}


def surveyed(log: Dataset, seed: int, count: int = 14, sigma: float = SIGMA) -> tuple[Dataset, Table]:
    """A log with a survey of some of its landmarks in its truth's frame, written down by its first robot; and the
    survey."""
    rng = np.random.default_rng([seed, 14])
    keys = log.truth.layout.keys
    seen = np.unique(np.concatenate([t.keys[:, -1] for t in log.tables]))
    marks = rng.permutation(keys[is_landmark(keys) & np.isin(keys, seen)])[:count]
    dim = max(t.dim for t in log.tables if is_landmark(t.keys[:, -1]).any())
    places = log.truth.positions(marks, dim)
    table = Table(
        min(log.robots), "survey", "position", dim, marks[:, None], places + sigma * rng.normal(size=places.shape),
        np.eye(dim)[None] / sigma, np.arange(len(marks)),
    )  # fmt: skip
    return log.with_tables([*log.tables, table]), table


def told(log: Dataset, survey: Table) -> list[Cause]:
    return mistakes_in_the_world(log.with_tables([*log.tables, survey]))


@pytest.mark.parametrize("preset", ["2d", "planar", "3d", "lidar"])
@pytest.mark.parametrize("plant", PLANTS)
def test_what_was_written_otherwise_is_named_and_undone(preset: str, plant: str) -> None:
    """By the map of the rest, whatever frame the world has; undone, it is the survey up to a turn of the world."""
    kind, words, fault = PLANTS[plant]
    log = simulate(preset, 5)
    _, survey = surveyed(log, 5)
    (cause,) = told(log, replace(survey, values=fault(survey.values)))
    assert cause.kind == kind and words in cause.sentence and cause.explains > 0.8, cause.sentence
    assert cause.mend is not None
    (mended,) = (t for t in cause.mend(log.with_tables([replace(survey, values=fault(survey.values))])).tables)
    between = [np.linalg.norm(v[:, None] - v[None], axis=-1) for v in (mended.values, survey.values)]
    np.testing.assert_allclose(between[0], between[1], atol=1e-9)


def test_two_worlds_are_told_apart() -> None:
    """A survey in the truth's frame, and fixes of another robot in one that is turned and far away."""
    log = simulate("2d", 6)
    _, survey = surveyed(log, 6, 20)
    _, fixes = surveyed(log, 7, 12)
    away = fixes.values @ rotations(2).exp(np.array([[0.7]]))[0].T + np.array([400.0, -250.0])
    fixes = replace(fixes, robot=2, source="fixes", values=away)
    (cause,) = told(log.with_tables([*log.tables, survey]), fixes)
    assert cause.kind == "frame" and cause.robots == (2,) and "another world" in cause.sentence
    assert cause.mend is not None
    mended = cause.mend(log.with_tables([*log.tables, survey, fixes]))
    result = run(mended)
    assert result.verdict.level == "fits"


@pytest.mark.parametrize("preset", thinned(3, ["2d", "planar", "3d", "lidar"]))
@pytest.mark.parametrize("noise", [0.2, 1.0, 5.0])
def test_an_honest_survey_has_none(preset: str, noise: float) -> None:
    """Nor has one that is noisier than stated, or of which one place is wrong."""
    log = simulate(preset, 8)
    _, survey = surveyed(log, 8, sigma=noise * SIGMA)
    survey = replace(survey, whitening=np.eye(survey.dim)[None] / SIGMA)
    assert not told(log, survey)
    values = survey.values.copy()
    values[0, :2] += [1.5, -1.0]
    assert not told(log, replace(survey, values=values))


@pytest.mark.parametrize("seed", thinned(2, range(4)))
def test_of_a_wrong_place_in_a_survey_no_robot_is_accused(seed: int) -> None:
    """It is said to be what does not fit, and the robot that wrote it down measured nothing wrong."""
    log = simulate("2d", seed)
    _, survey = surveyed(log, seed)
    values = survey.values.copy()
    values[:1] += [1.5, -1.0]
    result = run(log.with_tables([*log.tables, replace(survey, values=values)]))
    assert result.verdict.level == "misfit"
    (cause,) = result.verdict.causes
    assert cause.kind == "outliers" and cause.sentence.startswith("1 sighting is wrong"), cause.sentence
    assert result.suspicions is not None and not list(result.suspicions.sentences())


def test_a_run_says_so_where_its_map_is_not_to_be_believed() -> None:
    """In feet: the run ends in a misfit with that cause, and accuses nobody; with it undone, it fits."""
    log = simulate("2d", 1)
    _, survey = surveyed(log, 1)
    wrong = log.with_tables([*log.tables, replace(survey, values=survey.values / 0.3048)])
    result = run(wrong)
    assert result.verdict.level == "misfit"
    (cause,) = result.verdict.causes
    assert cause.kind == "unit" and "feet" in cause.sentence and cause.mend is not None
    assert result.suspicions is None or not list(result.suspicions.sentences())
    assert run(cause.mend(wrong)).verdict.level == "fits"
