"""Messages: to the bit or within the bound, never more than raw by plan, and never half read."""

import hashlib
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from damage import damaged_bytes
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import Pose
from teamslam.joining import build, join, separators, split
from teamslam.model import WORLD, Dataset, Loss, Submap, Table, Values
from teamslam.team import admit, plan
from teamslam.wire import COMPACT, EXACT, KINDS, Precision, receive, send, send_raw
from teamslam.wire.messages import CONDENSINGS, DIGEST, MAGIC, PLAIN, VERSION, canonical
from worlds import WORLDS, team

TEAMS = [(world, "relative_pose") for world in WORLDS] + [
    ("2d", "range_bearing"),
    ("2d", "bearing"),
    ("planar", "range"),
]


def pieces_and_submaps(world: str, robot_model: str = "relative_pose") -> list[tuple[Dataset, Submap]]:
    log = team(world, poses=10, landmarks=4, sees=0.6, robot_model=robot_model)
    return [(piece, build(piece)) for piece in split(log, poses_per_piece=6)]


def assert_same_table(a: Table, b: Table) -> None:
    assert (a.robot, a.source, a.model, a.dim, a.loss) == (b.robot, b.source, b.model, b.dim, b.loss)
    for name in ("keys", "values", "whitening", "ids"):
        assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.sensor is None) == (b.sensor is None)


@pytest.mark.parametrize(("world", "robot_model"), TEAMS)
def test_to_the_bit_every_kind_brings_the_same_submap(world: str, robot_model: str) -> None:
    pairs = pieces_and_submaps(world, robot_model)
    needed = separators(submap for _, submap in pairs)
    for piece, submap in pairs:
        for kind, condensing in CONDENSINGS.items():
            received = receive(send(kind, submap, needed[submap.id]).data)
            assert (received.kind, received.id, received.version) == (kind, submap.id, submap.version)
            assert received.rounding == EXACT
            assert canonical(received.submap()) == canonical(condensing(submap, needed[submap.id]))
        raw = receive(send_raw(piece, submap.id, submap.version).data)
        assert isinstance(raw.content, Dataset)
        for a, b in zip(raw.content.tables, piece.tables, strict=True):
            assert_same_table(a, b)
        assert canonical(raw.submap()) == canonical(submap)


@pytest.mark.parametrize(("world", "robot_model"), TEAMS)
def test_rounded_measurements_stay_within_the_bound(world: str, robot_model: str) -> None:
    for piece, submap in pieces_and_submaps(world, robot_model):
        message = send_raw(piece, submap.id, 0, COMPACT)
        received = receive(message.data)
        assert isinstance(received.content, Dataset)
        total = 0.0
        for a, b in zip(received.content.tables, piece.tables, strict=True):
            error = b.row.minus(a.values, b.values, b.dim)
            total += float(np.sum((b.whitening @ error[..., None]) ** 2))
        assert np.sqrt(total) <= received.rounding.shift_sigma * (1.0 + 1e-9)
        assert received.rounding.shift_sigma <= COMPACT.shift_sigma
        assert len(message) < len(send_raw(piece, submap.id))


def test_noise_of_each_row_its_own_and_unit_directions_travel() -> None:
    rng = np.random.default_rng(0)
    log = team("3d", robots=1, poses=6, landmarks=4, sees=0.9)
    table = next(t for t in log.tables if t.source == "landmarks")
    m = len(table)
    direction = rng.normal(size=(m, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    noisy = np.tril(rng.normal(size=(m, 3, 3))) * 0.1 + np.eye(3) * rng.uniform(10.0, 100.0, (m, 1, 1))
    mount = Pose.from_tangent(rng.normal(size=6), 3)
    seen = replace(
        table,
        model="range_bearing",
        values=np.concatenate([rng.uniform(1.0, 5.0, (m, 1)), direction], 1),
        whitening=noisy,
        sensor=mount,
        loss=Loss("huber", 2.0),
    )
    exact = receive(send_raw(log.with_tables([seen]), "a").data).content
    rounded = receive(send_raw(log.with_tables([seen]), "a", 0, Precision(0.01, 1e-4)).data).content
    assert isinstance(exact, Dataset)
    assert isinstance(rounded, Dataset)
    assert_same_table(exact.tables[0], seen)
    found = rounded.tables[0]
    np.testing.assert_allclose(found.whitening, noisy, rtol=1e-6, atol=1e-6)
    error = seen.row.minus(found.values, seen.values, 3)
    assert np.linalg.norm(noisy @ error[..., None]) <= 0.01
    assert found.sensor is not None
    assert_array_equal(found.sensor.rotation, mount.rotation)


@pytest.mark.parametrize("precision", [EXACT, COMPACT])
@pytest.mark.parametrize(("world", "robot_model"), TEAMS)
@pytest.mark.parametrize("topology", ["star", "all"])
def test_no_link_costs_more_than_raw(world: str, robot_model: str, precision: Precision, topology: str) -> None:
    team_plan = plan(pieces_and_submaps(world, robot_model), precision, topology=topology)
    raw, picked = team_plan.ledger("raw"), team_plan.ledger()
    for link, cost in picked.by_link().items():
        assert cost <= raw.by_link()[link]
        for kind in CONDENSINGS:
            assert cost <= team_plan.ledger(kind).by_link()[link]
    assert picked.total == sum(picked.by_link().values()) == sum(picked.by_kind().values())
    assert picked.total == sum(len(m.data) for _, _, m in team_plan.messages())
    assert len(picked.by_link()) == {"star": 2, "all": 6}[topology]


@given(st.integers(0, 10_000), st.integers(1, 255))
def test_a_damaged_message_is_refused(place: int, flip: int) -> None:
    data = bytearray(MESSAGE)
    data[place % len(data)] ^= flip
    with pytest.raises(InputError):
        receive(bytes(data))


@given(st.integers(0, 10_000))
def test_a_cut_message_is_refused(length: int) -> None:
    with pytest.raises(InputError):
        receive(MESSAGE[: length % len(MESSAGE)])


@pytest.mark.parametrize("kind", KINDS)
@given(st.data())
def test_damage_under_a_good_digest_gives_a_message_or_an_error(kind: str, data: st.DataObject) -> None:
    """A robot that lies, or a bug: whatever it sends is refused with a reason, or is sound enough to be joined."""
    content = data.draw(damaged_bytes(CONTENTS[kind]))
    start = MAGIC + bytes([VERSION, PLAIN])
    digest = hashlib.blake2b(start + content, digest_size=DIGEST).digest()
    try:
        received = receive(start + digest + content)
        if isinstance(received.content, Submap):
            join(admit([received.content, *OTHERS]).good)
    except TeamslamError:
        pass


def test_a_message_of_another_version_says_what_to_do() -> None:
    with pytest.raises(InputError, match="of version 9; this teamslam reads version 2"):
        receive(MESSAGE[:3] + b"\x09" + MESSAGE[4:])


def test_a_submap_in_the_world_frame_and_one_of_nothing_travel() -> None:
    submap = pieces_and_submaps("2d")[0][1]
    for other in (replace(submap, base=WORLD), condensed_to_nothing(submap)):
        assert canonical(receive(send("sparse", other, other.values.layout.keys).data).submap()) == canonical(other)


def test_canonical_bytes_do_not_depend_on_how_the_matrix_is_stored() -> None:
    submap = pieces_and_submaps("planar")[0][1]
    coo = submap.information.tocoo()
    shuffled = np.random.default_rng(0).permutation(len(coo.data))
    other = type(submap.information)((coo.data[shuffled], (coo.row[shuffled], coo.col[shuffled])), shape=coo.shape)
    assert canonical(replace(submap, information=other)) == canonical(submap)


def condensed_to_nothing(submap: Submap) -> Submap:
    return CONDENSINGS["condensed"](submap, np.zeros(0, np.int64))


def _a_message() -> bytes:
    submap = pieces_and_submaps("2d")[0][1]
    return send("condensed", submap, submap.landmark_keys, COMPACT).data


def _contents() -> dict[str, bytes]:
    """What stands in a message of each kind, before it is deflated and sealed."""
    piece, submap = pieces_and_submaps("2d", "range_bearing")[0]
    keep = np.union1d(submap.landmark_keys, submap.raw[0].keys)
    keep = keep[submap.values.layout.contains(keep)]
    messages = {kind: send(kind, submap, keep) for kind in CONDENSINGS} | {"raw": send_raw(piece, submap.id)}
    return {kind: inflated(message.data) for kind, message in messages.items()}


def inflated(message: bytes) -> bytes:
    content = message[5 + DIGEST :]
    return zlib.decompress(content) if message[4] != PLAIN else content


MESSAGE, CONTENTS = _a_message(), _contents()
OTHERS = [submap for _, submap in pieces_and_submaps("2d", "range_bearing")[2:]]


def test_values_keep_their_bits() -> None:
    submap = pieces_and_submaps("3d")[0][1]
    found: Values = receive(send("sparse", submap, submap.landmark_keys).data).submap().values
    assert found.state.tobytes() == submap.values.state.tobytes()
