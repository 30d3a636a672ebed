"""Set semantics: any order, repetition and loss of messages gives one set, and one map, to the bit."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import generators
from teamslam.errors import InputError, ModelError
from teamslam.joining import Joined, build, condense, join, separators, split
from teamslam.model import Submap
from teamslam.team import SubmapSet
from teamslam.wire import COMPACT, receive, send, send_raw
from teamslam.wire.messages import canonical
from worlds import team


def _versions() -> dict[str, list[Submap]]:
    """Two versions of each of a small team's four submaps; the newer one differs by a millimetre or so."""
    versions: dict[str, list[Submap]] = {}
    for version in (1, 2):
        log = team("2d", robots=2, poses=6, landmarks=4, sees=0.8)
        pieces = split(log, poses_per_piece=4)
        whole = [build(piece, version=version) for piece in pieces]
        keep = separators(whole, landmarks=True)
        for submap in whole:
            small, _ = condense(submap, keep[submap.id])
            state = small.values.retract(np.full(small.dof, 1e-3 * (version - 1)))
            versions.setdefault(submap.id, []).append(replace(small, values=state))
    return versions


VERSIONS = _versions()
IDS = sorted(VERSIONS)
ROBOTS = (1, 2)


def to_bytes(joined: Joined) -> bytes:
    return b"".join(canonical(c.map) for c in joined.components)


def test_sets_of_the_same_content_are_equal_and_hash_alike() -> None:
    a, b = VERSIONS[IDS[0]][0], VERSIONS[IDS[1]][0]
    assert SubmapSet.of(a, b) == SubmapSet.of(b, a, b)
    assert hash(SubmapSet.of(a, b)) == hash(SubmapSet.of(b, a))
    assert SubmapSet.of(a) != SubmapSet.of(b)


Event = tuple[str, str | int, int]  # what, of whom, version

events = st.one_of(
    st.tuples(st.just("submap"), st.sampled_from(IDS), st.integers(1, 2)),
    st.tuples(st.just("remove"), st.sampled_from(IDS), st.integers(1, 2)),
    st.tuples(st.just("remove robot"), st.sampled_from(ROBOTS), st.integers(1, 2)),
)


@functools.cache
def message(event: Event) -> SubmapSet:
    """What one message brings: submaps go through their bytes, as they do between robots."""
    what, of, version = event
    if what == "submap":
        submap = VERSIONS[str(of)][version - 1]
        return SubmapSet.of(send("sparse", submap, submap.values.layout.keys).data)
    if what == "remove":
        return SubmapSet().remove(str(of), version)
    return SubmapSet().remove_robot(int(of), version)


def schedule(rng: np.random.Generator) -> tuple[list[Event], list[Event]]:
    """What the team sent, and one robot's way of hearing it: some lost until the final resend, some twice, in any
    order."""
    sent: list[Event] = [("submap", id_, 1) for id_ in rng.permutation(IDS)[: rng.integers(2, len(IDS) + 1)]]
    sent += [("submap", id_, 2) for id_ in rng.permutation(IDS)[: rng.integers(0, 3)]]
    sent += [("remove", id_, int(rng.integers(1, 3))) for id_ in rng.permutation(IDS)[: rng.integers(0, 2)]]
    if rng.random() < 0.2:
        sent.append(("remove robot", int(rng.choice(ROBOTS)), int(rng.integers(1, 3))))
    heard = [event for event in sent if rng.random() < 0.6]
    again = [sent[n] for n in rng.integers(0, len(sent), rng.integers(0, 7))]
    first = heard + again
    return sent, [first[n] for n in rng.permutation(len(first))] + [sent[n] for n in rng.permutation(len(sent))]


@settings(max_examples=1000)
@given(generators)
def test_any_schedule_gives_the_same_map_to_the_bit(rng: np.random.Generator) -> None:
    sent, heard = schedule(rng)
    reference = SubmapSet()
    for event in sent:
        reference = reference.merge(message(event))
    # What one robot hears comes by several relays that gossip at the end.
    parts = [SubmapSet()] * int(rng.integers(1, 5))
    for event in heard:
        relay = int(rng.integers(len(parts)))
        parts[relay] = parts[relay].merge(message(event))
    known = functools.reduce(SubmapSet.merge, reversed(parts))
    assert known == reference
    assert hash(known) == hash(reference)
    here = map_of(known)
    assert here == map_of_any(tuple(sorted((s.id, s.version) for s in reference.submaps)))


@functools.cache
def map_of(known: SubmapSet) -> bytes:
    """The map of a set as bytes; a set of equal content is joined once."""
    return to_bytes(known.join()) if known.submaps else b""


@functools.cache
def map_of_any(present: tuple[tuple[str, int], ...]) -> bytes:
    """The map of these versions, never messages, joined in reverse."""
    submaps = [VERSIONS[id_][version - 1] for id_, version in reversed(present)]
    fresh = [receive(send("sparse", s, s.values.layout.keys).data).submap() for s in submaps]
    return to_bytes(join(fresh)) if fresh else b""


@given(st.lists(events, max_size=4), st.lists(events, max_size=4), st.lists(events, max_size=4))
def test_merging_is_a_join_semilattice(one: list[Event], two: list[Event], three: list[Event]) -> None:
    a, b, c = (functools.reduce(SubmapSet.merge, map(message, part), SubmapSet()) for part in (one, two, three))
    assert a.merge(b) == b.merge(a)
    assert a.merge(b).merge(c) == a.merge(b.merge(c))
    assert a.merge(a) == a
    assert a.merge(SubmapSet()) == a
    assert a.merge(b).merge(b) == a.merge(b)


def test_removal_is_as_if_it_had_never_been_there() -> None:
    everything = SubmapSet.of(*(VERSIONS[id_][0] for id_ in IDS))
    without = SubmapSet.of(*(VERSIONS[id_][0] for id_ in IDS[:-1]))
    assert to_bytes(everything.remove(IDS[-1]).join()) == to_bytes(without.join())

    others = SubmapSet.of(*(v[0] for v in VERSIONS.values() if 2 not in v[0].robots))
    assert to_bytes(everything.remove_robot(2).join()) == to_bytes(others.join())


def test_a_newer_version_replaces_and_comes_back_after_a_removal() -> None:
    old, new = VERSIONS[IDS[0]]
    assert [s.version for s in SubmapSet.of(new, old).submaps] == [2]
    assert SubmapSet.of(old).remove(old.id).submaps == ()
    assert [s.version for s in SubmapSet.of(old).remove(old.id).add(new).submaps] == [2]
    assert SubmapSet.of(new).remove(old.id, 1) == SubmapSet.of(new)
    assert SubmapSet().remove_robot(old.robots[0], 1).add(old).submaps == ()
    assert [s.version for s in SubmapSet().remove_robot(old.robots[0], 1).add(new).submaps] == [2]


def test_two_contents_under_one_version_are_refused_by_everyone() -> None:
    first, second, *_ = (VERSIONS[id_] for id_ in IDS)
    forged = replace(first[1], version=1)
    a = SubmapSet.of(first[0], second[0], forged)
    b = SubmapSet.of(forged, second[0], first[0])
    assert a == b
    assert [s.id for s in a.submaps] == [second[0].id]
    assert "2 different submaps are all called" in a.admission.refused[0].reason
    assert [s.version for s in a.add(replace(first[1], version=2)).submaps if s.id == first[0].id] == [2]


def test_what_is_not_held_cannot_be_removed_without_a_version() -> None:
    with pytest.raises(ModelError, match="name the version"):
        SubmapSet().remove("nobody")


def test_nothing_to_join_is_said() -> None:
    with pytest.raises(ModelError, match="empty"):
        SubmapSet().join()


def test_rounded_and_raw_messages_are_held_as_they_came() -> None:
    log = team("2d", robots=2, poses=6, landmarks=4, sees=0.8)
    pieces = split(log, poses_per_piece=100)
    submaps = [build(piece) for piece in pieces]
    needed = separators(submaps)
    rounded = send("condensed", submaps[0], needed[submaps[0].id], COMPACT)
    raw = send_raw(pieces[1], submaps[1].id)
    known = SubmapSet.of(rounded, raw.data)
    assert known == SubmapSet.of(raw, rounded.data, rounded)
    assert [s.id for s in known.submaps] == [s.id for s in submaps]
    assert canonical(known.submaps[1]) == canonical(submaps[1])
    assert to_bytes(known.join()) == to_bytes(join([receive(rounded.data).submap(), submaps[1]]))
    with pytest.raises(InputError, match="damaged"):
        known.add(rounded.data[:-1])
