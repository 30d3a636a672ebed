"""Robots that tell, ask and send over poor links: every course of things ends in one set and one map, to the bit."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.joining import build, split
from teamslam.model import Submap
from teamslam.robot.exchange import step
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import opened
from teamslam.robot.packets import Ask, Body, Entry, Have, List, Packet, Want, digest_of, from_bytes, to_bytes
from teamslam.robot.peer import EVERYONE, Habits, Peer
from teamslam.team import SubmapSet
from teamslam.wire.messages import canonical, send
from worlds import team

ROBOTS = (1, 2, 3)
TEAM = team("2d", robots=3, poses=9, landmarks=5, sees=0.8)
SUBMAPS = {robot: [build(piece) for piece in split(TEAM.of_robot(robot), poses_per_piece=5)] for robot in ROBOTS}
OFFLINE = SubmapSet.of(*(submap for submaps in SUBMAPS.values() for submap in submaps))


@functools.cache
def map_of(known: SubmapSet) -> bytes:
    if not known.submaps:
        return b""
    return b"".join(canonical(component.map) for component in known.join().components)


def message(submap: Submap, version: int = 0) -> bytes:
    newer = replace(submap, version=version)
    return send("sparse", newer, newer.values.layout.keys).data


MESSAGES = {robot: [[message(s, v) for v in (0, 1 - n)] for n, s in enumerate(m)] for robot, m in SUBMAPS.items()}


def course(seed: int) -> tuple[dict[int, Peer], SubmapSet]:
    """Three robots for a while in bad weather: they come late, links are cut, submaps get newer versions, a robot is
    started anew with what it had on its disk. Then the weather clears a little, and each is in reach of some other (the
    first and the last only through the second)."""
    rng = np.random.default_rng([seed, 1])
    bad = Weather(
        loss=float(rng.uniform(0.0, 0.6)), twice=float(rng.uniform(0.0, 0.5)), most_s=float(rng.uniform(0.0, 4.0))
    )
    cut = [(int(rng.integers(1, 4)), float(rng.uniform(0, 20)), float(rng.uniform(0, 20))) for _ in range(3)]

    def reach(a: int, b: int, now_s: float) -> bool:
        return abs(a - b) == 1 and not any(r in (a, b) and begin < now_s < begin + long for r, begin, long in cut)

    air = Air(bad, seed, reach)
    habits = Habits(announce_s=2.0, patience_s=4.0, rate=[None, 2e4][seed % 2])
    starts = {robot: float(rng.uniform(0.0, 10.0)) for robot in ROBOTS}
    peers: dict[int, Peer] = {}
    links, known = {}, SubmapSet()
    for now_s in range(300):
        for robot in ROBOTS:
            if robot not in peers and now_s >= starts[robot]:
                peers[robot], links[robot] = Peer(robot, habits), air.link(robot)
        air.tick(now_s)
        if now_s == 25:
            air.weather = replace(bad, loss=min(bad.loss, 0.3))
        for robot, peer in peers.items():
            if now_s < 25 and rng.random() < 0.25:
                own = MESSAGES[robot][int(rng.integers(len(SUBMAPS[robot])))][int(rng.random() < 0.3)]
                peer = peer.with_bodies([own])
                known = known.merge(peer.held)
            if now_s < 25 and rng.random() < 0.05:  # killed, and started anew
                peer, links[robot] = Peer(robot, habits).with_set(peer.held), air.link(robot)
            peers[robot], out = step(peer, now_s, links[robot].receive())
            for packet in out:
                links[robot].send(packet.to, packet.data)
        if now_s > 25 and len({peer.root for peer in peers.values()}) == 1:
            break
    return peers, known


@pytest.mark.parametrize("hundred", range(10))
def test_a_thousand_courses_end_in_one_map_that_is_the_offline_one(hundred: int) -> None:
    for seed in range(100 * hundred, 100 * (hundred + 1)):
        peers, known = course(seed)
        assert all(peer.held == known for peer in peers.values()), seed
        assert all(not peer.missing and not peer.refused for peer in peers.values()), seed
        assert len({map_of(peer.held) for peer in peers.values()} | {map_of(known)}) == 1, seed


def test_what_is_exchanged_makes_the_offline_map() -> None:
    peers = {robot: Peer(robot).with_submaps(SUBMAPS[robot]) for robot in ROBOTS}
    air = Air(Weather(), 0)
    links = {robot: air.link(robot) for robot in ROBOTS}
    for tick in range(12):
        air.tick(float(tick))
        for robot in ROBOTS:
            peers[robot], out = step(peers[robot], float(tick), links[robot].receive())
            for packet in out:
                links[robot].send(packet.to, packet.data)
    assert all(map_of(peer.held) == map_of(OFFLINE) for peer in peers.values())
    # Nobody sent what was not asked for: each body went once to each of the others, from one of them.
    bodies = sum(len(m) + 1 for m in SUBMAPS.values())  # of each robot its submaps, and a page of what it knows
    assert sum(line.sent.bodies for peer in peers.values() for line in peer.lines.values()) == 2 * bodies


def test_a_step_is_pure() -> None:
    peer = Peer(1).with_submaps(SUBMAPS[1])
    inbox = [(2, to_bytes(Have(bytes(16)))), (2, to_bytes(Ask()))]
    one, first = step(peer, 5.0, inbox)
    two, second = step(peer, 5.0, inbox)
    assert first == second and one.root == two.root == peer.root and not peer.lines


def test_what_tells_most_goes_first() -> None:
    """Who asks says in which order: what others know by name, which is small, then the submaps of most measurements.
    So under a budget that is spent half way, it is the most informative that are held."""
    pieces = [4, 1, 3, 2]
    log = team("2d", robots=1, poses=sum(pieces) * 6, landmarks=5, sees=0.8)
    submaps = [build(piece) for n in pieces for piece in split(log, poses_per_piece=6 * n)[:1]]
    named = [replace(submap, id=f"1/{n}") for n, submap in enumerate(submaps)]
    other = Peer(2).with_submaps(named)
    _, out = step(Peer(1), 0.0, [(2, to_bytes(other.listing))])
    (want,) = (packet for packet in map(from_bytes, (o.data for o in out)) if isinstance(packet, Want))
    entries = {entry.digest: entry for entry in other.listing.entries}
    asked = [entries[digest] for digest in want.digests]
    assert asked[0].knows and [entry.id for entry in asked[1:]] == ["1/0", "1/2", "1/3", "1/1"]
    _, out = step(other, 0.0, [(1, to_bytes(want))])
    sent = [opened(p.data).entry for p in map(from_bytes, (o.data for o in out)) if isinstance(p, Body)]
    assert sent == asked


def test_removals_spread() -> None:
    peers = {robot: Peer(robot).with_submaps(SUBMAPS[robot]) for robot in (1, 2)}
    air = Air(Weather(), 0)
    links = {robot: air.link(robot) for robot in peers}
    gone = SUBMAPS[2][0]
    for tick in range(24):
        if tick == 10:
            removed = SubmapSet().remove(gone.id, gone.version)
            peers[1] = peers[1].with_set(removed.merge(SubmapSet().remove_robot(3, 7)))
        air.tick(float(tick))
        for robot in peers:
            peers[robot], out = step(peers[robot], float(tick), links[robot].receive())
            for packet in out:
                links[robot].send(packet.to, packet.data)
    assert peers[1].held == peers[2].held and peers[2].held.removed_robots == {3: 7}
    assert gone.id not in {submap.id for submap in peers[2].held.submaps}


def test_a_rate_is_kept() -> None:
    peer = Peer(1, Habits(rate=1000.0)).with_submaps(SUBMAPS[1])
    wanted = to_bytes(Want(tuple(peer.bodies)))
    sizes = [content.entry.size for content in peer.bodies.values()]
    gone, now_s = 0, 0.0
    inbox = [(2, wanted)]
    for _ in range(2000):
        peer, out = step(peer, now_s, inbox)
        gone += sum(len(packet.data) for packet in out if isinstance(from_bytes(packet.data), Body))
        assert gone <= 1000.0 * now_s + max(sizes) + 100
        inbox, now_s = [], now_s + 0.1
    assert gone >= sum(sizes)


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.binary(max_size=200), st.integers(0, 400)))
@example(93)
def test_packets_that_make_no_sense_are_refused_and_counted(noise: bytes | int) -> None:
    peer = Peer(1).with_submaps(SUBMAPS[1])
    body = next(iter(peer.bodies.values())).data
    data = to_bytes(Body(body))
    if isinstance(noise, int):  # a bit of a sound body is turned
        turned = bytearray(data)
        turned[noise % len(data)] ^= 1 << (noise % 8)
        noise = bytes(turned)
    after, _ = step(Peer(2), 0.0, [(1, noise)])
    try:
        packet: Packet | None = from_bytes(noise)
    except InputError:
        packet = None
    if isinstance(packet, Body) and packet.data == body:  # who signed it says nothing where nobody signs
        assert list(after.bodies) == [digest_of(body)] and not after.refused
        return
    assert after.held == SubmapSet() and after.root == Peer(2).root
    assert (packet is not None and not isinstance(packet, Body)) or sum(after.refused.values()) == 1


def test_a_packet_that_is_too_large_is_refused() -> None:
    peer, _ = step(Peer(1, Habits(largest=100)), 0.0, [(2, to_bytes(Body(bytes(200))))])
    assert list(peer.refused.values()) == [1] and "more than 100 bytes" in next(iter(peer.refused))


@pytest.mark.parametrize(
    "packet",
    [
        Have(bytes(16)),
        Ask(),
        Want((bytes(16),)),
        Body(b"x"),
        List((Entry("a", 1, bytes(16), gone=True), Entry("b", 2, bytes(16), 3, 4))),
    ],
)
def test_packets_come_back_from_bytes(packet: Have | Ask | Want | Body | List) -> None:
    assert from_bytes(to_bytes(packet)) == packet


def test_lines_that_cannot_be_are_named() -> None:
    for wrong in ({"loss": 1.0}, {"twice": -0.1}, {"least_s": 2.0, "most_s": 1.0}, {"rate": 0.0}):
        with pytest.raises(InputError):
            Weather(**wrong)
    with pytest.raises(InputError):
        Habits(patience_s=0.0)
    assert EVERYONE == 0


@given(st.sets(st.integers(0, 5)), st.sets(st.integers(0, 5)))
def test_a_list_holds_all_that_is_lacked_and_little_of_what_both_hold(mine: set[int], theirs: set[int]) -> None:
    bodies = [m for messages in MESSAGES.values() for (m, *_) in messages]
    a, b = (Peer(n).with_bodies(bodies[k] for k in held) for n, held in ((1, mine), (2, theirs)))
    told = b.beside(a.shelves)
    lacked = {e.digest for e in b.listing.entries} - {e.digest for e in a.listing.entries}
    assert lacked <= {e.digest for e in told.entries} <= {e.digest for e in b.listing.entries}
    assert mine != theirs or not told.entries
    assert b.beside(()).entries == b.listing.entries and b.beside(()).root == b.root


@settings(max_examples=15, deadline=None)
@given(st.integers(100, 60_000), st.integers(0, 100), st.floats(0.0, 0.4))
def test_no_line_carries_more_than_its_budget_and_what_is_held_is_what_came(
    budget: int, seed: int, loss: float
) -> None:
    peers = {robot: Peer(robot, Habits(budget=budget)).with_submaps(SUBMAPS[robot]) for robot in ROBOTS}
    whole_set = functools.reduce(SubmapSet.merge, (peer.held for peer in peers.values()))
    air = Air(Weather(loss, most_s=0.5), seed)
    links = {robot: air.link(robot) for robot in ROBOTS}
    for tick in range(240):
        air.tick(float(tick))
        for robot in ROBOTS:
            peers[robot], out = step(peers[robot], float(tick), links[robot].receive())
            for packet in out:
                links[robot].send(packet.to, packet.data)
    lines = {(a, b): line.sent for a, peer in peers.items() for b, line in peer.lines.items() if b != EVERYONE}
    to_all = {a: peer.lines[EVERYONE].sent.bytes for a, peer in peers.items()}
    assert all(sent.bytes <= budget for sent in lines.values())
    assert {line: sent.bytes + to_all[line[0]] for line, sent in lines.items()} == air.carried
    whole = all(peer.held == whole_set for peer in peers.values())
    assert whole or any(sent.withheld for sent in lines.values())


def test_what_both_know_is_not_told_again_and_again() -> None:
    """A robot that waits for bodies asks for no list that it has: of what the other holds it knows all."""
    peer, other = Peer(1, Habits(patience_s=1.0)), Peer(2).with_submaps(SUBMAPS[2])
    asks = 0
    for tick in range(100):
        peer, out = step(peer, float(tick), [(2, to_bytes(Have(other.root)))])
        said = [from_bytes(packet.data) for packet in out]
        asks += sum(isinstance(packet, Ask) for packet in said)
        if any(isinstance(packet, Ask) for packet in said):
            peer, _ = step(peer, float(tick), [(2, to_bytes(other.beside(())))])
    assert asks == 1 and len(peer.missing) == len(SUBMAPS[2]) + 1  # and a page of what it knows


def test_who_is_there_and_in_reach_is_alive() -> None:
    air = Air(Weather(), 0, lambda a, b, now_s: {a, b} != {1, 3} or now_s > 5.0)
    links = {robot: air.link(robot) for robot in ROBOTS}
    assert [links[robot].alive for robot in ROBOTS] == [{2}, {1, 3}, {2}]
    air.tick(6.0)
    air.leave(2)
    assert links[1].alive == {3} and links[3].alive == {1}
