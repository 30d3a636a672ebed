"""Graduated non-convexity: planted outliers are found, good rows kept, and the estimate is that of the inliers."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.model import Dataset
from teamslam.solver import System, optimise, optimise_graduated
from worlds import WORLDS, team


def planted(world: str, share: float, seed: int) -> tuple[Dataset, list[int], list[np.ndarray]]:
    """A team whose landmark sightings are wrong by metres in a share of rows; the tables concerned, and which rows."""
    dataset = team(world, poses=15, landmarks=8, sees=0.6, sigma=0.05, seed=seed)
    rng = np.random.default_rng(seed)
    tables, suspects, wrong = list(dataset.tables), [], []
    for number, table in enumerate(tables):
        if table.source == "landmarks":
            bad = rng.random(len(table)) < share
            far = rng.uniform(2.0, 5.0, table.values.shape) * rng.choice([-1.0, 1.0], table.values.shape)
            tables[number] = replace(table, values=table.values + bad[:, None] * far)
            suspects.append(number)
            wrong.append(bad)
    return dataset.with_tables(tables), suspects, wrong


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_planted_outliers_are_found(world: str, share: float) -> None:
    dataset, suspects, wrong = planted(world, share, seed=4)
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    wild = start.retract(np.random.default_rng(1).normal(0.0, 0.1, start.layout.dof))
    fixed = dataset.pose_keys[1][:1]
    wild = wild.update(start.only(fixed))
    found = optimise_graduated(System(start.layout, tables=dataset.tables, fixed=fixed), wild, suspects)
    for number, bad in zip(suspects, wrong, strict=True):
        assert not found.inliers[number][bad].any()
    kept = np.concatenate([found.inliers[n][~bad] for n, bad in zip(suspects, wrong, strict=True)])
    assert kept.mean() > 0.95  # the gate lets 99 % of good rows pass
    assert found.rejected == sum(int((~mask).sum()) for mask in found.inliers)
    inliers = [t.select(mask) for t, mask in zip(dataset.tables, found.inliers, strict=True)]
    alone = optimise(System(start.layout, tables=inliers, fixed=fixed), start)
    np.testing.assert_allclose(found.solution.values.minus(alone.values), 0.0, atol=1e-5)
    difference = (found.solution.information - alone.information).toarray()
    assert np.abs(difference).max() < 1e-4 * np.abs(alone.information.toarray()).max()


def test_clean_data_are_left_alone() -> None:
    dataset = team("planar", sigma=0.02)
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    fixed = dataset.pose_keys[1][:1]
    suspects = [n for n, t in enumerate(dataset.tables) if t.source != "odometry"]
    found = optimise_graduated(
        System(start.layout, tables=dataset.tables, fixed=fixed), start, suspects, probability=0.9999999
    )
    plain = optimise(System(start.layout, tables=dataset.tables, fixed=fixed), start)
    assert found.rejected == 0
    np.testing.assert_array_equal(found.solution.values.state, plain.values.state)


@pytest.mark.parametrize("probability", [0.0, 1.0, -0.3])
def test_the_gate_is_a_probability(probability: float) -> None:
    dataset = team("2d")
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    system = System(start.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1])
    with pytest.raises(InputError, match="probability"):
        optimise_graduated(system, start, [0], probability=probability)
