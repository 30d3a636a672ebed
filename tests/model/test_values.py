"""Laws of layouts and values: order, chart, frames, parts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from strategies import generators, random_poses, random_values, values_of_any_kind
from teamslam.errors import ModelError
from teamslam.geometry import Pose
from teamslam.model import Kind, Layout, Values, pack, pose_key, rows_of, unpack

SPATIAL = {Kind.POSE3: 3, Kind.POINT3: 4}
MIXED = {Kind.POSE2: 3, Kind.POINT2: 2, Kind.POINT3: 4}

key_lists = st.lists(
    st.tuples(st.integers(0, 40), st.sampled_from(list(Kind))), max_size=30, unique_by=lambda pair: pair[0]
)


def assert_same(a: Values, b: Values, atol: float = 1e-11) -> None:
    assert_array_equal(a.layout.keys, b.layout.keys)
    assert_array_equal(a.layout.kinds, b.layout.kinds)
    assert_allclose(a.state, b.state, atol=atol)


# --- kinds and layouts ----------------------------------------------------------------------------------------------


def test_kinds_know_their_sizes() -> None:
    """A pose has d + d^2 numbers and d + d(d-1)/2 unknowns; a point has d of both."""
    for kind in Kind:
        d = kind.dim
        assert kind.is_pose == kind.name.startswith("POSE") and d == int(kind.name[-1])
        assert kind.size == (d + d * d if kind.is_pose else d)
        assert kind.dof == (d + d * (d - 1) // 2 if kind.is_pose else d)


@given(key_lists, generators)
def test_a_layout_does_not_depend_on_the_order_it_is_made_in(
    pairs: list[tuple[int, Kind]], rng: np.random.Generator
) -> None:
    keys, kinds = np.array([p[0] for p in pairs], int), np.array([int(p[1]) for p in pairs], int)
    shuffled = rng.permutation(np.repeat(np.arange(len(keys)), 2))
    a, b = Layout.of(keys, kinds), Layout.of(keys[shuffled], kinds[shuffled])
    assert_array_equal(a.keys, b.keys)
    assert_array_equal(a.kinds, b.kinds)
    assert list(zip(a.kinds, a.keys, strict=True)) == sorted(zip(kinds, keys, strict=True))


@given(key_lists)
def test_a_layout_finds_its_variables(pairs: list[tuple[int, Kind]]) -> None:
    layout = Layout.of([p[0] for p in pairs], [int(p[1]) for p in pairs])
    assert len(layout) == len(pairs)
    assert layout.dof == sum(kind.dof for _, kind in pairs)
    assert_array_equal(layout.index(layout.keys), np.arange(len(layout)))
    assert_array_equal(layout.contains(np.arange(-1, 45)), np.isin(np.arange(-1, 45), layout.keys))
    for key, kind in pairs:
        at = int(layout.index(key))
        assert (layout.keys[at], layout.kinds[at]) == (key, kind)
        assert_array_equal(layout.unknowns(np.array([key])), np.arange(layout.dof_start[at], layout.dof_start[at + 1]))
    for kind in Kind:
        assert_array_equal(layout.keys_of(kind), sorted(key for key, other in pairs if other == kind))


def test_unknowns_come_in_the_order_asked_for() -> None:
    layout = Layout.of([1, 2, 3], [Kind.POINT2, Kind.POSE2, Kind.POINT2])
    assert_array_equal(layout.unknowns(np.array([3, 2])), [5, 6, 0, 1, 2])
    assert layout.unknowns(np.zeros(0, int)).shape == (0,)


def test_an_unknown_variable_is_refused() -> None:
    with pytest.raises(ModelError, match="variable 9 is not among the 1"):
        Layout.of([4], [0]).index(np.array([4, 9]))
    with pytest.raises(ModelError, match="not among the 0"):
        Layout.of([], []).index(4)


def test_a_layout_that_contradicts_itself_is_refused() -> None:
    with pytest.raises(ModelError, match="two kinds"):
        Layout.of([4, 4], [0, 2])
    with pytest.raises(ModelError, match="sorted"):
        Layout(np.array([5, 4]), np.array([0, 0]))
    with pytest.raises(ModelError, match="sorted"):
        Layout(np.array([4, 4]), np.array([0, 0]))
    with pytest.raises(ModelError, match="found"):
        Layout(np.array([4, 5]), np.array([0]))
    with pytest.raises(ModelError, match="two kinds"):
        Layout.of([4], [0]).union(Layout.of([4], [1]))


@given(key_lists, st.data())
def test_select_and_union_take_a_layout_apart_and_together(pairs: list[tuple[int, Kind]], data: st.DataObject) -> None:
    layout = Layout.of([p[0] for p in pairs], [int(p[1]) for p in pairs])
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(layout), max_size=len(layout))), bool)
    again = layout.select(mask).union(layout.select(~mask), layout.select(mask))
    assert_array_equal(again.keys, layout.keys)
    assert_array_equal(again.kinds, layout.kinds)


@given(st.lists(st.tuples(st.integers(0, 100), st.integers(0, 5)), max_size=20))
def test_rows_of_lists_stretches(stretches: list[tuple[int, int]]) -> None:
    starts, lengths = np.array([s for s, _ in stretches], int), np.array([n for _, n in stretches], int)
    expected = [s + k for s, n in stretches for k in range(n)]
    assert_array_equal(rows_of(starts, lengths), np.array(expected, int))


# --- the chart ------------------------------------------------------------------------------------------------------


@given(values_of_any_kind, generators)
def test_minus_undoes_retract(x: Values, rng: np.random.Generator) -> None:
    d = 0.5 * rng.normal(size=x.layout.dof)
    assert_allclose(x.retract(d).minus(x), d, atol=1e-12)
    assert_same(x.retract(np.zeros(x.layout.dof)), x, 1e-15)


@given(values_of_any_kind, generators)
def test_retract_undoes_minus(x: Values, rng: np.random.Generator) -> None:
    y = x.retract(rng.normal(size=x.layout.dof))
    assert_same(x.retract(y.minus(x)), y)


@given(values_of_any_kind, generators)
def test_each_variable_moves_by_its_own_unknowns(x: Values, rng: np.random.Generator) -> None:
    d = 0.5 * rng.normal(size=x.layout.dof)
    y = x.retract(d)
    for kind, keys, _ in x.parts():
        for key in keys:
            own = d[x.layout.unknowns(np.array([key]))]
            before, after = x.gather(key, kind), y.gather(key, kind)
            expected = before.retract(own) if isinstance(before, Pose) else before + own
            assert_allclose(pack(after), pack(expected), atol=1e-12)


def test_estimates_of_different_variables_cannot_be_subtracted() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ModelError, match="different variables"):
        random_values(rng, {Kind.POINT2: 2}).minus(random_values(rng, {Kind.POINT2: 3}))


# --- reading --------------------------------------------------------------------------------------------------------


@given(generators, st.sampled_from(list(Kind)))
def test_pack_and_unpack_are_inverse(rng: np.random.Generator, kind: Kind) -> None:
    data = random_poses(rng, kind.dim, 4, 2) if kind.is_pose else rng.normal(size=(4, 2, kind.dim))
    rows = pack(data)
    assert rows.shape == (4, 2, kind.size)
    assert_array_equal(pack(unpack(rows, kind)), rows)


@given(values_of_any_kind)
def test_parts_make_the_whole(x: Values) -> None:
    assert_same(Values.of({kind: (keys, data) for kind, keys, data in x.parts()}), x, 0.0)


@given(generators)
def test_values_do_not_depend_on_the_order_of_keys(rng: np.random.Generator) -> None:
    keys, data = rng.permutation(10), rng.normal(size=(10, 2))
    order = rng.permutation(10)
    assert_same(Values.of({Kind.POINT2: (keys, data)}), Values.of({Kind.POINT2: (keys[order], data[order])}), 0.0)
    for key, place in zip(keys, data, strict=True):
        assert_array_equal(Values.of({Kind.POINT2: (keys, data)}).positions(key, 2), place)


@given(generators)
def test_gather_keeps_the_shape_of_the_keys(rng: np.random.Generator) -> None:
    x = random_values(rng, {Kind.POSE3: 5, Kind.POINT3: 4})
    keys = rng.choice(x.layout.keys_of(Kind.POSE3), (2, 3))
    found = x.gather(keys, Kind.POSE3)
    assert isinstance(found, Pose) and found.batch == (2, 3)
    for i, j in np.ndindex(2, 3):
        assert_array_equal(found[i, j].rotation, x.pose(keys[i, j]).rotation)
        assert_array_equal(found[i, j].translation, x.pose(keys[i, j]).translation)


@given(generators)
def test_positions_of_any_kind_of_variable(rng: np.random.Generator) -> None:
    x = random_values(rng, dict.fromkeys(Kind, 3))
    keys = rng.permutation(x.layout.keys)
    places = x.positions(keys, 3)
    for key, place in zip(keys, places, strict=True):
        kind = Kind(int(x.layout.kinds[x.layout.index(key)]))
        data = x.gather(key, kind)
        own = data.translation if isinstance(data, Pose) else data
        assert_array_equal(place, np.append(own, np.zeros(3 - kind.dim)))
    assert_array_equal(x.positions(keys, 2), places[:, :2])


@given(generators)
def test_poses_of_mixed_kinds_are_lifted(rng: np.random.Generator) -> None:
    x = random_values(rng, dict.fromkeys(Kind, 3))
    keys = rng.permutation(np.append(x.layout.keys_of(Kind.POSE2), x.layout.keys_of(Kind.POSE3)))
    found = x.poses_of(keys, 3)
    for n, key in enumerate(keys):
        expected = x.pose(key).lift(3)
        assert_array_equal(pack(found[n]), pack(expected))
    with pytest.raises(ModelError, match="without loss"):
        x.poses_of(keys, 2)


def test_a_point_is_no_pose() -> None:
    x = random_values(np.random.default_rng(0), {Kind.POINT3: 2})
    key = int(x.layout.keys[0])
    with pytest.raises(ModelError, match="is a point"):
        x.pose(key)
    with pytest.raises(ModelError, match="is a point"):
        x.poses_of(np.array([key]), 3)


def test_values_that_do_not_fit_their_layout_are_refused() -> None:
    with pytest.raises(ModelError, match="needs 4 numbers"):
        Values(Layout.of([1, 2], [2, 2]), np.zeros(5))
    with pytest.raises(ModelError, match="POINT3 needs 2 rows of 3"):
        Values.of({Kind.POINT3: (np.array([1, 2]), np.zeros((2, 2)))})


# --- frames and parts -----------------------------------------------------------------------------------------------


@given(generators, st.sampled_from([(2, MIXED), (2, SPATIAL), (3, SPATIAL)]))
def test_changes_of_frame_compose(rng: np.random.Generator, case: tuple[int, dict[Kind, int]]) -> None:
    """x.transform(b).transform(a) = x.transform(a @ b), and a frame's inverse takes it back."""
    dim, counts = case
    x, a, b = random_values(rng, counts), random_poses(rng, dim), random_poses(rng, dim)
    assert_same(x.transform(b).transform(a), x.transform(a @ b), 1e-10)
    assert_same(x.transform(a).transform(a.inverse()), x, 1e-10)
    assert_same(x.transform(Pose.identity(dim)), x, 0.0)


@given(generators)
def test_a_change_of_frame_moves_poses_and_points_alike(rng: np.random.Generator) -> None:
    x, frame = random_values(rng, MIXED), random_poses(rng, 2)
    y = x.transform(frame)
    for key in x.layout.keys_of(Kind.POSE2):
        assert_allclose(pack(y.pose(key)), pack(frame @ x.pose(key)), atol=1e-12)
    marks = x.layout.keys_of(Kind.POINT3)
    assert_allclose(y.positions(marks, 3), frame.lift(3).act(x.positions(marks, 3)), atol=1e-12)
    assert_allclose(y.positions(marks, 3)[:, 2], x.positions(marks, 3)[:, 2])


def test_a_spatial_frame_cannot_move_planar_values() -> None:
    with pytest.raises(ModelError, match="without loss"):
        random_values(np.random.default_rng(0), MIXED).transform(Pose.identity(3))


@given(values_of_any_kind, st.data())
def test_select_and_update_take_values_apart_and_together(x: Values, data: st.DataObject) -> None:
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(x), max_size=len(x))), bool)
    chosen, rest = x.select(mask), x.select(~mask)
    assert_array_equal(chosen.layout.keys, x.layout.keys[mask])
    assert_same(chosen.update(rest), x, 0.0)
    assert_same(rest.update(chosen), x, 0.0)
    assert_same(x.only(chosen.layout.keys), chosen, 0.0)


@given(values_of_any_kind, generators)
def test_update_takes_the_other_where_both_know(x: Values, rng: np.random.Generator) -> None:
    before = x.state.copy()
    y = x.retract(rng.normal(size=x.layout.dof))
    half = np.arange(len(x)) % 2 == 0
    updated = x.update(y.select(half))
    assert_same(updated.select(half), y.select(half), 0.0)
    assert_same(updated.select(~half), x.select(~half), 0.0)
    assert_array_equal(x.state, before)


def test_nothing_is_a_value_too() -> None:
    nothing = Values.of({})
    assert len(nothing) == 0 and nothing.layout.dof == 0
    assert_same(nothing.retract(np.zeros(0)), nothing)
    assert_same(nothing.transform(Pose.identity(2)), nothing)
    one = Values.of({Kind.POSE2: (np.array([int(pose_key(1, 0))]), Pose.identity(2, (1,)))})
    assert_same(nothing.update(one), one, 0.0)
