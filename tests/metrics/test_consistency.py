"""NEES: chi-square for errors that are exactly Gaussian, whatever the truth knows; dense algebra as oracle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from metrics_maps import TEAMS, frame_dim, map_of, small, some_frame
from teamslam.config import Config
from teamslam.metrics import ChiSquare, fit_of, score, truth_at_base
from teamslam.model import WORLD, Dataset, Loss, Submap, Values, is_landmark, is_pose
from teamslam.pipeline import run
from teamslam.sim import simulate
from thinned import thinned

TRUTHS = ("all", "without some", "without the base", "landmarks only")


def information_for(n: int, rng: np.random.Generator) -> np.ndarray:
    """Any: correlations in everything, deviations around 1e-4, where all is linear."""
    root = 0.4 * rng.standard_normal((n, n)) / np.sqrt(n) + np.eye(n)
    return 1e8 * root @ root.T


def sample(dataset: Dataset, rng: np.random.Generator, information: np.ndarray) -> Submap:
    """A map whose error is drawn from the normal law that its information states."""
    error = np.linalg.solve(np.linalg.cholesky(information).T, rng.standard_normal(len(information)))
    return map_of(dataset, error, information)


def known(dataset: Dataset, which: str) -> Values:
    """A truth that knows all, or less."""
    keys, base = dataset.truth.layout.keys, dataset.pose_keys[1][0]
    mask = {
        "all": np.ones(len(keys), bool),
        "without some": (keys % 3 != 0) | (keys == base),
        "without the base": keys != base,
        "landmarks only": is_landmark(keys),
    }[which]
    return dataset.truth.select(mask)


@pytest.mark.parametrize(("which", "team"), thinned(2, list(TRUTHS), list(TEAMS)))
def test_nees_of_gaussian_errors_is_chi_square(team: str, which: str) -> None:
    """Its law, over many maps: Kolmogorov-Smirnov against chi-square with the dof that it states."""
    dataset, rng = small(team, poses=4, landmarks=6), np.random.default_rng(5)
    information = information_for(map_of(dataset).dof, rng)
    frame = some_frame(frame_dim(dataset), rng)
    truth = known(dataset, which).transform(frame)
    found = [score(sample(dataset, rng, information), truth).consistency.nees for _ in range(60)]
    assert len({f.dof for f in found}) == 1
    assert kstest([f.value for f in found], chi2(found[0].dof).cdf).pvalue > 1e-3
    inside = np.mean([f.inside for f in found])
    assert inside > 0.85


@pytest.mark.parametrize("team", TEAMS)
def test_dof_are_the_numbers_compared_less_those_of_a_fitted_frame(team: str) -> None:
    """A fitted frame costs its own degrees of freedom."""
    dataset = small(team, poses=4, landmarks=6)
    n, fitted = map_of(dataset).dof, 3 if frame_dim(dataset) == 2 else 6
    whole = score(map_of(dataset), known(dataset, "all")).consistency
    without = score(map_of(dataset), known(dataset, "without the base")).consistency
    assert (whole.frame, whole.nees.dof) == ("base", n)
    assert (without.frame, without.nees.dof) == ("fitted", n - fitted)


@pytest.mark.parametrize("team", TEAMS)
def test_what_the_truth_does_not_know_is_marginalised_out(team: str) -> None:
    """e' C^-1 e with the marginal covariance of what is known, by dense inversion."""
    dataset, rng = small(team, poses=4, landmarks=6), np.random.default_rng(1)
    information = information_for(map_of(dataset).dof, rng)
    submap, truth = sample(dataset, rng, information), known(dataset, "without some")
    there = truth_at_base(submap, truth)
    error = there.minus(submap.values.only(there.layout.keys))
    at = submap.values.layout.unknowns(there.layout.keys)
    covariance = np.linalg.inv(information)[np.ix_(at, at)]
    found = score(submap, truth).consistency.nees
    assert found.value == pytest.approx(error @ np.linalg.solve(covariance, error), rel=1e-6)
    assert found.dof == len(error) < submap.dof


def test_a_map_that_is_too_sure_of_itself_is_found_out() -> None:
    """Deviations claimed at half of what they are: NEES / dof is 4."""
    dataset, rng = small("planar"), np.random.default_rng(0)
    information = information_for(map_of(dataset).dof, rng)
    honest = sample(dataset, rng, information)
    error = np.linalg.solve(np.linalg.cholesky(information).T, rng.standard_normal(len(information)))
    boasting = map_of(dataset, error, 4.0 * information)
    assert score(honest, dataset.truth).consistency.nees.inside
    nees = score(boasting, dataset.truth).consistency.nees
    assert nees.per_dof == pytest.approx(4.0, rel=0.3) and nees.inside is False


class Dense:
    """Marginals of a dense information matrix."""

    def __init__(self, submap: Submap) -> None:
        self.layout, self.covariance = submap.values.layout, np.linalg.inv(submap.information.toarray())

    def blocks(self, keys: np.ndarray) -> list[np.ndarray]:
        """In the order of keys."""
        places = [self.layout.unknowns(np.array([k])) for k in keys]
        return [self.covariance[np.ix_(at, at)] for at in places]

    def joint(self, keys: np.ndarray) -> np.ndarray:
        """All of them together, in the order of keys."""
        places = np.concatenate([self.layout.unknowns(np.array([k])) for k in keys])
        return self.covariance[np.ix_(places, places)]


@pytest.mark.parametrize("team", TEAMS)
def test_variables_one_by_one_lie_in_their_regions(team: str) -> None:
    """About 95 % of them, with a mean near 1, over many maps."""
    dataset, rng = small(team, poses=4, landmarks=6), np.random.default_rng(2)
    information = information_for(map_of(dataset).dof, rng)
    maps = [sample(dataset, rng, information) for _ in range(60)]
    for name in ("of_poses", "of_landmarks"):
        found = [getattr(score(m, dataset.truth, covariances=Dense(m)).consistency, name) for m in maps]
        assert np.mean([f.per_dof for f in found]) == pytest.approx(1.0, abs=0.15)
        assert np.mean([f.share_inside for f in found]) == pytest.approx(0.95, abs=0.03)
    assert score(maps[0], dataset.truth).consistency.of_poses is None


def test_a_map_of_the_world_is_compared_as_it_stands() -> None:
    """No frame to find: an offset of the whole map is an error of NEES, though alignment forgives it."""
    from dataclasses import replace

    import scipy.sparse as sp

    dataset = small("2d")
    n = dataset.truth.layout.dof
    shifted = dataset.truth.transform(some_frame(2, np.random.default_rng(0)))
    submap = replace(map_of(dataset), base=WORLD, values=shifted, information=sp.csr_array(np.eye(n)))
    report = score(submap, dataset.truth)
    assert report.robot_position_rmse_m < 1e-9 and report.consistency.frame == "world"
    assert report.consistency.nees.value > 1.0 and report.consistency.nees.dof == n
    assert score(replace(submap, values=dataset.truth), dataset.truth).consistency.nees.value < 1e-20


def test_bands_are_those_of_chi_square() -> None:
    """95 % between them."""
    rng = np.random.default_rng(0)
    drawn = [ChiSquare(float(v), 12) for v in rng.chisquare(12, 4000)]
    assert np.mean([d.inside for d in drawn]) == pytest.approx(0.95, abs=0.015)
    assert drawn[0].band == pytest.approx((chi2.ppf(0.025, 12) / 12, chi2.ppf(0.975, 12) / 12))
    assert ChiSquare(0.0, 0).per_dof is None and ChiSquare(0.0, 0).band is None and ChiSquare(0.0, 0).inside is None


@pytest.mark.parametrize("preset", ["2d", "planar", "3d"])
def test_simulated_teams_are_consistent(preset: str) -> None:
    """Full least squares on simulated data: NEES over all, the fit, and poses one by one, in their bands."""
    from teamslam.joining import full
    from teamslam.solver import Covariances

    dataset = simulate(preset, 11)
    found = full(dataset).map
    report = score(found, dataset.truth, covariances=Covariances.of_map(found))
    # Two chi-squares, each outside its 95 % band once in twenty seeds: the wider 99.9 % band is asked for here.
    for chi in (report.consistency.nees, report.fit):
        assert 5e-4 < chi2.cdf(chi.value, chi.dof) < 1.0 - 5e-4
    assert report.fit == fit_of(found) and is_pose(found.keys).any()


@pytest.mark.parametrize("method", ["join", "full"])
def test_of_squares_that_a_loss_forgave_no_chi_square_is_claimed(method: str) -> None:
    """A few gross outliers under a loss that forgives: squares are many times what they should be, the map is good."""
    log = simulate("2d", 3)
    wrong = []
    for table in log.tables:
        values = table.values.copy()
        if table.source == "landmarks":
            values[::40] += 3.0
        wrong.append(replace(table, values=values))
    forgiving = log.with_tables(wrong).with_loss(Loss("cauchy", 2.0))
    config = Config(method=method, calibrate=False)
    assert all(score.fit is None and "own account" not in str(score) for score in run(forgiving, config).scores)
    honest = run(log, config).scores[0]
    assert honest.fit is not None and "own account" in str(honest) and 0.9 < honest.fit.per_dof < 1.1
