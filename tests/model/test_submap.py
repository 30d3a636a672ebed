"""Laws of provenance (nothing is counted twice) and of submaps (an estimate, its information, its frame)."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from strategies import generators, random_values
from teamslam.errors import ModelError
from teamslam.geometry import Pose
from teamslam.model import Kind, Names, Sources, Stretch, Submap, Table, landmark_key, pack, pose_key

# --- sources --------------------------------------------------------------------------------------------------------

rows_drawn = st.frozensets(st.tuples(st.integers(1, 2), st.sampled_from(["odometry", "landmarks"]), st.integers(0, 9)))


def tables_of(rows: frozenset[tuple[int, str, int]], chunk: int = 100) -> list[Table]:
    """Tables that hold just these rows of the logs, at most `chunk` rows in each, in falling order."""
    tables = []
    for robot, source in sorted({(r, s) for r, s, _ in rows}):
        ids = sorted((i for r, s, i in rows if (r, s) == (robot, source)), reverse=True)
        for at in range(0, len(ids), chunk):
            part = np.array(ids[at : at + chunk])
            keys = np.stack([pose_key(robot, part), landmark_key(part)], -1)
            z = np.zeros((len(part), 2))
            tables.append(Table(robot, source, "point", 2, keys, z, np.eye(2)[None], part))
    return tables


def rows_in(sources: Sources) -> frozenset[tuple[int, str, int]]:
    """Every row, one by one."""
    return frozenset((s.robot, s.source, i) for s in sources for i in range(s.start, s.stop))


@given(rows_drawn, st.integers(1, 4))
def test_sources_are_the_rows_however_the_tables_are_cut(rows: frozenset[tuple[int, str, int]], chunk: int) -> None:
    sources = Sources.of(tables_of(rows))
    assert rows_in(sources) == rows
    assert Sources.of(tables_of(rows, chunk)) == sources
    assert sum(s.stop - s.start for s in sources) == len(rows)


@given(rows_drawn, rows_drawn)
def test_an_overlap_is_found_where_there_is_one(a: frozenset, b: frozenset) -> None:
    found = Sources.of(tables_of(a)).overlap(Sources.of(tables_of(b)))
    assert (found is None) == a.isdisjoint(b)
    if found is not None:
        assert rows_in(Sources({found})) <= a & b


@given(rows_drawn, st.lists(st.integers(0, 2), min_size=40, max_size=40))
def test_merging_is_the_union_in_any_order(rows: frozenset[tuple[int, str, int]], shares: list[int]) -> None:
    parts = [
        Sources.of(tables_of(frozenset(row for row, s in zip(sorted(rows), shares, strict=False) if s == k)))
        for k in range(3)
    ]
    whole = Sources.of(tables_of(rows))
    assert parts[0].merge(parts[1], parts[2]) == whole
    assert parts[2].merge(parts[0]).merge(parts[1]) == whole
    assert Sources().merge(whole) == whole.merge() == whole


def test_rows_told_twice_are_rows_told_once() -> None:
    """Two tables of one log may speak of the same row, each of a different part of it (its range, its bearing)."""
    table = tables_of(frozenset({(1, "landmarks", 3), (1, "landmarks", 4)}))[0]
    assert set(Sources.of([table, table.select(np.array([0]))])) == {Stretch(1, "landmarks", 3, 5)}


@given(rows_drawn, rows_drawn)
def test_sources_are_a_set_of_stretches(a: frozenset, b: frozenset) -> None:
    one, other = Sources.of(tables_of(a)), Sources.of(tables_of(b))
    assert one == Sources(reversed(list(one)))
    assert len(one) == len(set(one)) and list(one) == sorted(one)
    assert (one == other) == (a == b) == (hash(one) == hash(other))
    for table in tables_of(b):
        told = {(table.robot, table.source, i) for i in table.ids[one.rows_of(table)].tolist()}
        assert told == {(table.robot, table.source, i) for i in table.ids.tolist()} & a


# --- submaps --------------------------------------------------------------------------------------------------------

BASE = int(pose_key(1, 0))


def submap_of(rng: np.random.Generator, base: int = BASE, base_dim: int = 3) -> Submap:
    """A submap of some poses and points in space."""
    values = random_values(rng, {Kind.POSE3: 3, Kind.POINT3: 2})
    root = np.eye(values.layout.dof) + 0.1 * rng.normal(size=(values.layout.dof,) * 2)
    sources = Sources({Stretch(1, "odometry", 0, 3), Stretch(4, "landmarks", 2, 5)})
    return Submap("a", 1, base, base_dim, values, sp.csr_array(root.T @ root), sources, Names({1: "red"}))


@given(generators)
def test_the_square_root_is_a_triangle_that_squares_to_the_information(rng: np.random.Generator) -> None:
    submap = submap_of(rng)
    root = submap.square_root
    assert_allclose(root.T @ root, submap.information.toarray(), atol=1e-12)
    assert_array_equal(root, np.triu(root))


@given(generators)
def test_the_base_pose_is_the_identity_and_a_key_but_no_variable(rng: np.random.Generator) -> None:
    submap = submap_of(rng)
    assert BASE in submap.keys and not submap.values.layout.contains(BASE)
    assert_array_equal(pack(submap.all_values.pose(BASE)), pack(Pose.identity(3)))
    assert_array_equal(submap.all_values.only(submap.values.layout.keys).state, submap.values.state)
    assert_array_equal(submap.keys, submap.all_values.layout.keys[np.argsort(submap.all_values.layout.keys)])
    assert submap.dof == submap.values.layout.dof
    assert submap.robots == (1, 4)


@given(generators)
def test_keys_by_robot_and_landmark(rng: np.random.Generator) -> None:
    submap = submap_of(rng)
    assert_array_equal(submap.trajectory_keys(1), [BASE])
    assert_array_equal(submap.trajectory_keys(2), submap.values.layout.keys_of(Kind.POSE3))
    assert_array_equal(submap.landmark_keys, submap.values.layout.keys_of(Kind.POINT3))


@given(generators)
def test_information_of_some_variables_is_their_block(rng: np.random.Generator) -> None:
    submap = submap_of(rng)
    keys = rng.permutation(submap.values.layout.keys)[:3]
    at = submap.values.layout.unknowns(keys)
    assert_array_equal(submap.information_of(keys), submap.information.toarray()[np.ix_(at, at)])


def test_a_submap_that_contradicts_itself_is_refused() -> None:
    rng = np.random.default_rng(0)
    values = random_values(rng, {Kind.POSE3: 3})
    with pytest.raises(ModelError, match=r"submap a: 18 unknowns need an information matrix \(18, 18\)"):
        Submap("a", 1, BASE, 3, values, sp.csr_array(np.eye(17)), Sources())
    first = int(values.layout.keys[0])
    with pytest.raises(ModelError, match="is its frame, not a variable"):
        Submap("a", 1, first, 3, values, sp.csr_array(np.eye(18)), Sources())
    with pytest.raises(ModelError, match="not positive definite"):
        Submap("a", 1, BASE, 3, values, sp.csr_array(-np.eye(18)), Sources()).square_root  # noqa: B018
