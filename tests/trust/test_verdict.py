"""The verdict is chi-square where the model is right, and says so where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from faults import negated_angle, plant, surer
from teamslam.joining import AtMap, build, full, join, split
from teamslam.joining.build.build import CURE
from teamslam.model import LeftOut, Loss, Sources
from teamslam.trust import Cause, sentence, verdict, verdict_where_costly, with_plain_reasons
from teamslam.trust.tally import by_landmark, by_robot, by_sensor, by_stretch, whole
from worlds import WORLDS, team

ROBUST = (Loss("huber", 1.0), Loss("cauchy", 2.0), Loss("geman_mcclure", 3.0))


def test_the_cost_of_a_right_model_is_chi_square() -> None:
    """Over draws of noise, by the whole distribution: Kolmogorov and Smirnov's test of the tail probabilities."""
    logs = [team(WORLDS[seed % 3], robots=2, poses=8, landmarks=5, seed=seed) for seed in range(60)]
    found = [verdict(log, full(log)) for log in logs]
    tails = [chi2.cdf(v.cost, v.dof) for v in found]
    assert kstest(tails, "uniform").pvalue > 0.01
    assert all(v.expected == pytest.approx(v.dof, rel=0.1) for v in found)
    assert {v.level for v in found} == {"fits"}


@pytest.mark.parametrize("loss", ROBUST, ids=str)
def test_the_cost_under_robust_losses_is_what_is_expected(loss: Loss) -> None:
    """Within its own spread over draws, in all and sensor by sensor."""
    away: dict[str, list[float]] = {}
    for seed in range(30):
        log = team("2d", robots=2, poses=10, landmarks=6, seed=seed).with_loss(loss)
        found = verdict(log, full(log))
        assert found.level == "fits"
        total = whole(found.rows)
        away.setdefault("all", []).append(float(total.excess[0] / np.sqrt(total.variance[0])))
        tally, kinds = by_sensor(found.rows)
        for (_, source, _), excess, variance in zip(kinds, tally.excess, tally.variance, strict=True):
            away.setdefault(source, []).append(float(excess / np.sqrt(variance)))
    for name, z in away.items():
        assert abs(np.mean(z)) < 0.6, name
        assert 0.4 < np.std(z) < 1.5, name


def test_that_no_sensor_costs_too_much_is_seen_without_a_solve() -> None:
    """What a log says of its map is linearised and factorised there where somebody needs it."""
    log = team("2d", robots=2, poses=20)
    wrong = plant(log, negated_angle, source="landmarks", robots=(2,))
    for told, level in ((log, None), (wrong, "misfit")):
        joined = join([build(piece) for piece in split(told)])
        at = [AtMap(told.tables, component.map) for component in joined.components]
        found = verdict_where_costly(told, joined, at)
        assert (None if found is None else found.level) == level
        assert all(("gap" in vars(here)) == (level is not None) for here in at)


def test_tallies_add_up_to_the_whole() -> None:
    """Every row is in one sensor, one robot, one stretch; landmarks have all but those that see none."""
    log = team("planar", poses=30)
    rows = verdict(log, full(log)).rows
    total = whole(rows)
    for part in (by_sensor(rows)[0], by_robot(rows), by_stretch(rows).tally):
        assert part.rows.sum() == total.rows[0] == sum(map(len, log.tables))
        for name in ("cost", "expected", "variance"):
            assert getattr(part, name).sum() == pytest.approx(getattr(total, name)[0])
    marks = by_landmark(rows)
    assert marks.rows.sum() == sum(len(t) for t in log.tables if t.source == "landmarks")
    assert set(marks.labels.tolist()) == set(log.landmark_keys.tolist())


@pytest.mark.parametrize("world", WORLDS)
def test_a_wrong_log_is_a_misfit_and_is_found_where_it_is(world: str) -> None:
    """Every sighting of one robot mirrored: its sensors are among those that carry the excess."""
    log = plant(team(world, poses=20), negated_angle, source="landmarks", robots=(2,))
    found = verdict(log, join([build(piece) for piece in split(log)]))
    assert found.level == "misfit" and found.gross
    assert "DOES NOT FIT" in sentence(found)
    worst = [share for share in found.carriers if share.kind == "sensor"]
    assert any(share.what.startswith("robot 2: ") for share in worst)
    assert sum(share.excess for share in found.sensors) == pytest.approx(1.0)


def test_a_sensor_whose_rows_are_all_refused_is_a_misfit() -> None:
    """A robust loss forgives them one by one; a sensor that is forgiven whole is wrong."""
    log = plant(team("2d", poses=40, every=2), negated_angle, source="robots", robots=(1,)).with_loss(
        Loss("cauchy", 1.0)
    )
    found = verdict(log, full(log))
    assert found.cost < 9.0 * found.expected
    assert found.gross


@pytest.mark.parametrize(("factor", "level"), [(1.0, "fits"), (0.5, "loose"), (1.6, "strained"), (4.0, "misfit")])
def test_sigmas_decide_between_loose_and_strained(factor: float, level: str) -> None:
    """All standard deviations stated so many times too small: the cost is the square of it, and no more."""
    log = plant(team("2d", poses=30), surer(factor))
    found = verdict(log, full(log))
    assert found.level == level
    assert found.cost / found.expected == pytest.approx(factor**2, rel=0.15)
    for noise in found.noise:
        assert noise.scale == pytest.approx(factor, rel=0.35)


def test_a_joins_own_approximation_is_not_held_against_the_log() -> None:
    """Noisy submaps bend: their join costs more than full least squares, and by how much is known."""
    log = team("2d", sigma=0.3, sigma_odometry=0.2, poses=20)
    joined = join([build(piece) for piece in split(log)])
    found, best = verdict(log, joined), verdict(log, full(log))
    assert found.cost - found.decrease == pytest.approx(best.cost, rel=0.02)


@pytest.mark.parametrize("world", WORLDS)
def test_a_map_that_is_far_from_its_measurements_is_never_said_to_fit(world: str) -> None:
    """Moved off its optimum by many sigmas: the log is right, and the map is not to be trusted."""
    log = team(world, poses=20)
    best = full(log)
    moved = best.map.values.retract(np.random.default_rng(0).normal(0.0, 0.1, best.map.values.layout.dof))
    far = replace(best, components=(replace(best.components[0], map=replace(best.map, values=moved)),))
    found = verdict(log, far)
    assert found.cost > 9.0 * found.expected
    assert found.level != "fits"
    if found.level == "strained":
        assert "far from the optimum" in sentence(found) and "DOES NOT" not in sentence(found)
        assert not found.causes


def test_where_nothing_is_to_spare_nothing_is_said() -> None:
    """Odometry alone leaves no residual."""
    log = team("2d", robots=1, poses=5)
    log = log.with_tables(t for t in log.tables if t.source == "odometry")
    found = verdict(log, full(log))
    assert found.level == "unknown" and not found.gross
    assert "none is left to check it" in sentence(found)


def test_no_advice_on_solving_where_the_log_is_wrong() -> None:
    """What was left out keeps its reason, and loses advice that would not help; of other robots it keeps both."""
    log = plant(team("2d", robots=2, poses=12, landmarks=8), negated_angle, source="landmarks", robots=(1,))
    joined = join([build(piece) for piece in split(log)])
    lost = [
        LeftOut("piece", f"robot {r}", log.pose_keys[r], Sources.of(()), 0, f"it did not converge.{CURE}")
        for r in (1, 2)
    ]
    found = replace(verdict(log, joined), causes=(Cause("sign", "robot 1: wrong", 1.0, (1,)),))
    told = with_plain_reasons(replace(joined, left_out=tuple(lost)), found).left_out
    assert told[0].reason == "it did not converge." and told[1].reason == lost[1].reason
