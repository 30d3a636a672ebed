"""Where odometry's noise alone changes, what it leaves is asked of its rows alone: the same as of all of them."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.joining import AtMap, full
from teamslam.model import Dataset, Loss
from teamslam.trust.calibration.choice import Choice
from teamslam.trust.calibration.components import Components, Pulls
from teamslam.trust.calibration.estimate import searched
from teamslam.trust.calibration.products import by_rows, inverse_of_lower
from teamslam.trust.calibration.rows import linear_at
from trust.calibration.faulty import persistent, team, veering

SOME = np.random.default_rng(5)


@pytest.mark.parametrize("loss", [Loss(), Loss("cauchy", 2.0)], ids=str)
@pytest.mark.parametrize("odometry", [False, True], ids=["sightings", "all rows"])
def test_rows_of_odometry_are_left_what_a_fit_of_all_rows_leaves(loss: Loss, odometry: bool) -> None:
    _agree(_log().with_loss(loss, odometry=odometry))


def test_so_they_are_where_there_are_no_others() -> None:
    """Robots that meet as they measure their own motion: all noise changes."""
    log = team(2, model="relative_pose")
    tables = (replace(t, source="odometry") for t in log.tables if t.source != "landmarks")
    _agree(log.with_tables(tables))


def _agree(log: Dataset) -> None:
    search, _ = searched(linear_at(AtMap(log.tables, full(log).map)))
    inside = np.arange(0, len(search.linear.columns), 2)  # of odometry and of sightings
    choice = Choice(inside, np.full(len(inside), 0.3))
    scales = [s if slip is None else s * [1.3, 0.8, 1.1] for s, slip in zip(search.scales, search.slips, strict=True)]
    theta, free = np.array([1e-4, 2e-4]), Components.of(search.slips, scales)
    pulls, information = search.pulled(choice, free, scales, theta)
    whole = search.fit(choice=choice)
    left = search._left(whole)
    expected = Pulls.of(free, search.slips, search.now, scales, theta, left)
    along = expected.along
    assert len(free) >= 5
    np.testing.assert_allclose(pulls.squares, expected.squares, rtol=1e-8)
    wanted = 0.5 * along.T @ (whole.weight @ whole.left(along))
    np.testing.assert_allclose(information, wanted, rtol=1e-7, atol=1e-8 * np.abs(wanted).max())


def test_pulls_are_what_their_components_make_of_the_noise() -> None:
    """Q is how -l'Cl falls with phi, C the covariance and l what it makes of what is left: by differences."""
    search, _ = searched(linear_at(AtMap(_log().tables, full(_log()).map)))
    scales, theta = search.scales, np.array([1e-4, 2e-4])
    free, step = Components.of(search.slips, scales), 1e-5
    left = search._left(search.fit())
    search.scales, search.theta = scales, theta
    search._move()
    found = Pulls.of(free, search.slips, search.now, scales, theta, left).squares
    at = free.logs(scales, theta)
    for k in range(len(free)):
        sums = []
        for sign in (1.0, -1.0):
            logs = at + sign * step * (np.arange(len(free)) == k)
            moved, slipping = free.put(logs, scales, theta)
            total = 0.0
            for slip, scale, each, noise in zip(search.slips, moved, left, search.now, strict=True):
                if slip is not None:
                    inverse = np.swapaxes(noise.whitening, 1, 2) @ noise.whitening
                    pull = (inverse @ each) * slip.moving[:, None, None]
                    total = total + np.sum(pull * (slip.covariance(scale, slipping) @ pull), (0, 1))
            sums.append(total)
        np.testing.assert_allclose(found[k], (sums[0] - sums[1]) / (2.0 * step), rtol=1e-6)


def test_products_row_by_row() -> None:
    for m, r, k in ((1, 1, 1), (7, 3, 4), (5, 8, 1)):
        numbers = SOME.standard_normal((m, r, k))
        for matrices in (SOME.standard_normal((m, r, r)), SOME.standard_normal((1, r, r))):
            np.testing.assert_allclose(by_rows(matrices, numbers), matrices @ numbers, atol=1e-14)
        lower = np.tril(SOME.standard_normal((m, r, r))) + 3.0 * np.eye(r)
        np.testing.assert_allclose(inverse_of_lower(lower) @ lower, np.broadcast_to(np.eye(r), (m, r, r)), atol=1e-9)


def _log() -> Dataset:
    return persistent(veering(team(2), np.random.default_rng(2)), 0.9)
