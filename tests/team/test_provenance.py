"""Nothing counts twice: each kind of double counting is refused, and shown to make the map surer than it is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from teamslam.errors import ModelError
from teamslam.joining import build, join, split
from teamslam.model import Dataset, Sources, Stretch, Submap
from teamslam.solver import Covariances
from teamslam.team import admit
from worlds import measure, team

RUNS = 40


def submaps_of(log: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(log, poses_per_piece=100)]


def a_team(seed: int) -> Dataset:
    return team("2d", robots=2, poses=5, landmarks=4, sees=0.8, sigma=0.01, sigma_odometry=0.01, seed=seed)


def as_if_new(submap: Submap, label: str) -> Submap:
    """The same content under another id, with rows nobody has seen and priors in other last digits: what a cheat or a
    bug would send."""
    moved = Sources(Stretch(s.robot, f"{s.source} {label}", s.start, s.stop) for s in submap.sources)
    raw = tuple(replace(table, values=table.values * (1.0 + 1e-12 * int(label))) for table in submap.raw)
    return replace(submap, id=f"{submap.id} {label}", sources=moved, raw=raw)


def sighting_in_two(log: Dataset) -> list[Submap]:
    """The landmark sightings of robot 1 went into its own submap and into one that robot 2 logged as its own."""
    tables = [replace(t, robot=2) for t in log.tables if t.robot == 1 and t.source != "robots"]
    borrowed = build(log.with_tables(replace(t, robot=1) for t in tables), id="borrowed")
    return [*submaps_of(log), borrowed]


def submap_in_two_branches(log: Dataset) -> list[Submap]:
    """Each branch of a tree holds one robot, and both hold a third submap: here robot 2's own once more."""
    first, second = submaps_of(log)
    branch = join([first, second]).map
    return [branch, replace(second, id="second branch")]


def prior_in_every_submap(log: Dataset) -> list[Submap]:
    """One survey of two landmarks, written into every robot's log."""
    rng = np.random.default_rng(int(1e6 * abs(log.tables[0].values[0, 0])))
    marks = log.landmark_keys[:3]
    survey = measure(1, "survey", "position", 2, marks[:, None], 0.03, log.truth, rng)
    return submaps_of(log.with_tables([*log.tables, survey, replace(survey, robot=2)]))


CHEATS: dict[str, Callable[[Dataset], list[Submap]]] = {
    "a sighting in two submaps": sighting_in_two,
    "a submap in two branches": submap_in_two_branches,
    "a prior in every submap": prior_in_every_submap,
}


@pytest.mark.parametrize("cheat", CHEATS)
def test_what_would_count_twice_is_refused(cheat: str) -> None:
    submaps = CHEATS[cheat](a_team(0))
    found = admit(submaps)
    assert len(found.refused) == 1
    assert "count twice" in found.refused[0].reason
    assert len(found.good) == len(submaps) - 1


@pytest.mark.parametrize("cheat", CHEATS)
def test_a_join_refuses_it_too(cheat: str) -> None:
    with pytest.raises(ModelError, match="count twice"):
        join(CHEATS[cheat](a_team(0)))


@pytest.mark.parametrize("cheat", CHEATS)
def test_counted_twice_the_map_would_be_too_sure_of_itself(cheat: str) -> None:
    """Over many runs the NEES of what is refused lies above its chi-square band; that of what is joined, within."""
    honest, cheating = [], []
    for seed in range(RUNS):
        log = a_team(seed)
        submaps = CHEATS[cheat](log)
        honest.append(nees(join(admit(submaps).good).map, log))
        cheating.append(nees(join([as_if_new(s, str(n)) for n, s in enumerate(submaps)]).map, log))
    assert within_band(honest)
    assert not within_band(cheating)
    assert ratio(cheating) > 1.2


def within_band(runs: list[tuple[float, int]]) -> bool:
    """Whether the sum of NEES fits its chi-square, with a twentieth for the curvature of the model."""
    total, unknowns = (sum(column) for column in zip(*runs, strict=True))
    law = stats.chi2(unknowns)
    return bool(law.ppf(1e-4) / 1.05 < total < law.ppf(1.0 - 1e-4) * 1.05)


def ratio(runs: list[tuple[float, int]]) -> float:
    total, unknowns = (sum(column) for column in zip(*runs, strict=True))
    return total / unknowns


def nees(submap: Submap, log: Dataset) -> tuple[float, int]:
    """e' P^-1 e of the landmarks in the map's frame, and how many numbers that is."""
    assert log.truth is not None
    truth = log.truth if submap.base < 0 else log.truth.transform(log.truth.pose(submap.base).inverse())
    marks = submap.landmark_keys
    error = submap.values.only(marks).minus(truth.only(marks))
    return float(error @ np.linalg.solve(Covariances.of_map(submap).joint(marks), error)), len(error)
