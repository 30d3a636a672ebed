"""What is known of a shape, against SciPy's dense decompositions."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from hung import tied_by_heading, two_halves
from strategies import random_poses
from teamslam.geometry import Pose
from teamslam.joining import AtMap, full
from teamslam.joining.exact.gap import point_of
from teamslam.model import Dataset, Kind, Names, Table, Values, landmark_key, pose_key
from teamslam.sim import Options, simulate
from teamslam.solver import System
from teamslam.trust.weak import Knowledge, knowledge_from, knowledge_of
from teamslam.trust.weak.directions import Conditioned
from teamslam.trust.weak.knowledge import knowledge_at, listed
from worlds import WORLDS, chain, measure, mixed_team, team

LOOSE = {"2d": (3, 1, 0, 0), "planar": (3, 1, 0, 0), "3d": (6, 3, 1, 0)}
"""Freedoms between two halves that share no landmark, one, two, three."""


def dense(known: Knowledge, log: Dataset, values: Values) -> tuple[np.ndarray, np.ndarray]:
    """P and H by the pseudoinverse of the whole matrix, in the metric."""
    H = System(values.layout, tables=log.tables).linearise(values).hessian.to_csr().toarray()
    root = np.sqrt(known.weight)
    return scipy.linalg.pinvh(H / np.outer(root, root), rtol=1e-11) / np.outer(root, root), H


def logs() -> dict[str, Dataset]:
    """Teams that hang together, by a thread, and not."""
    halves = {f"{w}, {k} shared": two_halves(w, k, seed=k) for w in WORLDS for k in range(4)}
    threads = {f"{w}, by a thread": tied_by_heading(two_halves(w, 1), 0.2) for w in WORLDS}
    return {**halves, **threads, "mixed": mixed_team()}


LOGS = logs()


@pytest.mark.parametrize("name", LOGS)
def test_covariance_of_the_shape_is_the_pseudoinverse(name: str) -> None:
    log = LOGS[name]
    known = knowledge_from(log.tables, log.truth, log.names)
    P, _ = dense(known, log, log.truth)
    eye = np.eye(len(P))
    np.testing.assert_allclose(known.spread(eye), P, rtol=1e-5, atol=1e-7 * np.abs(P).max())
    blocks = listed(log.truth.layout, known.stacks)
    for block, (start, stop) in zip(blocks, pairwise(log.truth.layout.dof_start), strict=True):
        np.testing.assert_allclose(block, P[start:stop, start:stop], rtol=1e-5, atol=1e-7 * np.abs(P).max())


@pytest.mark.parametrize("shared", range(4))
@pytest.mark.parametrize("world", WORLDS)
def test_what_hangs_loose_is_the_null_space(world: str, shared: int) -> None:
    log = two_halves(world, shared, seed=shared)
    known = knowledge_from(log.tables, log.truth, log.names)
    _, H = dense(known, log, log.truth)
    root = np.sqrt(known.weight)
    null = scipy.linalg.null_space(H / np.outer(root, root), rcond=1e-11)
    assert known.unknown.shape[1] == LOOSE[world][shared] == null.shape[1] - known.frame.shape[1]
    spanned = root[:, None] * np.concatenate([known.frame, known.unknown], 1)
    np.testing.assert_allclose(spanned @ spanned.T, null @ null.T, atol=1e-7)


@pytest.mark.parametrize("world", WORLDS)
def test_the_weakest_direction_is_the_first_principal_axis(world: str) -> None:
    """And once something is known, that of the Schur complement."""
    log = tied_by_heading(two_halves(world, 1), 0.2)
    known = knowledge_from(log.tables, log.truth, log.names)
    P, _ = dense(known, log, log.truth)
    root = np.sqrt(known.weight)
    functions = np.zeros((len(P), 0))
    rng = np.random.default_rng(1)
    for _ in range(3):
        left = Conditioned(known, functions)
        given = P - P @ functions @ np.linalg.pinv(functions.T @ P @ functions) @ functions.T @ P
        values, vectors = scipy.linalg.eigh(given * np.outer(root, root))
        field, variance = left.weakest()
        assert variance == pytest.approx(values[-1], rel=1e-5)
        assert left.total == pytest.approx(values.sum(), rel=1e-5)
        if values[-1] > 1.5 * values[-2]:
            assert abs((root * field) @ vectors[:, -1]) == pytest.approx(1.0, abs=1e-5)
        functions = np.concatenate([functions, rng.standard_normal((len(P), 1))], 1)


def test_large_maps_are_decomposed_as_small_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """By Lanczos, to the same direction."""
    log = tied_by_heading(two_halves("2d", 1), 0.2)
    left = Conditioned(knowledge_from(log.tables, log.truth, log.names), np.zeros((log.truth.layout.dof, 0)))
    field, variance = left.weakest()
    monkeypatch.setattr("teamslam.trust.weak.directions.DENSE", 0)
    again, same = left.weakest()
    assert same == pytest.approx(variance, rel=1e-6)
    assert abs(again @ (left.knowledge.weight * field)) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("world", WORLDS)
def test_the_frame_of_a_map_makes_no_difference(world: str) -> None:
    """A map and its measurements, written in any frame, know the same."""
    log = team(world, poses=8)
    joined = full(log).map
    of_map = knowledge_of(joined)
    values = point_of(joined)
    dim = 3 if world == "3d" else 2
    moved = values.transform(random_poses(np.random.default_rng(3), dim))
    elsewhere = knowledge_from(log.tables, moved, log.names)
    of_tables = knowledge_from(log.tables, values, log.names)
    for one, other in ((of_map, of_tables), (of_tables, elsewhere)):
        mine = Conditioned(one, np.zeros((values.layout.dof, 0)))
        theirs = Conditioned(other, np.zeros((values.layout.dof, 0)))
        assert one.motions.lever == pytest.approx(other.motions.lever, rel=0.5)
        assert mine.least.place_m == pytest.approx(theirs.least.place_m, rel=0.02)
    exact = Conditioned(elsewhere, np.zeros((values.layout.dof, 0)))
    assert exact.total == pytest.approx(Conditioned(of_tables, np.zeros((values.layout.dof, 0))).total, rel=1e-6)
    assert exact.least.place_m == pytest.approx(Conditioned(of_tables, exact.functions).least.place_m, rel=1e-6)


@pytest.mark.parametrize("world", WORLDS)
def test_the_factor_in_the_frame_of_a_pose_knows_the_same(world: str) -> None:
    """The factor at a map, in which its base does not move, gives the pseudoinverse of all."""
    log = team(world, poses=8)
    at = AtMap(log.tables, full(log).map)
    known = knowledge_at(at)
    P, _ = dense(known, log, at.values)
    np.testing.assert_allclose(known.spread(np.eye(len(P))), P, rtol=1e-5, atol=1e-7 * np.abs(P).max())
    assert known.total == pytest.approx(float(known.weight @ np.diagonal(P)), rel=1e-6)
    for block, (start, stop) in zip(
        listed(at.values.layout, known.stacks), pairwise(at.values.layout.dof_start), strict=True
    ):
        np.testing.assert_allclose(block, P[start:stop, start:stop], rtol=1e-5, atol=1e-7 * np.abs(P).max())


@pytest.mark.parametrize("world", WORLDS)
def test_a_map_in_the_world_has_no_motion_that_nobody_sees(world: str) -> None:
    """Its covariance is the map's own."""
    log = simulate(world, seed=2)
    first = log.pose_keys[1][[0, 20, 40, 59]]
    dim = log.robots[1]
    fixes = Table(1, "fixes", "position", dim, first[:, None], log.truth.positions(first, dim),
                  np.eye(dim)[None] / 0.1, np.arange(4))  # fmt: skip
    tables = [*log.tables, fixes]
    known = knowledge_from(tables, log.truth, log.names)
    assert known.frame.shape[1] == known.unknown.shape[1] == 0
    H = System(log.truth.layout, tables=tables).linearise(log.truth).hessian.to_csr().toarray()
    np.testing.assert_allclose(known.spread(np.eye(len(H))), np.linalg.inv(H), rtol=1e-4, atol=1e-9)


def test_what_is_told_twice_is_told_once() -> None:
    """A combination that is known already, or that others of the known ones make up, changes nothing."""
    log = simulate(Options(space="2d", robots=2, poses=12, landmarks=6), seed=4)
    known = knowledge_of(full(log).map)
    rng = np.random.default_rng(1)
    one, other = rng.standard_normal((2, len(known.weight)))
    twice = Conditioned(known, np.stack([one, other, one, one - 3.0 * other], 1))
    once = Conditioned(known, np.stack([one, other], 1))
    for f in rng.standard_normal((5, len(known.weight))):
        assert f @ twice.spread(f) == pytest.approx(f @ once.spread(f), rel=1e-6)
    assert one @ twice.spread(one) == pytest.approx(0.0, abs=1e-9 * (one @ known.spread(one)))
    assert twice.least.place_m == pytest.approx(once.least.place_m, rel=1e-6)


def test_fine_steps_are_no_reason_for_parts_to_hang_loose() -> None:
    """Steps of a millimetre, known to a hundredth of it: 1e14 times as stiff as the map as a whole is, and all held."""
    keys, marks = pose_key(1, np.arange(400)), landmark_key(np.arange(4))
    way = Pose.from_xytheta(np.stack([1e-3 * np.arange(400), np.zeros(400), np.zeros(400)], -1))
    places = np.array([[5.0, 3.0], [4.0, -4.0], [-3.0, 2.0], [-4.0, -3.0]])
    truth = Values.of({Kind.POSE2: (keys, way), Kind.POINT2: (marks, places)})
    looks = np.stack([np.repeat(keys[::40], 4), np.tile(marks, 10)], -1)
    rng = np.random.default_rng(0)
    tables = (
        measure(1, "odometry", "relative_pose", 2, chain(keys), 1e-5, truth, rng),
        measure(1, "landmarks", "point", 2, looks, 0.1, truth, rng),
    )
    log = Dataset({1: 2}, tables, Names(tick_s=1.0), truth)
    joined = full(log).map
    for known in (
        knowledge_at(AtMap(log.tables, joined)),
        knowledge_of(joined),
        knowledge_from(tables, truth, log.names),
    ):
        assert known.unknown.shape[1] == 0
        # All poses are as one, which saw each landmark ten times: between two of them the sum of both.
        unit = np.zeros(truth.layout.dof)
        own = truth.layout.unknowns(marks[:2])
        unit[own[0]], unit[own[2]] = 1.0, -1.0
        assert unit @ known.spread(unit) == pytest.approx(0.1**2 / 10 * 2, rel=0.4)
