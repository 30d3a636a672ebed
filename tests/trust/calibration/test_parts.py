"""Laws of the parts of a calibration: what is chosen by chance, how errors hang together, what a submap carries."""

import numpy as np
import pytest

from teamslam.geometry import Array
from teamslam.joining import AtMap, build, full, split
from teamslam.model import Names, Submap, Table, is_landmark, is_parameter, landmark_key, pose_key
from teamslam.solver import Factor
from teamslam.trust.calibration.calibrate import calibrate
from teamslam.trust.calibration.carried import bordered, rows_inside
from teamslam.trust.calibration.choice import chosen, differences, posterior
from teamslam.trust.calibration.estimate import estimate
from teamslam.trust.calibration.fading import refined
from teamslam.trust.calibration.persistence import WHITE, Curve, Pairs, Persistence, hanging, tempering
from teamslam.trust.calibration.rows import linearised
from teamslam.trust.calibration.sigmas import sigmas_of
from teamslam.trust.calibration.successive import Successive
from trust.calibration.faulty import offset, team


def test_what_chance_makes_is_chosen_no_more_often_than_stated() -> None:
    rng, groups = np.random.default_rng(0), np.repeat(np.arange(8), 4)
    relative, found, teams = groups == 2, 0, 1000
    for _ in range(teams):
        root = rng.standard_normal((32, 40)) * np.exp(rng.normal(0.0, 1.5, (32, 1)))
        information = root @ root.T
        gradient = root @ rng.standard_normal(40)  # covariance S: what there is if all errors are zero
        found += len(chosen(information, gradient, groups, relative).inside) > 0
    assert found <= 0.01 * teams + 3.0 * np.sqrt(0.01 * teams)


@pytest.mark.parametrize("kind", [0, 2])
def test_what_is_there_is_chosen_and_only_that(kind: int) -> None:
    rng, groups = np.random.default_rng(1), np.repeat(np.arange(4), 5)
    root = rng.standard_normal((20, 60)) * 20.0
    information, errors = root @ root.T, np.zeros(20)
    errors[groups == kind] = rng.normal(0.0, 0.3, 5)
    choice = chosen(information, information @ errors + root @ rng.standard_normal(60), groups, groups == 9)
    assert set(groups[choice.inside]) == {kind}


def test_what_relative_errors_have_in_common_excuses_no_other_kind() -> None:
    """Ranges beside odometry, robot by robot, and beside each other's. Odometry of all is too long by twice what ranges
    differ by: found, and taken out but for a share by the priors, tau of ranges 0.12 and of odometry 0.2."""
    robots, sharp, longer = 4, 0.02, 0.2
    differ = differences(robots).T
    effects = np.block([[np.eye(robots), -np.eye(robots)], [np.zeros((robots - 1, robots)), -differ]]) / sharp
    errors = np.concatenate([np.full(robots, longer), 0.5 * longer * np.array([1.0, -1.0, 1.0, -1.0])])
    groups, relative = np.repeat([0, 1], robots), np.repeat([False, True], robots)
    information = effects.T @ effects
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(len(effects))
        told = information @ errors + effects.T @ noise
        choice = chosen(information, told, groups, relative)
        assert set(groups[choice.inside]) == {0, 1}
        p, _ = posterior(information, told, choice.tau)
        assert p[:robots].mean() == pytest.approx(longer * 0.2**2 / (0.2**2 + 0.12**2), rel=0.15)


def _looks(count: int, targets: int = 4) -> Table:
    keys = np.stack([pose_key(1, np.arange(count) * 1_000_000), landmark_key(np.arange(count) % targets)], -1)
    values = np.zeros((count, 2))
    return Table(1, "landmarks", "range_bearing", 2, keys, values, np.eye(2)[None], np.arange(count))


def _lasting(table: Table, curve: Curve, rng: np.random.Generator) -> Array:
    """Errors (m,) of size one of which those of one target hang together as the curve says."""
    times = Names().stamps_s(table.keys[:, 0])
    alike = table.keys[:, 1][:, None] == table.keys[:, 1]
    covariance = np.where(alike, curve(np.abs(times[:, None] - times)), 0.0)
    np.fill_diagonal(covariance, 1.0)
    return np.asarray(np.linalg.cholesky(covariance) @ rng.standard_normal(len(table)))


def _beside_white(errors: Array, rng: np.random.Generator) -> Array:
    return np.concatenate([errors[:, None], rng.standard_normal((len(errors), WHITE))], 1)


@pytest.mark.parametrize("curve", [Curve(0.6, 10.0, 0.0), Curve(0.0, 1.0, 0.4)])
def test_errors_that_hang_together_are_found_so(curve: Curve) -> None:
    table, rng, apart = _looks(400), np.random.default_rng(2), np.array([2.0, 5.0, 20.0])
    pairs, found = Pairs.of([table], Names()), []
    for _ in range(60):
        persistence = pairs.persistence(_beside_white(_lasting(table, curve, rng), rng))
        found.append([persistence.same(apart), persistence.across(apart)])
    same, across = np.mean(found, 0)
    assert np.allclose(same, curve(apart), atol=0.08)
    assert np.allclose(across, 0.0, atol=0.06)  # four targets: what stays of each hangs together by chance


def test_noise_that_is_made_to_hang_together_does_so_as_is_held() -> None:
    table, apart = _looks(120), np.array([1, 4, 5, 8])  # every fourth sees the same target
    held = Persistence(same=Curve(0.5, 6.0, 0.1), across=Curve(0.2, 3.0, 0.05))
    white = np.random.default_rng(5).standard_normal((120, 2, 4000))
    made = hanging(white, table, Names(), (held, Persistence()))
    assert np.array_equal(made[:, 1], white[:, 1])
    products = [np.mean(made[40:80, 0] * made[40 + lag : 80 + lag, 0]) for lag in apart.tolist()]
    common = held.across(apart.astype(float))
    own = 0.3 * np.exp(-apart / 6.0) + 0.05
    assert np.allclose(products, common + np.where(apart % 4 == 0, own, 0.0), atol=0.02)
    assert np.mean(made[:, 0] ** 2) == pytest.approx(1.0, abs=0.02)


def test_white_errors_are_not_said_to_hang_together() -> None:
    table, rng = _looks(300), np.random.default_rng(3)
    pairs = Pairs.of([table], Names())
    errors = [_beside_white(rng.standard_normal(len(table)), rng) for _ in range(400)]
    assert sum(not pairs.persistence(each).nothing for each in errors) <= 6  # two in a thousand, for two curves


def test_tempered_rows_know_their_mean_as_well_as_correlated_ones() -> None:
    table, curve = _looks(200, targets=1), Curve(0.5, 8.0, 0.05)
    (temper,) = tempering([table], Names(), (Persistence(same=curve), Persistence()))
    t = np.arange(200.0)
    covariance = curve(np.abs(t[:, None] - t)) + (1.0 - curve(np.zeros(1))) * np.eye(200)
    weights = temper[:, 0] ** -2 / np.sum(temper[:, 0] ** -2)
    assert np.sum(temper[:, 0] ** -2) ** -1 == pytest.approx(weights @ covariance @ weights, rel=0.1)
    assert (temper[:, 1] == 1.0).all()


def test_tempered_rows_and_how_they_differ_know_all_that_fading_errors_leave() -> None:
    table, fade = _looks(60, targets=1), 0.9
    held = (Persistence(same=Curve(1.0, -1.0 / np.log(fade), 0.0)), Persistence())
    successive = Successive.of(table, Names(), held)
    (temper,) = tempering([table], Names(), held)
    differ = successive.whitened(np.broadcast_to(np.eye(2), (60, 2, 2))).toarray()
    information = np.diag(temper.ravel() ** -2) + differ.T @ differ
    t = np.arange(60.0)
    exact = np.linalg.inv(fade ** np.abs(t[:, None] - t))
    inner = slice(25, 35)  # far from either end, where fewer hang together
    assert np.allclose(information[::2, ::2][inner, inner], exact[inner, inner], atol=5e-3)
    assert np.allclose(information[1::2, 1::2], np.eye(60))  # the other part's errors do not hang together


@pytest.mark.parametrize(
    "held",
    [
        Persistence(same=Curve(0.8, 5.0, 0.0)),
        Persistence(same=Curve(0.8, 20.0, 0.1)),
        Persistence(same=Curve(0.9, 5.0, 0.1), across=Curve(0.1, 3.0, 0.0)),
    ],
)
def test_what_rows_say_of_how_they_differ_is_never_more_than_there_is(held: Persistence) -> None:
    table = _looks(120, targets=2)
    successive = Successive.of(table, Names(), (held, Persistence()))
    (temper,) = tempering([table], Names(), (held, Persistence()))
    differ = successive.whitened(np.broadcast_to(np.eye(2), (120, 2, 2))).toarray()[:, ::2]
    information = np.diag(temper[:, 0] ** -2) + differ.T @ differ
    t, alike = np.arange(120.0), np.arange(120)[:, None] % 2 == np.arange(120) % 2
    apart = np.abs(t[:, None] - t)
    covariance = held.across(apart) + np.where(alike, held.own(apart), 0.0) + held.alone * np.eye(120)
    most = np.linalg.eigvals(information @ covariance).real.max()
    assert len(successive.root) > 100 and most < 1.15  # 1: as much as there is; ends of ways know a little more


def test_how_nearly_all_errors_fade_is_found_again_whatever_it_was_held_to_be() -> None:
    table, rng, found = _looks(400, targets=2), np.random.default_rng(6), []
    pairs, truth = Pairs.of([table], Names()), Curve(1.0, 9.5, 0.0)
    for _ in range(20):
        errors, held = _lasting(table, truth, rng), Persistence(same=Curve(0.9, 4.0, 0.0))
        for _ in range(3):
            drawn = hanging(rng.standard_normal((400, 2, 16)), table, Names(), (held, Persistence()))[:, 0]
            held = refined(pairs, np.concatenate([errors[:, None], drawn], 1), held)
        found.append(1.0 - held.same(np.array([2.0]))[0])
    expected = 1.0 - truth(np.array([2.0]))[0]  # a white error's mean square, of n numbers, is off by (2 / n)^1/2
    assert np.mean(found) == pytest.approx(expected, rel=0.05)
    assert np.std(found) < 0.12 * expected


def test_a_submap_that_carries_systematic_errors_knows_what_least_squares_over_both_knows() -> None:
    log, _ = offset(team(4, poses=40), np.random.default_rng(4))
    whole = full(log).components[0].map
    found = calibrate([AtMap(log.tables, whole)])
    assert found.systematic
    piece = split(found.put_right(log))[0]
    bare = build(piece)
    carrying = found.carried_by(bare, rows_inside(bare, piece))
    extra = is_parameter(carrying.values.layout.keys)
    assert extra.any() and not is_parameter(bare.values.layout.keys).any()
    # All of it again, dense: rows, errors and priors in one least squares problem.
    jacobians, effects, residuals = [], [], []
    mine = [e for e in found.systematic if any(e.on(t) is not None for t in rows_inside(bare, piece))]
    inside = rows_inside(bare, piece)
    linear = linearised(inside, bare.all_values, np.array([bare.base]), bare.names)
    for table, (error, jacobian) in zip(inside, linear, strict=True):
        white = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
        jacobians.append(
            np.einsum("mij,mjn->min", white, jacobian.toarray().reshape(*error.shape, -1)).reshape(error.size, -1)
        )
        each = [np.zeros_like(error) if (on := e.on(table)) is None else e.prior * on for e in mine]
        effects.append(np.stack([np.einsum("mij,mj->mi", white, e).ravel() for e in each], -1))
        residuals.append(np.einsum("mij,mj->mi", white, error).ravel())
    J, D, r = np.concatenate(jacobians), np.concatenate(effects), np.concatenate(residuals)
    prior = np.array([e.value / e.prior for e in mine])
    both = np.block([[J, D], [np.zeros((len(mine), J.shape[1])), np.eye(len(mine))]])
    expected = np.linalg.inv(both.T @ both)[: bare.dof, : bare.dof]
    shift = np.linalg.lstsq(both, np.concatenate([r, -prior]), rcond=None)[0][: bare.dof]
    at = carrying.values.layout.unknowns(bare.values.layout.keys)
    covariance = np.linalg.inv(carrying.information.toarray())[np.ix_(at, at)]
    assert np.allclose(covariance, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    moved = carrying.values.only(bare.values.layout.keys).minus(bare.values)
    assert np.allclose(moved, shift, atol=1e-6 * max(np.abs(shift).max(), 1e-3))


def test_errors_of_two_kinds_stand_beside_each_other() -> None:
    """What calibration found, and clocks or cameras beside it: neither takes the other's place."""
    bare = build(split(team(4, poses=40))[0])

    def with_errors(submap: Submap, values: Array) -> Submap:
        n = len(values)
        factor = Factor.of(submap.values.layout, submap.information, submap.names, submap.values)
        return bordered(submap, factor, np.zeros((submap.dof, n)), np.eye(n), np.zeros(n), values)

    one = with_errors(bare, np.array([1.0, 2.0, 3.0]))
    two = with_errors(one, np.array([4.0, 5.0]))
    assert (one.dof, two.dof) == (bare.dof + 4, bare.dof + 6)
    keys = two.values.layout.keys[is_parameter(two.values.layout.keys)]
    assert two.values.positions(keys, 2).tolist() == [[4.0, 5.0], [1.0, 2.0], [3.0, 0.0]]


def test_rows_are_put_right_by_the_errors_that_the_map_holds() -> None:
    """|W (z - p effect - h(x))|^2 + |p / prior|^2 is least at the map and the errors that it holds: these moved on
    together. By errors as they were found before, rows would be judged by what the map does not say."""
    log, _ = offset(team(4, poses=40), np.random.default_rng(4))
    found = calibrate([AtMap(log.tables, full(log).components[0].map)])
    right = found.put_right(log)
    before = full(right).components[0].map
    map, held = found.carried_on(before, AtMap(right.tables, before).tables)
    pairs = zip(held.systematic, found.systematic, strict=True)
    assert max(abs(e.value - f.value) / e.prior for e, f in pairs) > 0.01
    best = held.cost(map, log)
    assert best < found.cost(before, log)  # errors as they were found, and the map for these
    assert best < found.cost(map, log)  # errors as they were found, at the map that has others
    again = full(held.put_right(log)).components[0].map  # for these errors no other map is better
    assert best == pytest.approx(held.cost(again, log), rel=1e-4)


def test_sigmas_are_those_of_map_and_systematic_errors_together() -> None:
    log, _ = offset(team(4, poses=40), np.random.default_rng(4))
    fit = estimate(AtMap(log.tables, full(log).components[0].map)).fit
    inside, free = fit.choice.inside, fit.linear.at.gap.free
    jacobian, weight = fit.linear.jacobian.toarray(), fit.weight.toarray()
    both = np.concatenate([jacobian, fit.linear.effects.toarray()[:, inside]], 1)
    prior = np.concatenate([np.zeros(free.dof), fit.choice.tau**-2.0])
    covariance = np.linalg.inv(both.T @ weight @ both + np.diag(prior))
    places = free.dof_start[:-1][is_landmark(free.keys)][:, None] + np.arange(2)
    (landmarks,) = (sigmas for sigmas in sigmas_of(fit) if sigmas.what == "landmarks")
    assert len(inside) and landmarks.whole > landmarks.noise
    assert landmarks.whole == pytest.approx(np.median(np.sqrt(np.diag(covariance)[places].mean(1))), rel=1e-6)
