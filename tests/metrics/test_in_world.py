"""A map in the world that is off as a whole is said to be, whatever an alignment hides; of one in a pose's frame nobody
knows."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from metrics_maps import map_of, small
from teamslam.geometry import Pose
from teamslam.metrics import score
from teamslam.metrics.in_world import InWorld, said_of
from teamslam.model import WORLD, Submap, Values
from teamslam.solver import Covariances

SIGMA = 0.05
TEAMS = ("2d", "planar", "3d")


def in_the_world(team: str, seed: int, off: float) -> tuple[Values, Submap]:
    """A truth, and a map of it in the world whose places all have one error `off` [m] in x beside noise of SIGMA, and
    which says that it knows each of them to SIGMA."""
    rng = np.random.default_rng(seed)
    dataset = small(team, seed)
    assert dataset.truth is not None
    truth = dataset.truth.select(dataset.truth.layout.keys != WORLD)
    n = truth.layout.dof
    error = SIGMA * rng.normal(size=n)
    error[truth.layout.dof_start[:-1]] += off
    information = sp.csr_array(np.eye(n) / SIGMA**2)
    return truth, replace(map_of(dataset), base=WORLD, values=truth.retract(error), information=information)


@pytest.mark.parametrize("team", TEAMS)
def test_the_mean_error_of_honest_maps_is_chi_square(team: str) -> None:
    found = [scored(team, seed, 0.0) for seed in range(25)]
    dof = 25 * found[0].nees.dof
    assert abs(sum(one.nees.value for one in found) - dof) < 4.0 * np.sqrt(2.0 * dof)


@pytest.mark.parametrize("team", TEAMS)
def test_a_map_that_is_off_as_a_whole_is_said_to_be_by_how_far(team: str) -> None:
    found = scored(team, 3, 0.5)
    assert found.off_m == pytest.approx(0.5, abs=5.0 * SIGMA)
    for rms in (found.robot_position_rmse_m, found.landmark_rmse_m):
        assert rms == pytest.approx(0.5, abs=5.0 * SIGMA)
    assert not found.nees.inside and "which is not by chance" in said_of(found)


@pytest.mark.parametrize("team", TEAMS)
def test_a_truth_in_another_frame_is_said_to_be_and_compared_after_an_alignment(team: str) -> None:
    """Far away and turned: the NEES of honest maps is chi-square with the alignment's numbers taken off."""
    away = Pose.from_xytheta(np.array([432e3, -5411e3, 0.7]))
    value, dof = 0.0, 0
    for seed in range(10):
        truth, map = in_the_world(team, seed, 0.0)
        found = score(map, truth.transform(away), covariances=Covariances(map.values.layout, map.information))
        assert found.in_world is None and "another frame" in found.note
        assert found.consistency is not None
        value, dof = value + found.consistency.nees.value, dof + found.consistency.nees.dof
    assert dof == sum(in_the_world(team, seed, 0.0)[0].layout.dof - (6 if team == "3d" else 3) for seed in range(10))
    assert abs(value - dof) < 4.0 * np.sqrt(2.0 * dof)


def test_of_a_map_in_the_frame_of_a_pose_nobody_knows() -> None:
    dataset = small("2d")
    map = map_of(dataset)
    assert dataset.truth is not None
    assert score(map, dataset.truth, covariances=Covariances.of_map(map)).in_world is None


def scored(team: str, seed: int, off: float) -> InWorld:
    truth, map = in_the_world(team, seed, off)
    found = score(map, truth, covariances=Covariances.of_map(map)).in_world
    assert found is not None
    return found
