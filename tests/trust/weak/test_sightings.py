"""Predicted gains against those of sightings that are really added."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hung import tied_by_heading, two_halves
from teamslam.joining import full
from teamslam.joining.exact.gap import point_of
from teamslam.model import MODELS, Dataset, Loss, Table, is_landmark
from teamslam.sim.noise import plus
from teamslam.solver import System
from teamslam.trust.weak import Knowledge, knowledge_from, weakest_of
from teamslam.trust.weak.eyes import eyes_of
from teamslam.trust.weak.gains import Directions, Pairs, exactly, hopes_of, joint
from teamslam.trust.weak.sightings import VIEWPOINTS, Sighting, _candidates, look_next
from worlds import WORLDS, team

worlds = st.sampled_from(WORLDS)
seeds = st.integers(0, 10_000)


def information(tables: list[Table], known: Knowledge) -> float:
    """log det of H over all that is no motion of the whole, in the metric."""
    H = System(known.values.layout, tables=tables).linearise(known.values).hessian.to_csr().toarray()
    root = np.sqrt(known.weight)
    found = np.linalg.eigvalsh(H / np.outer(root, root))
    return float(np.log(found[known.open.shape[1] :]).sum())


@settings(max_examples=15)
@given(world=worlds, seed=seeds)
def test_gains_are_those_of_the_sighting_itself(world: str, seed: int) -> None:
    """To rounding, at the same place: of every direction and of all together."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), 0.2)
    known = knowledge_from(log.tables, log.truth, log.names)
    weak = weakest_of(known)
    before = information(log.tables, known)
    for sighting in look_next(weak, eyes_of(log.tables, log.truth), most=3):
        after = knowledge_from([*log.tables, sighting.table], log.truth, log.names)
        real = [np.sqrt(d.hinge.function @ after.spread(d.hinge.function)) for d in weak.directions]
        np.testing.assert_allclose(sighting.after, real, rtol=1e-6)
        assert sighting.gain == pytest.approx(
            0.5 * (information([*log.tables, sighting.table], known) - before), rel=1e-6
        )


@settings(max_examples=25)
@given(world=worlds, seed=seeds)
def test_gains_are_within_a_tenth_when_the_sighting_is_made_and_the_map_solved_again(world: str, seed: int) -> None:
    """With noise of its own: the map moves, and the prediction holds as long as it does not move far."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), 0.03, noise=1.0, seed=seed)
    values = point_of(full(log).map)
    known = knowledge_from(log.tables, values, log.names)
    weak = weakest_of(known)
    best = look_next(weak, eyes_of(log.tables, values), most=1)[0]
    made = really_made(best, log, np.random.default_rng(seed))
    tables = [*log.tables, made]
    solved = full(log.with_tables(tables)).map
    after = knowledge_from(tables, point_of(solved), log.names)
    same_metric = replace(after, motions=known.motions)
    real = [np.sqrt(d.hinge.function @ after.spread(d.hinge.function)) for d in weak.directions]
    assert np.log(weak.directions[0].sigma / best.after[0]) == pytest.approx(
        np.log(weak.directions[0].sigma / real[0]), rel=0.1
    )
    gained = 0.5 * (information(tables, same_metric) - information(log.tables, known))
    assert best.gain == pytest.approx(gained, rel=0.1)


def really_made(sighting: Sighting, log: Dataset, rng: np.random.Generator) -> Table:
    """The sighting as the sensor would make it of the truth, with its noise."""
    row = sighting.table
    drawn = rng.standard_normal(MODELS[row.model].residual_rows(row.dim))
    noise = np.linalg.solve(row.whitening[0], drawn)[None]
    return replace(row, values=plus(row.model, row.predict(log.truth), noise, row.dim), ids=np.array([10_000]))


@pytest.mark.parametrize("world", WORLDS)
def test_what_hangs_loose_is_tied_first(world: str) -> None:
    """By as many ways as are said."""
    log = two_halves(world, 1, seed=4)
    known = knowledge_from(log.tables, log.truth, log.names)
    weak = weakest_of(known)
    for sighting in look_next(weak, eyes_of(log.tables, log.truth)):
        assert sighting.ties
        after = knowledge_from([*log.tables, sighting.table], log.truth, log.names)
        assert after.unknown.shape[1] == known.unknown.shape[1] - sighting.ties
        assert "hang loose" in sighting.sentence


def test_only_what_the_sensors_can_see_is_proposed() -> None:
    """As far and as wide as they have seen."""
    log = team("2d", poses=20, landmarks=20, sees=0.3)
    assert log.truth is not None
    eyes = {(eye.robot, eye.sees_robots): eye for eye in eyes_of(log.tables, log.truth)}
    assert set(eyes) == {(r, s) for r in (1, 2, 3) for s in (True, False)}
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    found = look_next(weak, list(eyes.values()), most=20)
    assert len({(s.eye.robot, s.target) for s in found}) == len(found)
    for sighting in found:
        eye = eyes[sighting.eye.robot, not is_landmark(sighting.target)]
        assert sighting.distance <= eye.reach * (1.0 + 1e-6)
        assert sighting.gain > 0.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("world", WORLDS)
def test_none_brings_more_than_is_hoped_of_it(world: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that those few that are weighed are the best of all."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), 0.05)
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    eyes, directions = eyes_of(log.tables, log.truth), Directions.of(weak)
    for eye, table in _candidates(weak.known, eyes):
        for hope in hopes_of(weak.known, directions, eye, table):
            pairs = Pairs(weak.known, np.unique(hope.columns))
            _, after = exactly(pairs, directions, hope.A, hope.table.keys[hope.rows], hope.columns)
            firms = np.log(np.sqrt(directions.variances) / after).sum(-1)
            assert (firms <= hope.firms + 1e-9).all()
    found = look_next(weak, eyes)
    monkeypatch.setattr("teamslam.trust.weak.sightings.FEW", 10**9)
    assert [look.sentence for look in found] == [look.sentence for look in look_next(weak, eyes)]


@pytest.mark.parametrize("world", WORLDS)
def test_pairs_know_of_each_other_what_the_whole_covariance_says(world: str) -> None:
    log = team(world, poses=8, landmarks=6)
    assert log.truth is not None
    known = knowledge_from(log.tables, log.truth, log.names)
    layout = known.values.layout
    whole = joint(known, np.arange(layout.dof))
    pairs = Pairs(known, np.arange(layout.dof))
    observers = layout.keys[layout.kinds < 2]
    for kind in np.unique(layout.kinds).tolist():
        targets = layout.keys[layout.kinds == kind]
        keys = np.stack([np.resize(observers, len(targets)), targets], -1)
        for one, found in zip(keys, pairs.of(keys), strict=True):
            at = layout.unknowns(one)
            np.testing.assert_allclose(found, whole[np.ix_(at, at)], rtol=1e-6, atol=1e-9 * np.abs(whole).max())


def test_each_viewpoint_is_solved_for_once_however_many_sightings_are_weighed(monkeypatch: pytest.MonkeyPatch) -> None:
    log = team("2d", poses=100, landmarks=40)
    assert log.truth is not None
    weak, eyes = weakest_of(knowledge_from(log.tables, log.truth, log.names)), eyes_of(log.tables, log.truth)
    columns: list[int] = []
    spread = Knowledge.spread

    def counted(known: Knowledge, f: np.ndarray) -> np.ndarray:
        columns.append(f[0].size)
        return spread(known, f)

    monkeypatch.setattr(Knowledge, "spread", counted)
    look_next(weak, eyes)
    of_robots = 3 * 2 * VIEWPOINTS  # viewpoints at landmarks, and those of meetings
    assert sum(columns) <= 3 * of_robots + len(weak.directions)


def test_a_misread_does_not_make_a_sensor_see_farther() -> None:
    """A sighting that its loss gives next to no weight is of another landmark than it says, and shows no reach."""
    log = team("2d", poses=20, landmarks=20, sees=0.3)
    assert log.truth is not None
    table = next(t for t in log.tables if is_landmark(t.keys[:, 1]).all())
    away = np.linalg.norm(np.subtract(*(log.truth.positions(keys, 2) for keys in table.keys.T)), axis=-1)
    near, far = np.flatnonzero(away < np.median(away)), np.argmax(away)
    robust = table.select(near).with_loss(Loss("cauchy", 4.0))
    keys = robust.keys.copy()
    keys[0] = table.keys[far]  # what was seen near is said to be far away
    (right,), (beside,) = (eyes_of([t], log.truth) for t in (robust.select(slice(1, None)), replace(robust, keys=keys)))
    assert away[far] > 1.2 * right.reach
    assert (beside.reach, beside.cosine) == (right.reach, right.cosine)


def test_what_would_not_be_seen_in_figures_is_not_told() -> None:
    """Every sighting that is told firms up the direction that it is told for by a twentieth, at least."""
    log = tied_by_heading(two_halves("2d", 1), 0.02)
    assert log.truth is not None
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    found = look_next(weak, eyes_of(log.tables, log.truth), most=100)
    assert found and all((look.before / look.after).max() >= 1.05 for look in found)
