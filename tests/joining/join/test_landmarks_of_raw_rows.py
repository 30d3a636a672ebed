"""Landmarks that no submap holds, but rows that travel with the submaps: surveyed ones, and those of a bare way."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.joining import accounted, build, exact_join, full, join, split
from teamslam.joining.build.build import _descended
from teamslam.joining.build.problem import Begun, Problem, gaussian_part
from teamslam.model import WORLD, Dataset, is_landmark, landmark_key, pose_key
from teamslam.solver.optimise import DEFAULTS
from worlds import WORLDS, measure, team

LONELY = landmark_key(np.array([0]))
SIGMA = 0.02


def surveyed(world: str, *, anchors: int, bearings: int = 0) -> Dataset:
    """A team of which the first robot knows the world's position of some of its poses and of a landmark, which nobody
    sees but by some bearings from its last pose."""
    log = team(world, robots=2, poses=10)
    assert log.truth is not None
    rng, dim, of_points = np.random.default_rng(0), log.robots[1], 2 if world == "2d" else 3
    last = np.stack([np.full(bearings, pose_key(1, 9)), np.full(bearings, LONELY[0])], -1)
    tables = [
        *(t.select(t.keys[:, -1] != LONELY[0]) for t in log.tables),
        measure(1, "world", "position", dim, pose_key(1, np.arange(anchors))[:, None], SIGMA, log.truth, rng),
        measure(1, "marks", "position", of_points, LONELY[:, None], SIGMA, log.truth, rng),
        *([measure(1, "rays", "bearing", 2, last, SIGMA, log.truth, rng)] if bearings else []),
    ]
    return replace(log, tables=tuple(t for t in tables if len(t)))


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("bearings", [0, 2])
def test_what_was_surveyed_is_where_it_was_surveyed(world: str, bearings: int) -> None:
    """Whether anybody sees it or not; with what little is seen of it, as least squares have it."""
    log = surveyed(world, anchors=10, bearings=0 if world == "3d" else bearings)
    joined, whole, exact = join([build(p) for p in split(log)]), full(log), exact_join(split(log))
    for found in (joined, whole, exact):
        assert found.map.base == WORLD and found.converged and not accounted(log, found).left_out
    np.testing.assert_allclose(exact.map.values.minus(whole.map.values), 0.0, atol=1e-7)
    if not bearings:
        (measured,) = (t.values[0] for t in log.tables if t.source == "marks")
        for found in (joined, whole, exact):
            place = found.map.values.positions(LONELY, len(measured))[0]
            np.testing.assert_allclose(place, measured, atol=1e-9)


def test_what_was_surveyed_waits_for_a_map_that_is_free_to_turn() -> None:
    log = surveyed("2d", anchors=1)
    joined = accounted(log, join([build(p) for p in split(log)]))
    assert joined.map.base != WORLD and joined.converged
    (lost,) = (one for one in joined.left_out if one.kind == "landmark")
    assert lost.keys.tolist() == LONELY.tolist() and "free to shift or turn in the world" in lost.reason


@pytest.mark.parametrize("world", WORLDS)
def test_from_bare_ways_the_exact_join_is_full_least_squares(world: str) -> None:
    """The way that stands for a piece of which no submap can be built holds its relative poses; all else travels."""
    log = team(world, sigma=0.05, sigma_odometry=0.05)
    pieces = split(log)
    bare = [next(_descended(Problem.bare(piece, Begun.of(piece)), None, 0, DEFAULTS, None))[0] for piece in pieces]
    for number, (piece, way) in enumerate(zip(pieces, bare, strict=True), start=1):
        assert not is_landmark(way.values.layout.keys).any()
        inside, _ = gaussian_part(piece.tables, number, way.trajectory_keys(number), way.all_values.layout)
        assert sum(map(len, inside)) + sum(map(len, way.raw)) == sum(map(len, piece.tables))
    exact, whole = exact_join(pieces, choices=[[way] for way in bare]), full(log)
    assert len(exact.components) == 1 and exact.converged and not accounted(log, exact).left_out
    np.testing.assert_allclose(exact.map.values.minus(whole.map.values), 0.0, atol=1e-7)
