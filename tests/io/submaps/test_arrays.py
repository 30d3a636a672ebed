"""teamslam's submap files: the same submap to the bit, and nothing else gets through."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from damage import damaged_bytes
from logs import ABILITIES, logs
from strategies import generators, random_poses, random_values
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import Array
from teamslam.io import read_submaps, write_submaps
from teamslam.io.submaps.arrays import (
    DIGEST_BYTES,
    HEADER,
    MAGIC,
    positive_definite,
    read_submap,
    submap_from_bytes,
    submap_to_bytes,
    write_submap,
)
from teamslam.model import WORLD, Kind, Loss, Names, Sources, Stretch, Submap, Table, pack, pose_key


def submap(rng: np.random.Generator, counts: dict[Kind, int], base: int | None = None) -> Submap:
    """A map of so many variables of each kind, with a sparse information matrix."""
    values = random_values(rng, counts)
    n = values.layout.dof
    root = sp.random_array((n, n), density=0.2, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    information = sp.csr_array(root @ root.T + sp.diags_array(rng.uniform(0.1, 9.0, n)))
    return Submap(
        id="a/1",
        version=int(rng.integers(0, 99)),
        base=int(pose_key(9, 5)) if base is None else base,
        base_dim=int(rng.integers(2, 4)),
        values=values,
        information=sp.csr_array(0.5 * (information + information.T)),
        sources=Sources([Stretch(1, "odometry", 0, 9), Stretch(1, "landmarks", 2, 4), Stretch(2, "odometry", 0, 1)]),
        names=Names({1: "Ada", 2: "Bo"}, {1000: "door"}, 1e-6),
        cost=float(rng.uniform(0, 9)),
        chi2=float(rng.uniform(0, 9)),
        rows=int(rng.integers(0, 99)),
    )


COUNTS = dict(zip(Kind, (3, 2, 2, 2), strict=True))
ONE = submap(np.random.default_rng(0), COUNTS)
submaps = st.builds(
    lambda rng, counts, world: submap(rng, dict(zip(Kind, counts, strict=True)), WORLD if world else None),
    generators,
    st.tuples(*[st.integers(0, 3)] * 4),
    st.booleans(),
)


def assert_same(found: Submap, expected: Submap) -> None:
    for name in ("id", "version", "base", "base_dim", "sources", "cost", "chi2", "rows"):
        assert getattr(found, name) == getattr(expected, name), name
    assert (dict(found.names.robots), dict(found.names.landmarks)) == (expected.names.robots, expected.names.landmarks)
    assert found.names.tick_s == expected.names.tick_s
    assert np.array_equal(found.values.layout.keys, expected.values.layout.keys)
    assert np.array_equal(found.values.state, expected.values.state)
    assert (found.information != expected.information).nnz == 0
    assert len(found.raw) == len(expected.raw)
    for a, b in zip(found.raw, expected.raw, strict=True):
        assert (a.robot, a.source, a.model, a.dim, a.loss) == (b.robot, b.source, b.model, b.dim, b.loss)
        for name in ("keys", "values", "whitening", "ids"):
            assert np.array_equal(getattr(a, name), getattr(b, name))
        assert (a.sensor is None) == (b.sensor is None)
        if a.sensor is not None and b.sensor is not None:
            assert np.array_equal(pack(a.sensor), pack(b.sensor))


@given(submaps, st.data())
def test_what_is_written_reads_back_to_the_bit(expected: Submap, data: st.DataObject) -> None:
    if data.draw(st.booleans()):
        tables = data.draw(logs(ABILITIES["g2o"])).tables
        raw = tuple(t.with_loss(Loss("huber", 2.5)) for t in tables)
        expected = replace(expected, raw=raw, sources=Sources.of(raw))
    message = submap_to_bytes(expected)
    found = submap_from_bytes(message)
    assert_same(found, expected)
    assert submap_to_bytes(found) == message


def test_the_bytes_do_not_depend_on_how_the_matrix_is_stored() -> None:
    shuffled = ONE.information.tocoo()
    order = np.random.default_rng(1).permutation(shuffled.nnz)
    entries = (shuffled.data[order], (shuffled.coords[0][order], shuffled.coords[1][order]))
    again = sp.csr_array(sp.coo_array(entries, shape=shuffled.shape))
    zeros = again + sp.csr_array(([0.0], ([0], [5])), shape=again.shape)
    for matrix in (again, zeros):
        assert submap_to_bytes(replace(ONE, information=sp.csr_array(matrix))) == submap_to_bytes(ONE)


def test_files_and_folders(tmp_path: Path) -> None:
    write_submap(ONE, tmp_path / "deep" / "one.submap")
    assert_same(read_submap(tmp_path / "deep" / "one.submap"), ONE)
    many = [replace(ONE, id=f"a/{k}", version=k) for k in range(11)]
    assert write_submaps(many, tmp_path / "maps") == ()
    for found, expected in zip(read_submaps(tmp_path / "maps"), many, strict=True):
        assert_same(found, expected)
    assert_same(read_submaps(tmp_path / "deep" / "one.submap")[0], ONE)
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["one.submap"]  # no half-written files stay


def test_one_file_holds_one_submap(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds one submap, found 2; give a folder's name"):
        write_submaps([ONE, ONE], tmp_path / "maps.submap")


@given(st.data())
@settings(max_examples=100)
def test_no_damaged_message_gets_through(data: st.DataObject) -> None:
    message = submap_to_bytes(ONE)
    damaged = data.draw(damaged_bytes(message))
    if damaged == message:
        return
    with pytest.raises(InputError):
        submap_from_bytes(damaged)


# --- messages with a good digest and bad content ----------------------------------------------------------------------


def sealed(body: bytes, *, version: int = 1) -> bytes:
    message = HEADER.pack(MAGIC, version, len(body)) + body
    return message + hashlib.blake2b(message, digest_size=DIGEST_BYTES).digest()


def content() -> dict[str, Any]:
    found = msgspec.msgpack.decode(submap_to_bytes(ONE)[HEADER.size : -DIGEST_BYTES])
    assert isinstance(found, dict)
    return found


def array(numbers: Any, dtype: str) -> list[Any]:
    packed = np.asarray(numbers, dtype)
    return [dtype, list(packed.shape), packed.tobytes()]


def changed(name: str, change: Callable[[Array], Any]) -> dict[str, Any]:
    """The content with one array changed."""
    found = content()
    dtype, shape, data = found[name]
    found[name] = array(change(np.frombuffer(data, dtype).reshape(shape).copy()), dtype)
    return found


def at(index: int, value: float) -> Callable[[Array], Array]:
    def change(numbers: Array) -> Array:
        numbers[index] = value
        return numbers

    return change


def stretch_rotation(state: Array) -> Array:
    state[2] += 1e-3
    return state


def repeat_column(indices: Array) -> Array:
    indices[1] = indices[0]
    return indices


MEANINGLESS: dict[str, tuple[dict[str, Any], str]] = {
    "kind": (changed("kinds", at(0, 7)), "kinds of variables are 0 to 3"),
    "keys twice": (changed("keys", lambda k: np.concatenate([k[:1], k[:1], k[2:]])), "sorted by kind and key"),
    "negative key": (changed("keys", at(0, -5)), "neither a robot's pose nor a landmark"),
    "pose as a point": (changed("kinds", lambda k: np.full_like(k, 2)), "a robot's pose is stored as a point"),
    "keys without kinds": (changed("kinds", lambda k: k[:-1]), "keys"),
    "base among the variables": ({**content(), "base": int(ONE.values.layout.keys[0])}, "is its frame, not a variable"),
    "base that is no pose": ({**content(), "base": 17}, "neither a robot's pose nor the world frame"),
    "base of four dimensions": ({**content(), "base_dim": 4}, "plane .* or in space"),
    "state too short": (changed("state", lambda s: s[:-1]), "the layout needs"),
    "state not finite": (changed("state", at(0, np.nan)), "'state': a number is not finite"),
    "rotation": (changed("state", stretch_rotation), "not orthonormal"),
    "information not finite": (changed("data", at(0, np.inf)), "'information': a number is not finite"),
    "indefinite": (changed("data", at(0, -1.0)), "not positive definite"),
    "column out of range": (changed("indices", at(-1, 10**9)), "out of range"),
    "lower triangle": (changed("indices", at(-1, 0)), "out of range|should rise"),
    "column twice": (changed("indices", repeat_column), "should rise|out of range"),
    "row starts fall": (changed("indptr", at(1, 10**6)), "row starts"),
    "row starts too few": (changed("indptr", lambda p: p[:-1]), "row starts"),
    "wrong dimension": (changed("indptr", lambda p: np.append(p, p[-1])), "row starts"),
    "shape and bytes": ({**content(), "state": ["<f8", [10**12], b""]}, "does not fit 0 bytes"),
    "axes": ({**content(), "state": ["<f8", [1, 1], bytes(8)]}, "expected 1 axes"),
    "type": ({**content(), "state": ["<i8", [1], bytes(8)]}, "of <i8"),
    "unknown type": ({**content(), "state": ["<f4", [1], bytes(4)]}, "not that of a submap"),
    "unknown field": ({**content(), "extra": 1}, "not that of a submap: .*unknown field"),
    "missing field": ({k: v for k, v in content().items() if k != "rows"}, "missing required field"),
    "no id": ({**content(), "id": ""}, "needs an id"),
    "negative version": ({**content(), "version": -1}, "version that is not negative"),
    "stretch of nothing": ({**content(), "sources": [[1, "odometry", 5, 5]]}, "are none"),
    "rows twice": ({**content(), "sources": [[1, "o", 0, 5], [1, "o", 4, 6]]}, "counted twice"),
    "cost": ({**content(), "cost": -1.0}, "'cost': expected a number that is not negative"),
    "tick": ({**content(), "tick_s": 0.0}, "a tick lasts longer"),
}


@pytest.mark.parametrize("name", MEANINGLESS)
def test_content_without_meaning_is_refused(name: str) -> None:
    body, expected = MEANINGLESS[name]
    with pytest.raises(InputError, match=expected):
        submap_from_bytes(sealed(msgspec.msgpack.encode(body)))


def test_raw_sightings_are_checked_too() -> None:
    rng = np.random.default_rng(0)
    keys = np.array([[pose_key(1, 0), pose_key(2, 0)]])
    table = Table(1, "robots", "range", 2, keys, np.ones((1, 1)), np.eye(1)[None], np.array([0]), random_poses(rng, 2))
    whole = replace(ONE, raw=(table,), sources=Sources.of([table]))
    assert_same(submap_from_bytes(submap_to_bytes(whole)), whole)
    body = msgspec.msgpack.decode(submap_to_bytes(whole)[HEADER.size : -DIGEST_BYTES])
    for field, value, expected in [
        ("robot", 0, "numbered from 1"),
        ("model", "guess", "unknown model"),
        ("loss", "hope", "unknown loss"),
        ("dim", 5, "dimension 5"),
        ("keys", array([[-7, 3]], "<i8"), "neither a robot's pose"),
        ("sensor", array(np.ones(6), "<f8"), "not orthonormal"),
        ("values", array(np.ones((2, 1)), "<f8"), "should have shape"),
    ]:
        with pytest.raises(InputError, match=expected):
            submap_from_bytes(sealed(msgspec.msgpack.encode({**body, "raw": [{**body["raw"][0], field: value}]})))


def test_other_versions_and_other_files(tmp_path: Path) -> None:
    message = submap_to_bytes(ONE)
    with pytest.raises(InputError, match="of version 2, this teamslam reads version 1"):
        submap_from_bytes(sealed(message[HEADER.size : -DIGEST_BYTES], version=2))
    with pytest.raises(InputError, match="no submap file"):
        submap_from_bytes(b"PK" + message)
    with pytest.raises(InputError, match="cut off or added to"):
        submap_from_bytes(message[:-1])
    with pytest.raises(InputError, match="at least"):
        submap_from_bytes(b"")
    with pytest.raises(InputError, match="not that of a submap"):
        submap_from_bytes(sealed(b"\xc1"))
    (tmp_path / "damaged.submap").write_bytes(message[:-1] + bytes([message[-1] ^ 1]))
    with pytest.raises(InputError, match=r"damaged\.submap: the digest does not fit"):
        read_submap(tmp_path / "damaged.submap")
    with pytest.raises(InputError, match="no such file"):
        read_submap(tmp_path / "absent.submap")


json_like = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats()
    | st.text(max_size=3)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(sorted(content())), json_like)
@settings(max_examples=150)
def test_nothing_but_a_submap_or_an_error_comes_out(field: str, value: Any) -> None:
    try:
        found = submap_from_bytes(sealed(msgspec.msgpack.encode({**content(), field: value})))
    except TeamslamError:
        return
    assert isinstance(found, Submap)


@given(st.data())
@settings(max_examples=300)
def test_damage_under_a_good_digest_gives_a_submap_or_an_error(data: st.DataObject) -> None:
    body = submap_to_bytes(ONE)[HEADER.size : -DIGEST_BYTES]
    try:
        found = submap_from_bytes(sealed(data.draw(damaged_bytes(body))))
    except TeamslamError:
        return
    assert isinstance(found, Submap)


@given(generators, st.integers(1, 30), st.booleans())
def test_positive_definite_is_what_the_eigenvalues_say(rng: np.random.Generator, n: int, scaled: bool) -> None:
    root = rng.normal(size=(n, n))
    scale = np.exp(rng.uniform(-9, 9, n)) if scaled else np.ones(n)
    good = root @ root.T + 0.1 * np.eye(n)
    bad = good - (np.linalg.eigvalsh(good)[0] + 0.05) * np.eye(n)
    for matrix, expected in ((good, True), (bad, False)):
        assert positive_definite(sp.csr_array(scale[:, None] * matrix * scale)) is expected


def test_positive_definite_of_large_sparse_matrices() -> None:
    n = 900
    chain = sp.csr_array(
        sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    )
    assert positive_definite(chain)
    assert not positive_definite(sp.csr_array(chain - 1e-3 * sp.eye_array(n)))
    loose = chain.tolil()
    loose[0, 0] = loose[-1, -1] = 1.0  # a free chain: constant vectors cost nothing
    assert not positive_definite(sp.csr_array(loose - 1e-12 * sp.eye_array(n)))
