"""Clocks and latencies that were planted come back, within what is stated of them."""

import numpy as np
import pytest
from scipy import sparse

import clocks_room
import tagged_room
import teamslam as ts
from teamslam.config import Config
from teamslam.joining import AtMap, full
from teamslam.model import is_parameter
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.trust.calibration.rows import held_at, linearised
from teamslam.trust.unknowns import settled
from teamslam.trust.unknowns.effects import Effects
from teamslam.trust.unknowns.normal import normal_at


@pytest.fixture(scope="module")
def lab():
    """Half a minute in the lab whose clocks are half a second apart."""
    seen, file, made = clocks_room.filmed(seed=1, seconds=30.0)
    return clocks_room.read(seen, file), made.clocks


def test_what_was_planted_is_found(lab):
    log, planted = lab
    assert abs(planted.offset_s[1]) > 0.4 and min(planted.latency_s) > 0.01
    result = ts.run(log)
    found = {(one.unknown.of, one.unknown.name): one for one in result.unknowns.found}
    true = {
        ("robot1, front", "latency"): planted.latency_s[0],
        ("robot2, front", "latency"): planted.latency_s[1],
        ("robot2", "clock offset"): planted.offset_s[1],
    }
    for which, value in true.items():
        one = found[which]
        assert one.told and one.sigma < 0.002
        assert abs(one.value - value) < min(0.002, 3.0 * one.sigma)
        assert len(one.windows) > 3
    drift = found["robot2", "clock drift"]  # 50 ppm are 0.75 ms to either side in half a minute: hardly told,
    assert drift.value != 0.0 and abs(drift.value - planted.drift[1]) < 3.0 * drift.sigma  # and not taken to be none
    assert result.scores[0].consistency.nees.per_dof < 1.9  # 2 to 4 were it so
    assert result.unknowns.settled
    assert is_parameter(result.map.values.layout.keys).any()


def test_a_log_that_was_changed_is_taken_as_it_is(lab):
    log, _ = lab
    changed = log.with_tables(table for table in log.tables if table.source != "robots")
    found = ts.run(changed, Config(method="full")).unknowns
    assert "changed" in found.why and not any(one.told for one in found.found)


def test_step_and_covariance_are_those_of_least_squares_over_map_and_unknowns_together(lab):
    """The oracle: one dense matrix of everything, inverted."""
    log, _ = lab
    log = log.unknowns.again(log.unknowns.values + np.array([1e-3, 1e-3, 1e-5, 1e-3]))
    maps = [AtMap(log.tables, component.map) for component in full(log, options=Options()).components]
    effects = Effects(log.unknowns, maps)
    found = normal_at(maps, log.unknowns, effects)
    free = np.flatnonzero(~found.held)
    back = np.array([unknown.stated for unknown in log.unknowns.each]) - log.unknowns.values
    rows, errors = [], []
    for at in maps:
        for table, (error, J) in zip(
            at.tables, linearised(at.tables, at.values, held_at(at), at.joined.names), strict=True
        ):
            weight = np.sqrt(table.loss.weight(np.sum(table.whitened(at.values) ** 2, -1)))
            W = sparse.block_diag(list(weight[:, None, None] * np.broadcast_to(
                table.whitening, (len(table), *table.whitening.shape[1:]))))  # fmt: skip
            D = effects.at(at, table).reshape(error.size, -1)
            rows.append(W @ np.hstack([-J.toarray(), D[:, free]]))
            errors.append(W @ (error.ravel() + D @ np.where(found.held, back, 0.0)))  # those go back to what is stated
    A, e = np.concatenate(rows), np.concatenate(errors)
    prior = np.array([log.unknowns.each[k].prior for k in free])
    n = A.shape[1] - len(free)
    A = np.concatenate([A, np.hstack([np.zeros((len(free), n)), np.diag(1.0 / prior)])])
    e = np.concatenate([e, -back[free] / prior])
    inverse = np.linalg.inv(A.T @ A)
    np.testing.assert_allclose(found.covariance[np.ix_(free, free)], inverse[n:, n:], rtol=1e-5)
    step = (-inverse @ A.T @ e)[n:]
    sigmas = np.sqrt(np.diag(inverse)[n:])
    np.testing.assert_allclose(found.step[free] / sigmas, step / sigmas, atol=1e-4)
    np.testing.assert_allclose(found.step[found.held], back[found.held])


def test_a_clock_that_is_seconds_off_is_found_though_steps_lead_only_so_far(tmp_path):
    """Further than any first guess looks."""
    team = tagged_room.write(tagged_room.make(1, 24.0, 2.0), tmp_path / "team")
    first, name, other = team.read_text().partition('name = "robot1"')
    stated = "clock = { offset_sigma_s = 0.0, drift_sigma = 0.0 }"
    assert stated in other
    team.write_text(first + name + other.replace(stated, "clock = { offset_s = 3.0, drift_sigma = 0.0 }"))
    found = settled(ts.read(team), DEFAULTS)
    (clock,) = found.found
    assert found.settled and abs(clock.value) < 4.0 * clock.sigma < 0.05
