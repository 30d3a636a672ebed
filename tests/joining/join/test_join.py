"""Splitting, building and joining: laws that hold for every world, and what cannot be joined."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.errors import ModelError
from teamslam.joining import ORDERS, build, exact_join, full, join, join_sequentially, split
from teamslam.joining.place.place import place
from teamslam.model import (
    Dataset,
    Kind,
    Loss,
    Sources,
    Submap,
    Values,
    is_landmark,
    is_pose,
    landmark_key,
    pose_key,
    rebased,
    robot_of,
)
from teamslam.solver import Options
from worlds import WORLDS, mixed_team, team

TIGHT = Options(decrement=1e-10, cost_share=1e-18)


def in_frame(truth: Values, submap: Submap) -> Values:
    """The truth of a submap's variables, in its frame."""
    return truth.transform(truth.pose(submap.base).inverse()).only(submap.values.layout.keys)


def submaps_of(dataset: Dataset, poses_per_piece: int | None = None) -> list[Submap]:
    return [build(piece, options=TIGHT) for piece in split(dataset, poses_per_piece=poses_per_piece)]


# --- split --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("poses_per_piece", [2, 5, 100])
def test_every_row_stands_in_exactly_one_piece(world: str, poses_per_piece: int) -> None:
    dataset = team(world)
    pieces = split(dataset, poses_per_piece=poses_per_piece)
    for a in dataset.tables:
        held = [t.ids for p in pieces for t in p.tables if (t.robot, t.source) == (a.robot, a.source)]
        np.testing.assert_array_equal(np.sort(np.concatenate(held)), a.ids)
    sources = [Sources.of(p.tables) for p in pieces]
    assert all(sources[i].overlap(sources[j]) is None for i in range(len(sources)) for j in range(i))


def test_consecutive_pieces_share_their_boundary_pose() -> None:
    dataset = team("planar", robots=1, poses=20)
    pieces = split(dataset, poses_per_piece=6)
    assert len(pieces) > 2
    own = [p.pose_keys[1] for p in pieces]
    for before, after in itertools.pairwise(own):
        assert before[-1] == after[0]


def test_a_broken_chain_is_cut_and_a_whole_one_is_demanded() -> None:
    dataset = team("planar", robots=1, poses=20)
    odometry, *others = dataset.tables
    broken = dataset.with_tables([odometry.select(np.arange(19) != 9), *others])
    assert len(split(broken, poses_per_piece=100)) == 2
    with pytest.raises(ModelError, match="no odometry links"):
        build(broken)


def test_a_row_from_another_robots_pose_is_refused_and_said_where() -> None:
    """Moved there by its table: row and pose are named, and what to do. A submap of it there is none either."""
    dataset = team("planar", robots=2)
    borrowed = [replace(t, robot=1) if (t.robot, t.source) == (2, "landmarks") else t for t in dataset.tables]
    for make in (split, lambda log: build(log.of_robot(1))):
        with pytest.raises(ModelError, match=r"row 0 of the landmarks of robot 1 was taken from robot 2 at .* its own"):
            make(dataset.with_tables(borrowed))


def test_a_pose_of_one_robot_seen_from_another_may_stand_in_either_ones_table() -> None:
    dataset = team("planar", robots=2)
    swapped = [replace(t, robot=3 - t.robot) if t.source == "robots" else t for t in dataset.tables]
    joined = join(submaps_of(dataset.with_tables(swapped))).map
    apart = joined.values.minus(join(submaps_of(dataset)).map.values)
    np.testing.assert_allclose(apart, 0.0, atol=0.02)


# --- build (Algorithm 1) ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
def test_a_noise_free_submap_is_the_truth(world: str) -> None:
    dataset = team(world, sigma=1e-6, sigma_odometry=1e-6)
    assert dataset.truth is not None
    for submap in submaps_of(dataset):
        np.testing.assert_allclose(submap.values.minus(in_frame(dataset.truth, submap)), 0.0, atol=1e-4)


def test_a_submap_holds_its_own_poses_its_landmarks_and_the_robots_it_saw() -> None:
    dataset = team("planar")
    submap = build(split(dataset)[0])
    keys = submap.values.layout.keys
    assert set(np.unique(robot_of(keys[is_pose(keys)]))) == {1, 2}
    assert is_landmark(keys).any()
    assert submap.first_pose == dataset.pose_keys[1][0]
    assert submap.base in dataset.pose_keys[1] and submap.base not in keys
    assert submap.rows == sum(t.dof for t in dataset.of_robot(1).tables)
    assert np.linalg.eigvalsh(submap.information.toarray())[0] > 0.0


@pytest.mark.parametrize("model", ["range_bearing", "range", "bearing", "point"])
def test_sightings_that_leave_a_robot_open_travel_raw(model: str) -> None:
    dataset = team("2d", robot_model=model)
    submap = build(split(dataset)[0])
    assert [t.source for t in submap.raw] == ["robots"]
    assert set(np.unique(robot_of(submap.values.layout.keys))) == {0, 1}
    assert len(submap.sources) == 3  # they are accounted for all the same


def test_robust_sightings_of_robots_travel_raw() -> None:
    dataset = team("planar").with_loss(Loss("huber", 2.0))
    assert [t.source for t in build(split(dataset)[0]).raw] == ["robots"]


def test_a_piece_of_two_robots_is_refused() -> None:
    with pytest.raises(ModelError, match="one robot's"):
        build(team("2d"))


# --- join (Algorithm 2) -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("poses_per_piece", [3, None])
def test_noise_free_joining_gives_the_truth(world: str, poses_per_piece: int | None) -> None:
    dataset = team(world, sigma=1e-6, sigma_odometry=1e-6)
    assert dataset.truth is not None
    joined = join(submaps_of(dataset, poses_per_piece))
    assert len(joined.components) == 1 and joined.converged
    np.testing.assert_allclose(joined.map.values.minus(in_frame(dataset.truth, joined.map)), 0.0, atol=1e-4)


@pytest.mark.parametrize("world", WORLDS)
def test_noise_free_frames_are_exact_before_any_solve(world: str) -> None:
    dataset = team(world, sigma=1e-6, sigma_odometry=1e-6)
    assert dataset.truth is not None
    submaps = submaps_of(dataset, 4)
    placement = place(submaps)
    assert len(placement.clusters) == 1
    root = dataset.truth.pose(submaps[placement.clusters[0].members[0]].base)
    for number, frame in zip(placement.clusters[0].members, placement.clusters[0].frames, strict=True):
        expected = root.between(dataset.truth.pose(submaps[number].base))
        np.testing.assert_allclose(frame.minus(expected), 0.0, atol=1e-4)


@pytest.mark.parametrize("world", WORLDS)
def test_the_order_of_the_set_changes_no_bit(world: str) -> None:
    submaps = submaps_of(team(world), 4)
    first = join(submaps).map
    for seed in range(3):
        shuffled = [submaps[i] for i in np.random.default_rng(seed).permutation(len(submaps))]
        again = join([*shuffled, shuffled[0]]).map
        assert again.values.state.tobytes() == first.values.state.tobytes()
        assert again.information.data.tobytes() == first.information.data.tobytes()


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("order", ORDERS)
def test_every_order_of_joining_gives_one_map(world: str, order: str) -> None:
    """Each level linearises once more, so orders agree to second order: the difference falls about fourfold per
    halving."""
    difference = []
    for sigma in (0.02, 0.01):
        submaps = submaps_of(team(world, sigma=sigma, sigma_odometry=sigma), 5)
        joined, reference = ORDERS[order](submaps[::-1], options=TIGHT).map, join(submaps, options=TIGHT).map
        assert joined.rows == reference.rows and joined.sources == reference.sources
        difference.append(float(np.abs(joined.values.minus(reference.values)).max()))
    assert difference[1] <= 0.45 * difference[0] or difference[0] < 1e-12
    assert difference[0] < 0.02  # below the noise itself


@pytest.mark.parametrize("world", WORLDS)
def test_joining_without_redundancy_is_the_full_least_squares(world: str) -> None:
    """Submaps that are trees fit their measurements exactly; the join then differs from the full least squares only by
    the chart (mathematics: second order in the noise)."""
    difference = []
    for sigma in (0.02, 0.01):
        dataset = team(world, sigma=sigma, sigma_odometry=sigma, poses=6)
        trees = dataset.with_tables(
            t if t.source == "odometry" else t.select(np.unique(t.keys[:, 1], return_index=True)[1])
            for t in dataset.tables
        )
        submaps = submaps_of(trees)
        assert all(s.cost < 1e-12 for s in submaps)
        joined = join(submaps, options=TIGHT)
        baseline = full(trees, initial=joined, options=TIGHT)
        difference.append(float(np.abs(joined.map.values.minus(baseline.map.values)).max()))
        assert joined.map.rows - joined.map.dof == baseline.map.rows - baseline.map.dof
    assert difference[1] < 0.45 * difference[0]


@pytest.mark.parametrize("world", WORLDS)
def test_the_difference_to_full_least_squares_is_second_order(world: str) -> None:
    difference = []
    for sigma in (0.04, 0.02, 0.01):
        dataset = team(world, sigma=sigma, sigma_odometry=sigma)
        joined = join(submaps_of(dataset), options=TIGHT)
        baseline = full(dataset, initial=joined, options=TIGHT)
        difference.append(float(np.abs(joined.map.values.minus(baseline.map.values)).max()))
    assert difference[2] < 0.45 * difference[1] < 0.45**2 * difference[0] * 1.5


def test_joining_one_submap_gives_it_back() -> None:
    submap = build(split(team("2d", robots=2))[0])
    alone = replace(submap, raw=())
    found = join([alone]).map
    assert found.base == alone.first_pose
    back = rebased(found, alone.base)
    np.testing.assert_allclose(back.values.state, alone.values.state, atol=1e-12)
    scale = np.abs(alone.information.toarray()).max()
    np.testing.assert_allclose(back.information.toarray(), alone.information.toarray(), atol=1e-12 * scale)
    assert join([found]).map is found


def test_a_newer_version_replaces() -> None:
    submaps = submaps_of(team("planar"))
    newer = replace(submaps[0], version=1)
    assert join([*submaps, newer]).map.version == 1
    assert join([newer, *submaps[1:]]).map.values.state.tobytes() == join([*submaps, newer]).map.values.state.tobytes()


def test_removing_a_robot_is_never_having_had_it() -> None:
    submaps = submaps_of(team("planar"))
    with_all = join(submaps)
    assert len(with_all.map.robots) == 3
    without = join([s for s in submaps if s.robots != (3,)])
    again = join(submaps[:2])
    assert without.map.values.state.tobytes() == again.map.values.state.tobytes()


# --- what cannot be joined ----------------------------------------------------------------------------------------


def test_an_empty_set_is_refused() -> None:
    with pytest.raises(ModelError, match="nothing to join"):
        join([])


def test_double_counting_is_refused() -> None:
    dataset = team("planar")
    submaps = submaps_of(dataset)
    copy = replace(submaps[0], id="another name for the same")
    with pytest.raises(ModelError, match="would count twice"):
        join([*submaps, copy])


def test_two_contents_under_one_name_are_refused() -> None:
    submaps = submaps_of(team("planar"))
    with pytest.raises(ModelError, match="both called"):
        join([submaps[0], replace(submaps[1], id=submaps[0].id)])


def without_robots(dataset: Dataset) -> Dataset:
    return dataset.with_tables(t for t in dataset.tables if t.source != "robots")


def test_strangers_are_separate_components_with_the_reason() -> None:
    dataset = without_robots(team("planar", robots=2))
    marks = dataset.landmark_keys
    apart = dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], marks[:3] if t.robot == 1 else marks[3:]))
        for t in dataset.tables
    )
    joined = join(submaps_of(apart))
    assert [c.map.robots for c in joined.components] == [(1,), (2,)]
    assert "share nothing" in joined.reasons[0] and "robot 2" in joined.reasons[0]


def test_one_shared_landmark_is_a_hinge_and_is_called_so() -> None:
    dataset = without_robots(team("planar", robots=2))
    marks = dataset.landmark_keys
    hinged = dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], marks[:3] if t.robot == 1 else marks[2:]))
        for t in dataset.tables
    )
    joined = join(submaps_of(hinged))
    assert len(joined.components) == 2
    assert "share only landmark 2" in joined.reasons[0] and "turn about it" in joined.reasons[0]


@pytest.mark.parametrize(("world", "enough"), [("2d", 2), ("planar", 2), ("3d", 3)])
def test_enough_shared_landmarks_join_and_one_fewer_does_not(world: str, enough: int) -> None:
    """mathematics, 2: two points at different places in the plane, three not in line in space."""
    dataset = without_robots(team(world, robots=2, landmarks=8, poses=20))
    marks = dataset.landmark_keys
    for shared, components in ((enough, 1), (enough - 1, 2)):
        first, second = marks[: 4 + shared], marks[4:]
        limited = dataset.with_tables(
            t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], first if t.robot == 1 else second))
            for t in dataset.tables
        )
        assert len(join(submaps_of(limited)).components) == components


@pytest.mark.parametrize("world", WORLDS)
def test_one_sighting_of_a_robots_pose_is_enough(world: str) -> None:
    dataset = team(world, robots=2)
    odometry = [t for t in dataset.tables if t.source == "odometry"]
    sighting = next(t for t in dataset.tables if t.source == "robots").select(np.array([1]))
    joined = join(submaps_of(dataset.with_tables([*odometry, sighting])))
    assert len(joined.components) == 1


# --- exactness ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(("sigma", "sigma_odometry"), [(0.02, 0.02), (0.1, 0.2)])
@pytest.mark.parametrize("poses_per_piece", [5, None])
def test_exact_joining_is_the_full_least_squares(
    world: str, sigma: float, sigma_odometry: float, poses_per_piece: int | None
) -> None:
    dataset = team(world, sigma=sigma, sigma_odometry=sigma_odometry)
    exact = exact_join(split(dataset, poses_per_piece=poses_per_piece))
    baseline = full(dataset, initial=exact, options=TIGHT)
    report = exact.components[0].exactness
    assert report is not None and exact.converged
    assert abs(exact.map.cost - baseline.map.cost) <= 1e-10 * baseline.map.cost
    np.testing.assert_allclose(exact.map.values.minus(baseline.map.values), 0.0, atol=1e-8)
    assert report.relative_cost_gap <= 1e-10
    assert report.max_shift_sigma <= report.gradient_norm + 1e-12
    assert report.rounds >= 1 and report.bytes > 0
    dense, other = exact.map.information.toarray(), baseline.map.information.toarray()
    np.testing.assert_allclose(dense, other, atol=1e-6 * np.abs(other).max())


@pytest.mark.parametrize("robot_model", ["range_bearing", "range"])
def test_exact_joining_with_raw_sightings(robot_model: str) -> None:
    dataset = team("2d", robot_model=robot_model, sigma=0.05).with_loss(Loss("huber", 2.0))
    exact = exact_join(split(dataset, poses_per_piece=6))
    baseline = full(dataset, initial=exact, options=TIGHT)
    assert abs(exact.map.cost - baseline.map.cost) <= 1e-10 * baseline.map.cost
    np.testing.assert_allclose(exact.map.values.minus(baseline.map.values), 0.0, atol=1e-8)


def test_the_reported_gap_is_the_true_gap() -> None:
    dataset = team("planar", sigma=0.1, sigma_odometry=0.1)
    pieces = split(dataset, poses_per_piece=5)
    loose = exact_join(pieces, gap=1e-5).components[0]
    baseline = full(dataset, options=TIGHT).map
    assert loose.exactness is not None
    true_gap = (loose.map.cost - baseline.cost) / baseline.cost
    assert loose.exactness.relative_cost_gap == pytest.approx(true_gap, rel=0.2)


# --- the world's frame --------------------------------------------------------------------------------------------


def test_positions_in_the_world_fix_the_frame() -> None:
    from worlds import measure

    dataset = team("planar", robots=2)
    assert dataset.truth is not None
    rng = np.random.default_rng(3)
    fixes = measure(1, "gps", "position", 2, dataset.pose_keys[1][[0, 5, 11], None], 0.01, dataset.truth, rng)
    surveyed = dataset.with_tables([*dataset.tables, fixes])
    joined = join(submaps_of(surveyed))
    expected = dataset.truth.only(joined.map.values.layout.keys)
    assert joined.map.base == -1
    assert np.abs(joined.map.values.minus(expected)).max() < 0.2
    exact = exact_join(split(surveyed))
    baseline = full(surveyed, initial=exact, options=TIGHT)
    np.testing.assert_allclose(exact.map.values.minus(baseline.map.values), 0.0, atol=1e-8)


def test_one_position_in_the_world_leaves_the_map_free_to_turn() -> None:
    from worlds import measure

    dataset = team("planar", robots=1)
    assert dataset.truth is not None
    fix = measure(
        1, "gps", "position", 2, dataset.pose_keys[1][[3], None], 0.01, dataset.truth, np.random.default_rng(3)
    )
    joined = join(submaps_of(dataset.with_tables([*dataset.tables, fix])))
    assert joined.map.base == dataset.pose_keys[1][0]
    assert [table.source for table in joined.map.raw] == ["gps"]


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("order", ORDERS)
def test_every_order_gives_one_map_in_the_world_s_frame(world: str, order: str, every: int) -> None:
    """Also where the first parts hold one position each, which leaves them free to turn; and where several parts are
    in the world's frame before they meet. To second order; how much that is depends on how well five positions nearly
    in a line hold a part in space."""
    from worlds import measure

    difference = []
    for sigma in (0.01, 0.005):
        log = team(world, robots=2, sigma=sigma, sigma_odometry=sigma)
        assert log.truth is not None
        rng, dim = np.random.default_rng(3), max(log.robots.values())
        fixes = [
            measure(robot, "gps", "position", dim, keys[1::every, None], sigma, log.truth, rng)
            for robot, keys in log.pose_keys.items()
        ]
        submaps = submaps_of(log.with_tables([*log.tables, *fixes]), 5)
        joined, reference = ORDERS[order](submaps, options=TIGHT).map, join(submaps, options=TIGHT).map
        assert joined.base == reference.base == -1
        assert joined.rows == reference.rows and joined.sources == reference.sources
        difference.append(float(np.abs(joined.values.minus(reference.values)).max()))
    assert difference[1] <= 0.45 * difference[0] or difference[0] < 1e-12


def test_arrival_order_waits_for_what_connects() -> None:
    """Robots 1 and 3 meet only through robot 2: joined in the order 1, 3, 2, the first two wait apart."""
    dataset = without_robots(team("planar", robots=3, landmarks=9, poses=20))
    marks = dataset.landmark_keys
    seen = {1: marks[:4], 2: marks[2:7], 3: marks[5:]}
    chained = dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], seen[t.robot])) for t in dataset.tables
    )
    one, two, three = submaps_of(chained)
    assert len(join([one, three]).components) == 2
    joined = join_sequentially([one, three, two])
    assert len(joined.components) == 1
    assert np.abs(joined.map.values.minus(join([one, two, three]).map.values)).max() < 0.02


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("apart", [False, True])
def test_whatever_the_order_members_are_the_submaps_that_went_in(order: str, apart: bool) -> None:
    dataset = without_robots(team("planar", robots=3, landmarks=9, poses=20))
    halves = dataset.landmark_keys[:5], dataset.landmark_keys[5:]
    log = dataset.with_tables(
        t if t.source == "odometry" else t.select(np.isin(t.keys[:, 1], halves[t.robot == 3])) for t in dataset.tables
    )
    submaps = submaps_of(log if apart else dataset, poses_per_piece=8)
    joined = ORDERS[order](submaps)
    assert (len(joined.components) > 1) == apart
    assert sorted(name for c in joined.components for name in c.members) == sorted(s.id for s in submaps)


def test_a_planar_robot_and_a_flying_one_make_one_map() -> None:
    mixed = mixed_team()
    assert mixed.truth is not None
    joined = join(submaps_of(mixed))
    assert len(joined.components) == 1
    assert np.abs(joined.map.values.minus(in_frame(mixed.truth, joined.map))).max() < 0.1
    exact = exact_join(split(mixed))
    baseline = full(mixed, initial=exact, options=TIGHT)
    np.testing.assert_allclose(exact.map.values.minus(baseline.map.values), 0.0, atol=1e-8)


def test_submaps_whose_halves_fall_apart_end_all_the_same() -> None:
    """Each two of four lying submaps share one landmark: together they are rigid, and no half of them is one map from
    which the search for a map that makes sense could start."""
    rng = np.random.default_rng(5)
    pairs = list(itertools.combinations(range(4), 2))
    places = rng.uniform(-9.0, 9.0, (len(pairs), 2))
    submaps = []
    for robot in range(4):
        seen = np.array([mark for mark, pair in enumerate(pairs) if robot in pair])
        values = Values.of({Kind.POINT2: (landmark_key(seen), places[seen] + 0.1 * rng.normal(size=(3, 2)))})
        base, information = int(pose_key(robot + 1, 0)), sp.csr_array(1e6 * np.eye(6))
        submaps.append(Submap(str(robot), 0, base, 2, values, information, Sources()))
    joined = join(submaps)
    assert len(joined.components) == 1 and joined.converged
