"""Landmarks that fit at two places: nobody commits to one of them before the team has spoken."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from strategies import generators
from teamslam.geometry import Array, Pose
from teamslam.joining import build, exact_join, full, join, split
from teamslam.joining.start.triangulate import Bundle
from teamslam.joining.start.twofold import RULED_OUT, twofold
from teamslam.model import Dataset, Kind, Loss, Table, Values, landmark_key, pack, pose_key

SIGMA = 0.05


def ranges(robot: int, poses: Pose, mark: int, place: Array, rng: np.random.Generator) -> Table:
    """One landmark seen from each of some poses by its distance."""
    lengths = np.linalg.norm(place - poses.translation, axis=1) + SIGMA * rng.normal(size=len(poses))
    keys = np.stack([pose_key(robot, np.arange(len(poses))), np.full(len(poses), int(landmark_key(mark)))], 1)
    return Table(robot, "landmarks", "range", 2, keys, lengths[:, None], np.eye(1)[None] / SIGMA, np.arange(len(poses)))


def odometry(robot: int, poses: Pose) -> Table:
    """Each pose from the one before it, without noise."""
    n = len(poses)
    keys = np.stack([pose_key(robot, np.arange(n - 1)), pose_key(robot, np.arange(1, n))], 1)
    steps = pack(poses[:-1].between(poses[1:]))
    return Table(robot, "odometry", "relative_pose", 2, keys, steps, 1e3 * np.eye(3)[None], np.arange(n - 1))


def straight(rng: np.random.Generator, n: int) -> Pose:
    """A straight drive of some metres, somewhere."""
    x, y, heading = rng.uniform(-5.0, 5.0, 3)
    way = np.stack([np.linspace(0.0, 6.0, n), np.zeros(n), np.zeros(n)], 1)
    return Pose.from_xytheta(np.array([x, y, heading])) @ Pose.from_xytheta(way)


@pytest.mark.parametrize("sharp", [1e4, 1e5, 1e6])
def test_beside_a_sharp_range_along_the_way_what_lies_across_is_not_lost_in_rounding(sharp: float) -> None:
    """From one place to another each point moves across the way alone, wherever blunt ranges want it."""
    n, rng = 2000, np.random.default_rng(1)
    ray, there = rng.normal(size=(2, n, 3))
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    eyes = np.concatenate([there - 4.0 * ray, there + 3.0 * rng.normal(size=(n, 3))])
    marks, every = landmark_key(np.arange(n)), np.arange(2 * n)
    keys = np.stack([pose_key(1, every), np.tile(marks, 2)], -1)
    sharpness = np.repeat([sharp, 0.1], n)[:, None, None]
    seen = Table(1, "landmarks", "range", 3, keys, np.full((2 * n, 1), 4.0), sharpness, every, loss=Loss("huber", 1.0))
    values = Values.of({Kind.POSE3: (keys[:, 0], Pose(np.tile(np.eye(3), (2 * n, 1, 1)), eyes))})
    places, costs, _ = Bundle.of([seen], values, marks, 3).refined(there[None], across=ray)
    assert np.abs(np.sum((places[0] - there) * ray, -1)).max() < 1e-12 and np.isfinite(costs).all()


@settings(max_examples=40)
@given(generators, st.integers(3, 12))
def test_the_mirror_of_a_landmark_beside_a_straight_drive_is_found(rng: np.random.Generator, n: int) -> None:
    """Where it is, in the mirror of the drive, at the same cost; and its sightings travel raw."""
    way = straight(rng, n)
    local = np.array([rng.uniform(0.0, 6.0), rng.choice([-1.0, 1.0]) * rng.uniform(1.5, 8.0)])
    mark = way[0].act(local)
    seen = ranges(1, way, 1, mark, rng)
    values = Values.of({Kind.POSE2: (seen.keys[:, 0], way), Kind.POINT2: (landmark_key(np.array([1])), mark[None])})
    (found,) = twofold(values, [seen])
    assert found.keys.tolist() == [int(landmark_key(1))] and not found.by_nature.any()
    mirror = way[0].act(local * [1.0, -1.0])
    assert np.linalg.norm(found.others[0] - mirror) < 2.0 * np.linalg.norm(mark - mirror) * 0.25
    assert abs(found.more[0]) < 1e-3
    submap = build(Dataset({1: 2}, (odometry(1, way), seen)))
    assert not submap.values.layout.contains(landmark_key(1)) and sum(map(len, submap.raw)) == n


@given(generators)
def test_what_ranges_from_all_sides_hold_is_in_the_submap(rng: np.random.Generator) -> None:
    """A drive round it leaves no second place."""
    angles = np.linspace(0.0, 5.0, 12)
    way = Pose.from_xytheta(np.stack([4.0 * np.cos(angles), 4.0 * np.sin(angles), angles + np.pi / 2], 1))
    seen = ranges(1, way, 1, rng.uniform(-2.0, 2.0, 2), rng)
    submap = build(Dataset({1: 2}, (odometry(1, way), seen)))
    assert submap.values.layout.contains(landmark_key(1)) and not submap.raw


@pytest.mark.slow
@settings(max_examples=20)
@given(generators)
def test_the_team_decides(rng: np.random.Generator) -> None:
    """Two robots drive straight past the same landmarks: alone neither knows the sides, together they do."""
    first = Pose.from_xytheta(np.stack([np.linspace(0.0, 6.0, 8), np.zeros(8), np.zeros(8)], 1))
    second = Pose.from_xytheta(np.stack([np.full(8, 8.0), np.linspace(-6.0, 3.0, 8), np.full(8, np.pi / 2)], 1))
    places = rng.uniform(-7.0, 7.0, (2, 2)) + np.array([3.0, 0.0])
    assume((np.abs(places[:, 1]) > 1.5).all() and (np.abs(places[:, 0] - 8.0) > 1.5).all())
    met = Table(
        1, "robots", "relative_pose", 2,
        np.array([[int(pose_key(1, 7)), int(pose_key(2, 4))]]),
        pack(first[7].between(second[4]))[None], 1e3 * np.eye(3)[None], np.arange(1),
    )  # fmt: skip
    tables = [odometry(1, first), odometry(2, second), met]
    for number, place in enumerate(places):
        for robot, way in ((1, first), (2, second)):
            seen = ranges(robot, way, number, place, rng)
            tables.append(Table(**(vars_of(seen) | {"ids": seen.ids + 100 * number})))
    log = Dataset({1: 2, 2: 2}, tuple(tables))
    pieces = split(log)
    for joined in (join([build(piece) for piece in pieces]), exact_join(pieces), full(log)):
        assert len(joined.components) == 1 and joined.converged
        got = joined.map.values.positions(landmark_key(np.arange(2)), 2)
        np.testing.assert_allclose(got, first[0].inverse().act(places), atol=12.0 * SIGMA)


def vars_of(table: Table) -> dict[str, object]:
    """Its fields by name."""
    return {name: getattr(table, name) for name in Table.__dataclass_fields__}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_robots_of_a_plane_all_put_what_is_off_it_above(side: float) -> None:
    """Ranges from one height leave open for ever whether a landmark is above or below: all say above."""
    rng = np.random.default_rng(7)
    angles = np.linspace(0.0, 5.0, 12)
    way = Pose.from_xytheta(np.stack([4.0 * np.cos(angles), 4.0 * np.sin(angles), angles + np.pi / 2], 1))
    place = np.array([1.0, -0.5, 3.0 * side])
    eyes = np.column_stack([way.translation, np.zeros(12)])
    lengths = np.linalg.norm(place - eyes, axis=1) + SIGMA * rng.normal(size=12)
    keys = np.stack([pose_key(1, np.arange(12)), np.full(12, int(landmark_key(1)))], 1)
    seen = Table(1, "landmarks", "range", 3, keys, lengths[:, None], np.eye(1)[None] / SIGMA, np.arange(12))
    submap = build(Dataset({1: 2}, (odometry(1, way), seen)))
    assert submap.values.positions(landmark_key(np.array([1])), 3)[0, 2] == pytest.approx(3.0, abs=0.5)


@pytest.mark.slow
@settings(max_examples=60)
@given(generators, st.integers(6, 10))
def test_a_second_place_is_where_a_search_ends(rng: np.random.Generator, n: int) -> None:
    """Along a valley that bends, on which ranges from places close together leave a landmark, nobody stops half way:
    a search by simplices that begins at a second place stays there."""
    steps = np.cumsum(rng.normal(scale=0.6, size=(n, 3)), 0)
    way, mark = Pose(np.broadcast_to(np.eye(3), (n, 3, 3)), steps), rng.normal(scale=8.0, size=3)
    sigma = rng.uniform(0.1, 0.5)
    lengths = np.linalg.norm(mark - steps, axis=1) + sigma * rng.normal(size=n)
    keys = np.stack([pose_key(1, np.arange(n)), np.full(n, int(landmark_key(1)))], 1)
    seen = Table(1, "landmarks", "range", 3, keys, lengths[:, None], np.eye(1)[None] / sigma, np.arange(n))

    def cost(place: Array) -> float:
        return float(np.sum((np.linalg.norm(place - steps, axis=1) - lengths) ** 2)) / sigma**2

    simplex = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000}
    here = minimize(cost, mark, method="Nelder-Mead", options=simplex).x
    values = Values.of({Kind.POSE3: (keys[:, 0], way), Kind.POINT3: (landmark_key(np.array([1])), here[None])})
    for two in twofold(values, [seen]):
        for there, more in zip(two.others, two.more, strict=True):
            if more < RULED_OUT:
                ended = minimize(cost, there, method="Nelder-Mead", options=simplex)
                assert ended.fun > cost(there) - 0.05, (there, ended.x)


@settings(max_examples=10)
@given(generators)
def test_pits_that_losses_dig_are_no_two_places(rng: np.random.Generator) -> None:
    """Bearings from two sides that contradict each other, under a loss that forgives: each pair of rays that meet is a
    pit. Ranges of a drive round the landmark leave no mirror of it, and what they say is one place."""
    turns = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    way = Pose.from_xytheta(np.stack([4.0 * np.cos(turns), 4.0 * np.sin(turns), turns], 1))
    mark = np.array([0.1, 0.2])
    seen = ranges(1, way, 1, mark, rng)
    seen = replace(seen, whitening=np.eye(1)[None] / 0.3)
    at = (np.arctan2(*(way.inverse().act(mark + np.array([off, 0.0])).T[::-1])) for off in (0.0, 0.35))
    first, second = at
    rays = np.where(np.arange(8) % 2 == 0, first, second)[:, None]
    bearings = replace(seen, model="bearing", values=rays, whitening=np.full((1, 1, 1), 1e4), loss=Loss("cauchy", 2.0))
    values = Values.of({Kind.POSE2: (seen.keys[:, 0], way), Kind.POINT2: (landmark_key(np.array([1])), mark[None])})
    assert not twofold(values, [seen, bearings])[0].keys.size
