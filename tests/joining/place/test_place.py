"""Placing submaps from nothing: wrong links are outvoted, trusses assembled, what stays free is counted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from joining.place.trusses import assemblies, freedom
from strategies import dims, generators, random_poses
from teamslam.geometry import Array, Pose
from teamslam.joining import build, exact_join, full, join, split
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.place import Cluster, place
from teamslam.joining.place.robust_fit import HINGE, link
from teamslam.joining.place.ties import Tied
from teamslam.joining.place.trusses import Body, Trusses
from teamslam.model import Dataset, Loss, Submap, Table, pack
from worlds import WORLDS, measure, team

EXACT = 1e-6  # as noise: far below what any test asks for


def built(dataset: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(dataset)]


def misplaced(dataset: Dataset, submaps: list[Submap], members: list[int], frames: list[Pose]) -> float:
    """The largest error of any frame, seen from the cluster's root."""
    assert dataset.truth is not None
    root = dataset.truth.pose(submaps[members[0]].base)
    true = [root.between(dataset.truth.pose(submaps[n].base)) for n in members]
    return max(float(np.abs(f.minus(t)).max()) for f, t in zip(frames, true, strict=True))


def best_misplaced(dataset: Dataset, submaps: list[Submap], cluster: Cluster) -> float:
    """The same, of the assembly that is nearest to the truth."""
    return min(misplaced(dataset, submaps, cluster.members, f) for f in (cluster.frames, *cluster.others))


def outline(keys: list[int], places: Array) -> Outline:
    """Points known to a millimetre."""
    n, d = places.shape
    spatial = np.concatenate([places, np.zeros((n, 3 - d))], -1)
    no = np.zeros(n, bool)
    return Outline(np.array(keys), spatial, np.tile(np.eye(3), (n, 1, 1)), no, np.full(n, 1e-6), np.zeros(n), no)


# --- wrong links --------------------------------------------------------------------------------------------------


def with_exchanged(table: Table, pairs: list[tuple[int, int]]) -> Table:
    """A robot that takes each of two landmarks for the other."""
    keys = table.keys.copy()
    for a, b in pairs:
        first, second = table.keys[:, 1] == a, table.keys[:, 1] == b
        keys[first, 1], keys[second, 1] = b, a
    return replace(table, keys=keys)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("pairs", [1, 2])
def test_exchanged_landmarks_are_outvoted(world: str, pairs: int) -> None:
    dataset = team(world, robots=2, landmarks=10, poses=20, sigma=EXACT, sigma_odometry=EXACT, sees=0.6)
    marks = dataset.landmark_keys.tolist()
    wrong = [(marks[0], marks[1]), (marks[2], marks[3])][:pairs]
    tables = [t for t in dataset.tables if t.source != "robots"]
    dataset = dataset.with_tables(
        with_exchanged(t, wrong) if t.source == "landmarks" and t.robot == 1 else t for t in tables
    )
    submaps = built(dataset)
    (cluster,) = place(submaps).clusters
    assert misplaced(dataset, submaps, cluster.members, cluster.frames) < 1e-3


def with_a_wild_row(table: Table, row: int) -> Table:
    values = table.values.copy()
    tangent = np.array([4.0, -3.0, 2.5]) if table.dim == 2 else np.array([4.0, -3.0, 2.0, 1.0, -1.0, 1.5])
    values[row] = pack(Pose.from_tangent(tangent, table.dim))
    return replace(table, values=values)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("with_landmarks", [True, False])
def test_a_wild_sighting_of_a_robot_is_outvoted(world: str, with_landmarks: bool) -> None:
    """By landmarks, or by the other sightings of robots."""
    dataset = team(world, robots=2, landmarks=5, poses=20, sigma=EXACT, sigma_odometry=EXACT, sees=0.6, every=6)
    odometry = [t for t in dataset.tables if t.source == "odometry"]
    landmarks = [t for t in dataset.tables if t.source == "landmarks"]
    first, second = (t for t in dataset.tables if t.source == "robots")
    wild = with_a_wild_row(first, 1)
    others = [*landmarks, wild.select(np.array([1]))] if with_landmarks else [wild, second]
    dataset = dataset.with_tables([*odometry, *others])
    submaps = built(dataset)
    (cluster,) = place(submaps).clusters
    assert misplaced(dataset, submaps, cluster.members, cluster.frames) < 1e-3


@pytest.mark.parametrize("world", WORLDS)
def test_robust_sightings_of_robots_place_them_too(world: str) -> None:
    """They travel raw, beside the submaps, and are all that these two share."""
    dataset = team(world, robots=2, sigma=EXACT, sigma_odometry=EXACT).with_loss(Loss("huber", 2.0))
    dataset = dataset.with_tables(t for t in dataset.tables if t.source != "landmarks")
    submaps = built(dataset)
    assert all(s.raw for s in submaps)
    (cluster,) = place(submaps).clusters
    assert misplaced(dataset, submaps, cluster.members, cluster.frames) < 1e-4


def test_points_that_hold_no_frame_do_not_outvote_a_pose() -> None:
    """Two landmarks a hand apart agree with each other, but not on where the robot is that was seen."""
    points = np.array([[2.0, 0.0], [2.1, 0.0], [0.0, 1.0]])
    here = outline([1, 2, 3], points + np.array([[3.0, 0.0], [3.0, 0.0], [0.0, 0.0]]))
    there = outline([1, 2, 3], points)
    seen = np.array([False, False, True])
    found = link(replace(here, oriented=seen), replace(there, oriented=seen), True)
    assert found.holds
    np.testing.assert_allclose(found.frame.minus(Pose.identity(2)), 0.0, atol=0.02)


@given(generators, dims)
def test_a_link_is_the_motion_between_two_views(rng: np.random.Generator, dim: int) -> None:
    frame, places = random_poses(rng, dim, turn=3.0), rng.normal(scale=3.0, size=(7, dim))
    found = link(outline(list(range(7)), frame.act(places)), outline(list(range(7)), places), dim == 2)
    np.testing.assert_allclose(found.frame.minus(frame), 0.0, atol=1e-9)
    assert found.holds and found.firmness > HINGE


# --- what stays free ----------------------------------------------------------------------------------------------

LINE = np.outer([-2.0, 1.0, 3.0], [1.0, 2.0, 0.5])


@pytest.mark.parametrize(
    ("dim", "places", "free"),
    [
        (2, [[1.0, 2.0]], 1),
        (2, [[1.0, 2.0], [3.0, -1.0]], 0),
        (2, [[1.0, 2.0], [1.0, 2.0]], 1),  # one above the other
        (3, [[1.0, 2.0, 0.5]], 3),
        (3, LINE[:2], 1),
        (3, LINE, 1),
        (3, [*LINE[:2], [0.0, 2.0, -2.0]], 0),
    ],
)
def test_freedom_is_the_nullity_of_the_twists(dim: int, places: list[list[float]], free: int) -> None:
    """mathematics, 2: in the plane one landmark leaves 1; in space one leaves 3, two or any number in line leave 1."""
    points = np.array(places)
    shared = outline(list(range(len(points))), points)
    assert freedom(shared, dim == 2) == free
    assert link(shared, shared, dim == 2).holds == (free == 0)


# --- trusses ------------------------------------------------------------------------------------------------------


def triangle(rng: np.random.Generator, corners: Array) -> tuple[list[Outline], Pose]:
    """Three planar bodies, each with two of the corners, in frames of their own; and those frames."""
    frames = random_poses(rng, 2, 3, turn=3.0)
    views = [frames[b].unact(corners[[b, (b + 1) % 3]]) for b in range(3)]
    return [outline(sorted([b, (b + 1) % 3]), v if b < 2 else v[::-1]) for b, v in enumerate(views)], frames


@settings(max_examples=15)
@given(generators)
def test_a_triangle_of_bars_has_two_assemblies(rng: np.random.Generator) -> None:
    """The true one, and its mirror image: the same sides, the other sense of rotation."""
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]]) + rng.uniform(-0.8, 0.8, (3, 2))
    bodies, frames = triangle(rng, corners)
    found = assemblies(bodies, [True] * 3)
    assert len(found) == 2
    true = frames[0].between(frames)
    assert min(max(float(np.abs(f[b].minus(true[b])).max()) for b in range(3)) for f in found) < 1e-5
    senses = []
    for assembly in found:
        seen = {
            k: assembly[b].act(s.places[n, :2]) for b, s in enumerate(bodies) for n, k in enumerate(s.keys.tolist())
        }
        sides = [np.linalg.norm(seen[(k + 1) % 3] - seen[k]) for k in range(3)]
        np.testing.assert_allclose(
            sides, [np.linalg.norm(corners[(k + 1) % 3] - corners[k]) for k in range(3)], atol=1e-5
        )
        (ax, ay), (bx, by) = seen[1] - seen[0], seen[2] - seen[0]
        senses.append(np.sign(ax * by - ay * bx))
    assert sorted(senses) == [-1.0, 1.0]


def test_bodies_that_lie_as_before_are_searched_once() -> None:
    """Of two chains each, as after others were put together; where one of them lies in another way, it is anew."""
    outlines, _ = triangle(np.random.default_rng(0), np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]]))
    here, flat = Pose.identity(2), [True] * 3
    bodies = [Body({n: here, n + 3: Pose.from_xytheta([1.0, 0.0, 0.0])}, outlines[n]) for n in range(3)]
    search, tied = Trusses([([n], [here]) for n in range(6)], None), Tied.of(outlines, flat)
    first, again = (search.among(bodies, tied, flat) for _ in range(2))
    assert first is not None and again is not None and search.searched == 1
    for one, other in zip(first[1][0], again[1][0], strict=True):
        assert np.array_equal(one.rotation, other.rotation) and np.array_equal(one.translation, other.translation)
    moved = Body({0: here, 3: Pose.from_xytheta([2.0, 0.0, 0.0])}, outlines[0])
    assert search.among([moved, *bodies[1:]], tied, flat) is not None and search.searched == 2


def test_a_triangle_whose_corners_are_in_line_can_move() -> None:
    bodies, _ = triangle(np.random.default_rng(0), np.array([[0.0, 0.0], [1.0, 1.0], [3.0, 3.0]]))
    assert assemblies(bodies, [True] * 3) == []


def test_bars_that_do_not_meet_are_no_truss() -> None:
    """Sides of 1, 1 and 5 make no triangle."""
    ends = [[0.0, 0.0], [1.0, 0.0]]
    bodies = [outline([a, b], side * np.array(ends)) for a, b, side in ((0, 1, 1.0), (1, 2, 1.0), (0, 2, 5.0))]
    assert assemblies(bodies, [True] * 3) == []


def truss(world: str, sigma: float, per_pair: int, seed: int = 0) -> Dataset:
    """Three robots, each pair of which has seen `per_pair` landmarks in common, and each some of its own."""
    n = 3 * per_pair
    dataset = team(world, landmarks=n + 6, poses=12, sigma=sigma, sigma_odometry=sigma, sees=0.7, seed=seed)
    marks = dataset.landmark_keys
    pins = {(1, 2): marks[:per_pair], (2, 3): marks[per_pair : 2 * per_pair], (1, 3): marks[2 * per_pair : n]}
    seen = {
        robot: np.concatenate([marks[n + 2 * robot - 2 : n + 2 * robot], *(m for p, m in pins.items() if robot in p)])
        for robot in (1, 2, 3)
    }
    return dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], seen[t.robot]))
        for t in dataset.tables
        if t.source != "robots"
    )


@pytest.mark.parametrize(("world", "per_pair"), [("2d", 1), ("planar", 1), ("3d", 2)])
@pytest.mark.parametrize(("sigma", "within"), [(EXACT, 1e-4), (0.02, 0.25)])
def test_a_truss_is_assembled_though_no_pair_holds(world: str, per_pair: int, sigma: float, within: float) -> None:
    dataset = truss(world, sigma, per_pair)
    submaps = built(dataset)
    for a in range(3):
        assert len(place([s for n, s in enumerate(submaps) if n != a]).clusters) == 2
    (cluster,) = place(submaps).clusters
    assert best_misplaced(dataset, submaps, cluster) < within


@pytest.mark.parametrize("world", ["2d", "planar"])
def test_a_mirrored_truss_is_reported_with_its_cost(world: str) -> None:
    joined = join(built(truss(world, 0.02, 1)))
    (component,) = joined.components
    assert len(component.ambiguities) == 1
    assert "ambiguous" in component.ambiguities[0] and f"{component.map.cost:.6g}" in component.ambiguities[0]
    assert full(truss(world, 0.02, 1)).components[0].ambiguities


def test_a_range_between_robots_decides_which_assembly_it_is() -> None:
    """Alone a range holds no frame, but the join's cost knows the mirror image by it."""
    dataset = truss("2d", 0.02, 1, seed=1)
    assert dataset.truth is not None
    pairs = np.stack([dataset.pose_keys[1][::4], dataset.pose_keys[2][::4]], -1)
    ranges = measure(1, "robots", "range", 2, pairs, 0.02, dataset.truth, np.random.default_rng(0))
    decided = dataset.with_tables([*dataset.tables, ranges])
    joined = join(built(decided))
    (component,) = joined.components
    assert component.ambiguities == ()
    truth = dataset.truth.transform(dataset.truth.pose(joined.map.base).inverse())
    assert np.abs(joined.map.values.minus(truth.only(joined.map.values.layout.keys))).max() < 0.3
    exact = exact_join(split(decided))
    assert exact.components[0].map.cost <= full(decided, initial=joined).map.cost * (1.0 + 1e-9)


def test_a_hinge_stays_a_hinge() -> None:
    """Three robots with one landmark common to all three: each can turn about it."""
    dataset = team("planar", landmarks=9, sees=0.7)
    first, *marks = dataset.landmark_keys
    own = {robot: marks[2 * robot : 2 * robot + 2] for robot in (1, 2, 3)}
    hinged = dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], [first, *own[t.robot]]))
        for t in dataset.tables
        if t.source != "robots"
    )
    joined = join(built(hinged))
    assert len(joined.components) == 3 and len(joined.reasons) == 2
    for reason in joined.reasons:
        assert "under-constrained, 1 direction free" in reason and "would join them" in reason
