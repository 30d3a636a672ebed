"""Ranges between robots hold bodies together: the true frame is an assembly, and what they leave open shows."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from strategies import dims, generators, random_poses
from teamslam.geometry import Array, Pose, rotations
from teamslam.joining import build, exact_join, full, join, split
from teamslam.joining.place.frameworks import assemblies, left_open
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.place import place
from teamslam.joining.place.ranges import MOST, Ranges, Rods
from teamslam.model import Dataset, Submap
from worlds import team

EXACT = 1e-6  # as noise: far below what any test asks for


def way(keys: Array, places: Array) -> Outline:
    """A robot's own poses, known to a millimetre."""
    n, d = places.shape
    spatial = np.concatenate([places, np.zeros((n, 3 - d))], -1)
    yes = np.ones(n, bool)
    return Outline(keys, spatial, np.tile(np.eye(3), (n, 1, 1)), yes, np.full(n, 1e-6), np.full(n, 1e-6), yes)


def two_ways(rng: np.random.Generator, dim: int, frame: Pose, n: int = 30) -> tuple[list[Outline], Ranges]:
    """Two robots that drove about, and how far they were from each other, each seen from its own start."""
    first, second = rng.normal(scale=3.0, size=(2, n, dim))
    keys = np.stack([np.arange(n), n + np.arange(n)], -1)
    lengths = np.linalg.norm(first - frame.act(second), axis=-1)
    ranges = Ranges(keys, np.zeros((n, 3)), lengths, np.full(n, 1e-3), np.full(n, dim == 3))
    return [way(keys[:, 0], first), way(keys[:, 1], second)], ranges


@settings(max_examples=25)
@given(generators, dims)
def test_the_true_frame_is_an_assembly(rng: np.random.Generator, dim: int) -> None:
    frame = random_poses(rng, dim, turn=3.0)
    bodies, ranges = two_ways(rng, dim, frame)
    found = assemblies(bodies, dim, ranges)
    assert min(float(np.abs(f[1].minus(frame)).max()) for f in found) < 1e-4
    assert left_open(bodies, dim, ranges) == 0


@given(generators, dims)
def test_rods_are_differentiated_by_twists(rng: np.random.Generator, dim: int) -> None:
    frame = random_poses(rng, dim, turn=3.0)
    bodies, ranges = two_ways(rng, dim, frame, 8)
    rods = Rods.of(ranges, bodies, dim)
    frames = Pose(np.stack([np.eye(dim), frame.rotation])[None], np.stack([np.zeros(dim), frame.translation])[None])
    centre, step = rng.normal(size=dim), 1e-6
    found = rods.jacobian(frames, np.broadcast_to(centre, (1, 2, dim)))[0]
    for k, unit in enumerate(np.eye(found.shape[1])):
        ends = []
        for s in (step, -step):
            turn = rotations(dim).exp(s * unit[dim:])
            moved = Pose(turn, centre + s * unit[:dim] - turn @ centre) @ frame
            rotation, translation = frames.rotation.copy(), frames.translation.copy()
            rotation[0, 1], translation[0, 1] = moved.rotation, moved.translation
            ends.append(rods.residual(Pose(rotation, translation))[0])
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / (2.0 * step), atol=1e-2)


@settings(max_examples=15)
@given(generators)
def test_a_robot_that_stood_still_may_have_looked_anywhere(rng: np.random.Generator) -> None:
    bodies, ranges = two_ways(rng, 2, random_poses(rng, 2, turn=3.0))
    still = way(bodies[1].keys, np.zeros((len(bodies[1].keys), 2)))
    seen = bodies[0].places[:, :2] - rng.normal(scale=3.0, size=2)
    heard = Ranges(ranges.keys, ranges.mounts, np.linalg.norm(seen, axis=-1), ranges.sigmas, ranges.spatial)
    assert assemblies([bodies[0], still], 2, heard) == []
    assert left_open([bodies[0], still], 2, heard) == 1


def test_straight_ways_have_a_mirror_image() -> None:
    """Both robots drove straight on: seen from the first, the second may have passed on its left or its right."""
    along = np.linspace(0.0, 6.0, 20)[:, None] * np.array([[1.0, 0.0]])
    when = np.random.default_rng(0).permutation(20)
    frame = Pose.from_xytheta(np.array([1.0, 2.0, 0.7]))
    lengths = np.linalg.norm(along - frame.act(along[when]), axis=-1)
    keys = np.stack([np.arange(20), 20 + when], -1)
    ranges = Ranges(keys, np.zeros((20, 3)), lengths, np.full(20, 1e-3), np.zeros(20, bool))
    found = assemblies([way(np.arange(20), along), way(20 + np.arange(20), along)], 2, ranges)
    seen = sorted(f[1].xytheta().round(4).tolist() for f in found)
    np.testing.assert_allclose(seen, [[1.0, -2.0, -0.7], [1.0, 2.0, 0.7]], atol=1e-3)


def test_very_many_rods_are_thinned_evenly() -> None:
    bodies, ranges = two_ways(np.random.default_rng(0), 2, Pose.identity(2), 5 * MOST)
    rods = Rods.of(ranges, bodies, 2)
    assert rods.rows == MOST
    assert set(rods.lengths.tolist()) <= set(ranges.lengths.tolist())


# --- teams --------------------------------------------------------------------------------------------------------


def only_ranges(world: str, sigma: float, every: int = 1, robots: int = 2, seed: int = 0) -> Dataset:
    """Robots that share nothing but how far they were from each other."""
    dataset = team(
        world, robots=robots, robot_model="range", poses=24, sigma=sigma, sigma_odometry=sigma, every=every, seed=seed
    )
    return dataset.with_tables(t for t in dataset.tables if t.source != "landmarks")


def built(dataset: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(dataset)]


# Two robots in space that fly alike, on flat circles, stay open in one direction; three do not.
MET = [("2d", 2), ("2d", 3), ("planar", 2), ("planar", 3), ("3d", 3)]


@pytest.mark.parametrize(("world", "robots"), MET)
def test_ranges_alone_place_a_team(world: str, robots: int) -> None:
    dataset = only_ranges(world, EXACT, robots=robots)
    submaps = built(dataset)
    (cluster,) = place(submaps).clusters
    assert dataset.truth is not None
    root = dataset.truth.pose(submaps[cluster.members[0]].base)
    true = [root.between(dataset.truth.pose(submaps[n].base)) for n in cluster.members]
    off = [
        max(float(np.abs(f.minus(t)).max()) for f, t in zip(frames, true, strict=True))
        for frames in (cluster.frames, *cluster.others)
    ]
    assert min(off) < 1e-3


@pytest.mark.parametrize(("world", "robots"), MET)
def test_a_team_joined_by_ranges_is_the_full_least_squares(world: str, robots: int) -> None:
    dataset = only_ranges(world, 0.01, robots=robots)
    exact = exact_join(split(dataset))
    assert len(exact.components) == 1
    np.testing.assert_allclose(exact.map.values.minus(full(dataset).map.values), 0.0, atol=1e-6)


def test_joining_by_ranges_does_not_depend_on_the_order() -> None:
    submaps = built(only_ranges("2d", 0.01, robots=3))
    first, *others = (join(order).map.values.state for order in itertools.permutations(submaps))
    for other in others:
        np.testing.assert_array_equal(first, other)


def test_few_ranges_leave_robots_apart_and_say_so() -> None:
    joined = join(built(only_ranges("2d", 0.02, every=23)))
    assert len(joined.components) == 2
    (reason,) = joined.reasons
    assert "2 ranges" in reason or "4 ranges" in reason
    assert "open: under-constrained" in reason and "would join them" in reason


def test_ranges_that_fit_no_frame_are_named() -> None:
    dataset = only_ranges("2d", 0.01)
    rng = np.random.default_rng(0)
    wrong = dataset.with_tables(
        t if t.source == "odometry" else replace(t, values=rng.permutation(t.values) + 3.0) for t in dataset.tables
    )
    (reason,) = join(built(wrong)).reasons
    assert "no frame fits them" in reason and "look for wrong ranges" in reason
