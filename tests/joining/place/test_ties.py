"""Rows between robots hold bodies together: the true frame is an assembly, and what they leave open shows."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joining.place.trusses import assemblies, truss_of
from strategies import dims, generators, random_poses
from teamslam.geometry import Array, Pose, so3
from teamslam.joining import build, exact_join, full, join, split
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.place import place
from teamslam.joining.place.ties import MOST, Tied, turned_about
from teamslam.model import MODELS, Dataset, Loss, Submap, Table, pose_key
from worlds import team

EXACT = 1e-6  # as noise: far below what any test asks for


def way(keys: Array, places: Array) -> Outline:
    """A robot's own poses, known to a millimetre."""
    n, d = places.shape
    spatial = np.concatenate([places, np.zeros((n, 3 - d))], -1)
    yes = np.ones(n, bool)
    return Outline(keys, spatial, np.tile(np.eye(3), (n, 1, 1)), yes, np.full(n, 1e-6), np.full(n, 1e-6), yes)


def sighted(model: str, dim: int, keys: Array, eyes: Pose, targets: Array) -> Table:
    """What robots at `eyes` would see of targets without any noise, told with a sigma of a millimetre."""
    row = MODELS[model]
    values = row.predict(eyes, targets, dim)
    sure = np.eye(row.residual_rows(dim))[None] * 1e3
    return Table(1, "robots", model, dim, keys, values, sure, np.arange(len(keys)))


def two_ways(
    rng: np.random.Generator, dim: int, frame: Pose, model: str = "range", n: int = 30
) -> tuple[list[Outline], list[Table]]:
    """Two robots that drove about, and how the first saw the second, each known from its own start."""
    first, second = rng.normal(scale=3.0, size=(2, n, dim))
    keys = np.stack([pose_key(1, np.arange(n)), pose_key(2, np.arange(n))], -1)
    eyes = Pose(np.tile(np.eye(dim), (n, 1, 1)), first)
    return [way(keys[:, 0], first), way(keys[:, 1], second)], [sighted(model, dim, keys, eyes, frame.act(second))]


def seen_in_common(outlines: list[Outline], tables: list[Table], dim: int) -> list[list[Pose]]:
    return assemblies(outlines, [dim == 2] * len(outlines), tables)


@settings(max_examples=25)
@given(generators, dims, st.sampled_from(["range", "bearing", "range_bearing", "point"]))
def test_the_true_frame_is_an_assembly(rng: np.random.Generator, dim: int, model: str) -> None:
    """Whatever the robots saw of each other: a few sightings of any model hold the frame."""
    frame = random_poses(rng, dim, turn=3.0)
    bodies, tables = two_ways(rng, dim, frame, model)
    found = seen_in_common(bodies, tables, dim)
    assert min(float(np.abs(f[1].minus(frame)).max()) for f in found) < 1e-4


@given(generators, dims, st.sampled_from(["range", "bearing", "range_bearing", "point"]))
def test_rows_between_bodies_are_differentiated_by_twists(rng: np.random.Generator, dim: int, model: str) -> None:
    frame = random_poses(rng, dim, turn=3.0)
    bodies, tables = two_ways(rng, dim, frame, model, 8)
    (tie,) = Tied.of(bodies, [dim == 2] * 2, tables).ties
    lifted, still = frame.lift(3), Pose.identity(3)
    frames = Pose(
        np.stack([still.rotation, lifted.rotation])[None], np.stack([still.translation, lifted.translation])[None]
    )
    observer, target = tie.at(frames)
    centre, step = rng.normal(size=3), 1e-6
    found = turned_about(tie.slopes(observer, target), target.translation - centre)[0]
    for k, unit in enumerate(np.eye(6)):
        ends = []
        for s in (step, -step):
            turn = so3.exp(s * unit[3:])
            moved = Pose(turn, centre + s * unit[:3] - turn @ centre) @ frames[:, 1]
            both = Pose(
                np.stack([still.rotation[None], moved.rotation], 1),
                np.stack([still.translation[None], moved.translation], 1),
            )
            ends.append(tie.residual(*tie.at(both))[0])
        np.testing.assert_allclose(found[..., k], (ends[0] - ends[1]) / (2.0 * step), rtol=1e-3, atol=1e-2)


@settings(max_examples=15)
@given(generators)
def test_a_robot_that_stood_still_may_have_looked_anywhere(rng: np.random.Generator) -> None:
    bodies, (table,) = two_ways(rng, 2, random_poses(rng, 2, turn=3.0))
    still = way(bodies[1].keys, np.zeros((len(bodies[1].keys), 2)))
    seen = np.linalg.norm(bodies[0].places[:, :2] - rng.normal(scale=3.0, size=2), axis=-1)
    heard = [replace(table, values=seen[:, None])]
    assert seen_in_common([bodies[0], still], heard, 2) == []
    assert truss_of([bodies[0], still], [True, True], heard).freedoms().tolist() == [[0, 1], [1, 0]]


def test_straight_ways_have_a_mirror_image() -> None:
    """Both robots drove straight on: seen from the first, the second may have passed on its left or its right."""
    along = np.linspace(0.0, 6.0, 20)[:, None] * np.array([[1.0, 0.0]])
    when = np.random.default_rng(0).permutation(20)
    frame = Pose.from_xytheta(np.array([1.0, 2.0, 0.7]))
    mine, other = pose_key(1, np.arange(20)), pose_key(2, np.arange(20))
    eyes = Pose(np.tile(np.eye(2), (20, 1, 1)), along)
    heard = sighted("range", 2, np.stack([mine, other[when]], -1), eyes, frame.act(along[when]))
    found = seen_in_common([way(mine, along), way(other, along)], [heard], 2)
    seen = sorted(f[1].xytheta().round(4).tolist() for f in found)
    np.testing.assert_allclose(seen, [[1.0, -2.0, -0.7], [1.0, 2.0, 0.7]], atol=1e-3)


def test_very_many_rows_are_thinned_evenly() -> None:
    bodies, tables = two_ways(np.random.default_rng(0), 2, Pose.identity(2), n=5 * MOST)
    (tie,) = truss_of(bodies, [True, True], tables).tied.ties
    assert len(tie) == MOST
    assert np.abs(np.diff(tie.table.ids) - 5).max() <= 1


@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing", "point"])
def test_rows_in_many_tables_are_looked_at_together(model: str) -> None:
    """A look at a table takes its time whether it has one row or a hundred; what is found is the same."""
    rng = np.random.default_rng(3)
    bodies, (table,) = two_ways(rng, 2, random_poses(rng, 2, turn=3.0), model)
    many = [table.select(slice(n, n + 3)) for n in range(0, len(table), 3)]
    uneven = [replace(t, whitening=np.repeat(t.whitening, 3, 0)) if n % 2 else t for n, t in enumerate(many)]
    forgiven = table.select(slice(0, 3)).with_loss(Loss("cauchy", 1.0))
    few = truss_of(bodies, [True, True], [*uneven[1:], forgiven]).tied.ties
    assert [len(tie) for tie in few] == [len(table) - 3, 3] and few[1].table.loss == forgiven.loss
    found, known = seen_in_common(bodies, uneven, 2), seen_in_common(bodies, [table], 2)
    for one, other in zip(found, known, strict=True):
        assert np.abs(one[1].minus(other[1])).max() < 1e-6


# --- teams --------------------------------------------------------------------------------------------------------


def only_ranges(world: str, sigma: float, every: int = 1, robots: int = 2, seed: int = 0) -> Dataset:
    """Robots that share nothing but how far they were from each other."""
    dataset = team(
        world, robots=robots, robot_model="range", poses=24, sigma=sigma, sigma_odometry=sigma, every=every, seed=seed
    )
    return dataset.with_tables(t for t in dataset.tables if t.source != "landmarks")


def built(dataset: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(dataset)]


@pytest.mark.parametrize(
    ("world", "model"), [*itertools.product(("2d", "planar"), ("bearing", "range_bearing", "point")), ("3d", "point")]
)
def test_sightings_of_any_model_place_a_team_that_shares_nothing_else(world: str, model: str) -> None:
    """Both ways: no sighting fixes a pose, nor does any robot alone."""
    dataset = team(world, robots=2, robot_model=model, sigma=EXACT, sigma_odometry=EXACT, every=4)
    dataset = dataset.with_tables(t for t in dataset.tables if t.source != "landmarks")
    submaps = built(dataset)
    (cluster,) = place(submaps).clusters
    assert dataset.truth is not None
    root = dataset.truth.pose(submaps[0].base)
    true = [root.between(dataset.truth.pose(submaps[n].base)) for n in cluster.members]
    ways = (cluster.frames, *cluster.others)
    assert min(max(float(np.abs(f.minus(t)).max()) for f, t in zip(way, true, strict=True)) for way in ways) < 1e-3


def test_bearings_of_robots_decide_what_one_landmark_leaves_open() -> None:
    """One common landmark is a hinge; two bearings between robots that stand still hold it."""
    dataset = team("2d", robots=2, robot_model="bearing", landmarks=1, sees=1.0, every=12)
    joined = join(built(dataset))
    assert len(joined.components) == 1
    without = dataset.with_tables(t for t in dataset.tables if t.source != "robots")
    (reason,) = join(built(without)).reasons
    assert "share only landmark 0" in reason and "1 direction free" in reason


@pytest.mark.parametrize("every", [12, 6])
def test_landmarks_known_badly_along_the_ray_hold_a_frame(every: int) -> None:
    """Seen by bearings from nearly one place, landmarks are long and thin: as points they hold nothing, as they are
    they do."""
    dataset = team("2d", robots=2, model="bearing", landmarks=8, poses=8, sigma=0.01, sees=1.0, every=every)
    dataset = dataset.with_tables(t for t in dataset.tables if t.source != "robots")
    assert len(join(built(dataset)).components) == 1


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
    assert "no place was found where they fit" in reason and "look for wrong ranges" in reason


# --- what is open -------------------------------------------------------------------------------------------------


def random_truss(rng: np.random.Generator, dim: int, model: str, count: int, rows: int) -> tuple[list[Outline], Table]:
    """Bodies that drove about at random, and some sightings between any of them."""
    n = 5
    places = rng.normal(scale=3.0, size=(count, n, dim))
    keys = np.stack([pose_key(body + 1, np.arange(n)) for body in range(count)])
    frames = random_poses(rng, dim, count, turn=3.0)
    ends = np.array([rng.choice(count, 2, replace=False) for _ in range(rows)])
    at = rng.integers(0, n, (rows, 2))
    turns = np.tile(np.eye(dim), (rows, 1, 1))
    eyes = frames[ends[:, 0]] @ Pose(turns, places[ends[:, 0], at[:, 0]])
    targets = frames[ends[:, 1]].act(places[ends[:, 1], at[:, 1]])
    seen = sighted(model, dim, keys[ends, at], eyes, targets)
    return [way(k, p) for k, p in zip(keys, places, strict=True)], seen


def null_space(bodies: list[Outline], table: Table, dim: int, rng: np.random.Generator) -> Array:
    """What no row sees of all bodies' frames but the first's (directions, bodies - 1, dof), at frames drawn anywhere:
    by differences of residuals, and NumPy alone."""
    dof, count = 3 * (dim - 1), len(bodies)
    known = {int(key): (b, o.places[i, :dim]) for b, o in enumerate(bodies) for i, key in enumerate(o.keys)}
    whose = np.array([[known[int(key)][0] for key in row] for row in table.keys])
    where = np.array([[known[int(key)][1] for key in row] for row in table.keys])
    start = random_poses(rng, dim, count, turn=3.0)

    def predicted(tangent: Array) -> Array:
        frames = start.retract(np.concatenate([np.zeros(dof), tangent]).reshape(count, dof))
        turns = np.tile(np.eye(dim), (len(whose), 1, 1))
        observer = frames[whose[:, 0]] @ Pose(turns, where[:, 0])
        return table.predict_from(observer, frames[whose[:, 1]].act(where[:, 1]))

    steps = 1e-6 * np.eye((count - 1) * dof)
    here = [table.row.minus(predicted(step), predicted(-step), dim).ravel() / 2e-6 for step in steps]
    _, sizes, directions = np.linalg.svd(np.stack(here, -1))
    return directions[int((sizes > 1e-6 * sizes[0]).sum()) :].reshape(-1, count - 1, dof)


@settings(max_examples=40, deadline=None)
@given(generators, dims, st.sampled_from(["range", "bearing", "range_bearing", "point"]), st.data())
def test_what_is_open_is_the_null_space_of_all_rows(
    rng: np.random.Generator, dim: int, model: str, data: st.DataObject
) -> None:
    count, rows = data.draw(st.integers(2, 4), "bodies"), data.draw(st.integers(1, 14), "rows")
    bodies, table = random_truss(rng, dim, model, count, rows)
    found = truss_of(bodies, [dim == 2] * count, [table]).freedoms()
    null = null_space(bodies, table, dim, rng)
    free = [np.linalg.matrix_rank(null[:, body], tol=1e-4) if len(null) else 0 for body in range(count - 1)]
    assert found[0].tolist() == [0, *free]
    assert (found == found.T).all() and not found.diagonal().any()


@settings(max_examples=20, deadline=None)
@given(generators, dims, st.integers(2, 4), st.integers(1, 14))
def test_more_rows_never_open_anything(rng: np.random.Generator, dim: int, count: int, rows: int) -> None:
    bodies, table = random_truss(rng, dim, "range", count, rows + 1)
    fewer = truss_of(bodies, [dim == 2] * count, [table.select(np.arange(rows))]).freedoms()
    assert (truss_of(bodies, [dim == 2] * count, [table]).freedoms() <= fewer).all()


@settings(max_examples=15, deadline=None)
@given(generators, st.floats(0.0, 1e12))
def test_what_lies_above_the_plane_is_nothing_to_bodies_in_it(rng: np.random.Generator, height: float) -> None:
    """A robot on the ground may see points in space of which it does not know how high they are."""
    points = rng.normal(scale=3.0, size=(3, 2))
    frame = random_poses(rng, 2, turn=3.0)
    high = np.concatenate([frame.unact(points), height * rng.normal(size=(3, 1))], 1)
    no, sure = np.zeros(3, bool), np.full(3, 1e-6)
    bodies = [
        Outline(np.arange(3), places, np.tile(np.eye(3), (3, 1, 1)), no, sure, np.zeros(3), no)
        for places in (np.concatenate([points, np.zeros((3, 1))], 1), high)
    ]
    assert not truss_of(bodies, [True, True]).freedoms().any()
    truss = truss_of([bodies[0], replace(bodies[1], places=high * [1.0, 1.0, 0.0])], [True, True])
    assert truss_of(bodies, [True, True]).tied.reach == truss.tied.reach
