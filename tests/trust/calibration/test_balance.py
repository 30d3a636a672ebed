"""Odometry's variance components settle where their restricted scores vanish, wherever the search for them began."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import teamslam as ts
from teamslam.joining import AtMap, full
from teamslam.model import Dataset
from teamslam.trust.calibration.components import Components
from teamslam.trust.calibration.estimate import searched
from teamslam.trust.calibration.rows import linear_at
from trust.calibration.faulty import misstated, persistent, team, veering

STARTS = (0.1, 10.0)  # of each variance, times what was found
SHARE = 0.5  # of a component's own deviation


def _settles_from_anywhere(log: Dataset) -> None:
    search, fit = searched(linear_at(AtMap(log.tables, full(log).map)))
    choice, before = fit.choice, search.scales
    search.balance(choice)
    scales, theta = search.scales, search.theta
    free = Components.of(search.slips, scales)
    free = free.only(np.append(np.ones(len(free.scaled), bool), theta > 0.0))
    found = free.logs(scales, theta)
    doubt = np.sqrt(np.diag(np.linalg.inv(search.pulled(choice, free, scales, theta)[1])))
    scaled = len(free.scaled)
    assert (np.abs(free.logs(before, theta) - found) < SHARE * doubt)[:scaled].all()  # whatever came after it
    for times in STARTS:
        moved = [s if slip is None else s * np.sqrt(times) for s, slip in zip(scales, search.slips, strict=True)]
        search.scales, search.theta = moved, theta * times
        search.balance(choice)
        assert ((search.theta > 0.0) == (theta > 0.0)).all()
        assert (np.abs(free.logs(search.scales, search.theta) - found) < SHARE * doubt).all()


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param(lambda log: misstated(log, 1.0 / 3.0, odometry=True), id="sigmas three times too small"),
        pytest.param(lambda log: veering(log, np.random.default_rng(1)), id="turns nobody stated"),
        pytest.param(lambda log: persistent(veering(log, np.random.default_rng(2)), 0.9), id="beside errors that last"),
    ],
)
def test_where_the_search_began_does_not_matter(plant: Callable[[Dataset], Dataset]) -> None:
    _settles_from_anywhere(plant(team(1)))


@pytest.mark.parametrize("name", ["mrclam_6", "mrclam_7"])
def test_nor_does_it_in_logs_of_real_robots(data: Callable[[str], Path], name: str) -> None:
    _settles_from_anywhere(ts.read(data(name)))
