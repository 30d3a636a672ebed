"""How the variables of the filter move together, and what the map tells of them."""

import numpy as np
import pytest

import filtered
from teamslam.geometry import Pose, rotations
from teamslam.joining import split
from teamslam.live import start_of
from teamslam.model import is_landmark, landmark_key, pack, point_kind, pose_key, pose_kind
from teamslam.robot import Atlas, Filter, Options, Robot
from teamslam.robot.order import Order
from worlds import WORLDS, team


def some(dim: int, space: int, rng: np.random.Generator) -> tuple[Order, np.ndarray, np.ndarray]:
    """A pose of now and a point that turn, another pose, a point, and a landmark with a heading that turns."""
    kinds = [pose_kind(dim), pose_kind(dim), point_kind(space), point_kind(space), pose_kind(space)]
    keys = [int(pose_key(1, 5)), int(pose_key(1, 2)), *landmark_key(np.arange(3)).tolist()]
    order = Order(np.array(keys), np.array([int(kind) for kind in kinds]), np.array([True, False, True, False, True]))
    parts = [
        pack(Pose.scattered(rng.normal(size=(1, kind.dim)), rng)).ravel() if kind.is_pose else rng.normal(size=kind.dim)
        for kind in kinds
    ]
    return order, np.concatenate(parts), rng.normal(size=dim)


@pytest.mark.parametrize(("dim", "space"), [(2, 2), (2, 3), (3, 3)])
def test_that_things_turn_is_the_derivative_of_how_they_move(dim: int, space: int) -> None:
    order, state, centre = some(dim, space, np.random.default_rng(3))
    d, n = dim, Pose.identity(dim).dof
    J = np.eye(int(order.unknowns[-1]))
    J[:, d:n] = filtered.all_turning(order, state, centre)
    J[n:, n:] = np.eye(len(J) - n)
    step = 1e-6
    for axis, column in zip(np.eye(len(J)), J.T, strict=True):
        after, before = (filtered.retract(order, state, sign * step * axis, centre) for sign in (1.0, -1.0))
        moved = filtered.minus(order, after, before)
        np.testing.assert_allclose(moved / (2.0 * step), column, atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_what_is_known_to_stay_stays_however_all_turns_about_it(dim: int) -> None:
    """Law of the group: with v = -w x (p - c) a point stands still, to third order."""
    order, state, centre = some(dim, dim, np.random.default_rng(4))
    place, group, d = 2, rotations(dim), dim
    p = order.rows(np.array([place]))
    w = np.random.default_rng(5).normal(size=group.DOF)
    off = []
    for small in (1e-1, 1e-2):
        delta = np.zeros(int(order.unknowns[-1]))
        delta[d : d + group.DOF] = small * w
        delta[order.columns(np.array([place]))] = -group.hat(small * w) @ (state[p] - centre)
        off.append(np.abs(filtered.retract(order, state, delta, centre)[p] - state[p]).max())
    assert off[1] < 2e-3 * off[0] < 1e-3


@pytest.mark.parametrize("world", WORLDS)
def test_what_the_map_tells_one_by_one_is_what_it_knows_of_all(world: str) -> None:
    """Law: whatever comes first, the filter holds the marginal of the map."""
    log = team(world, robots=1, poses=30, landmarks=9)
    (piece, *_), robot = split(log, poses_per_piece=20), Robot.of(log, 1, Options(poses_per_piece=20))
    seen = next(table for table in log.tables if is_landmark(table.keys[:, 1]).all())
    at = int(piece.pose_keys[1][-1])
    start = start_of(Atlas().with_stretch(0, 0, [piece], at).in_short(), at, robot.options.landmarks)
    assert start is not None and start.ahead is not None
    filter_: Filter = start
    for n in np.random.default_rng(6).permutation(len(seen)):
        filter_ = filter_.recalled(seen.select([n]))
    ahead, order = start.ahead, filter_.order
    assert set(order.place) == set(ahead.order.place)
    theirs = np.array([0, *(ahead.order.place[key] for key in order.keys[2:].tolist())])
    mine = np.arange(1, len(order))
    expected = ahead.covariance[np.ix_(ahead.order.columns(theirs), ahead.order.columns(theirs))]
    held = filter_.covariance[np.ix_(order.columns(mine), order.columns(mine))]
    np.testing.assert_allclose(held, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(filter_.state[order.rows(mine)], ahead.state[ahead.order.rows(theirs)], atol=1e-12)
