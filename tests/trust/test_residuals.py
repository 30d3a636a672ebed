"""Leverages against the hat matrix made densely, and the laws of residuals at a map."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.joining import build, full, join, split
from teamslam.joining.exact.gap import AtMap, point_of
from teamslam.model import Loss, Table, whitening
from teamslam.solver import linearise_numerically
from teamslam.trust import verdict
from teamslam.trust.residuals import in_parts, residuals_at, unwhitening
from worlds import WORLDS, team


def dense_leverages(table: Table, values, free, hessian_inverse) -> np.ndarray:
    """w tr(A H^-1 A') row by row, from Jacobians by differences."""
    out = np.zeros(len(table))
    for group in linearise_numerically(table, values):
        for row, e, jacobian in zip(group.rows, group.error, group.jacobian, strict=True):
            columns, at = [], 0
            for key in table.keys[row].tolist():
                dof = int(values.layout.dofs[values.layout.index(key)])
                if free.contains(key):
                    columns.append((free.unknowns(np.array([key])), jacobian[:, at : at + dof]))
                at += dof
            where = np.concatenate([c for c, _ in columns])
            A = np.concatenate([a for _, a in columns], 1)
            weight = table.loss.weight(np.array([e @ e]))[0]
            out[row] = weight * np.trace(A @ hessian_inverse[np.ix_(where, where)] @ A.T)
    return out


@pytest.mark.parametrize("loss", [Loss(), Loss("cauchy", 2.0)], ids=str)
@pytest.mark.parametrize("world", WORLDS)
def test_leverages_are_the_diagonal_of_the_hat_matrix(world: str, loss: Loss) -> None:
    """Of a problem with few unknowns they are exact; of a larger one, on average."""
    for size in (2, 10):
        log = team(world, robots=1, poses=size, landmarks=4, sees=1.0).with_loss(loss)
        joined = full(log).map
        found = residuals_at(AtMap(log.tables, joined))
        values, inverse = point_of(joined), np.linalg.inv(joined.information.toarray())
        for rows in found.rows:
            exact = dense_leverages(rows.table, values, joined.values.layout, inverse)
            if found.unknowns <= found.draws:
                np.testing.assert_allclose(rows.leverage, exact, rtol=1e-3, atol=1e-6)
            else:
                assert rows.leverage.sum() == pytest.approx(exact.sum(), rel=4.0 / np.sqrt(found.draws * len(rows)))


@pytest.mark.parametrize("world", WORLDS)
def test_leverages_add_up_to_the_unknowns(world: str) -> None:
    log = team(world, poses=25, landmarks=10)
    found = residuals_at(AtMap(log.tables, full(log).map))
    total = sum(rows.leverage.sum() for rows in found.rows)
    assert total == pytest.approx(found.unknowns, rel=1e-9)


@pytest.mark.parametrize("stiff", [1e3, 1e6])
def test_a_stiff_row_does_not_upset_what_is_expected(stiff: float) -> None:
    """Information of 1 beside 1e12: the loop has as many numbers to spare as ever, and a small cost is no misfit."""
    log = team("2d", robots=1, poses=4, landmarks=2, sees=1.0)
    first, *others = log.tables
    log = log.with_tables([replace(first, whitening=first.whitening * stiff), *others])
    found = verdict(log, full(log))
    assert found.expected == pytest.approx(found.dof, rel=1e-6)
    assert not found.gross


@pytest.mark.parametrize("world", WORLDS)
def test_residuals_are_those_of_the_tables(world: str) -> None:
    """Whitened, weighed and summed up as the map's own cost; rows of other variables are left out."""
    log = team(world).with_loss(Loss("huber", 1.0))
    joined = full(log).map
    found = residuals_at(AtMap(log.tables, joined))
    for rows, table in zip(found.rows, log.tables, strict=True):
        np.testing.assert_allclose(rows.whitened, table.whitened(point_of(joined)), rtol=1e-9, atol=1e-12)
    assert found.cost.cost == pytest.approx(joined.cost, rel=1e-9)
    assert found.cost.rows == log.dof
    one = build(split(log)[0])
    here = residuals_at(AtMap(log.tables, one))
    assert {rows.table.robot for rows in here.rows} == {1}


def test_a_step_to_full_least_squares_promises_what_it_takes() -> None:
    """At the optimum nothing; at a join what exactness says it is."""
    log = team("2d", sigma=0.1, sigma_odometry=0.1)
    best, joined = full(log), join([build(piece) for piece in split(log)])
    assert residuals_at(AtMap(log.tables, best.map)).decrease < 1e-9
    found = residuals_at(AtMap(log.tables, joined.map))
    assert 0.0 < found.decrease == pytest.approx(found.cost.cost - best.map.cost, rel=0.2)


def test_parts_are_in_the_units_of_the_measurement() -> None:
    """Correlated noise: each part of W^-1 u over its own standard deviation."""
    covariance = np.array([[0.04, 0.03], [0.03, 0.09]])
    table = Table(
        1, "landmarks", "point", 2, np.zeros((3, 2), int), np.zeros((3, 2)), whitening(covariance)[None], np.arange(3)
    )
    e = np.array([[0.2, 0.0], [0.0, 0.3], [-0.4, 0.6]])
    u = e @ whitening(covariance).T
    np.testing.assert_allclose(in_parts(u, unwhitening(table)), e / [0.2, 0.3], atol=1e-12)
