"""Links over real sockets: what a team says arrives; who is not of it is neither heard nor told anything."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest

from teamslam.errors import InputError
from teamslam.joining import build, split
from teamslam.robot.exchange import step
from teamslam.robot.link.keys import make_certificates
from teamslam.robot.link.zenoh import Address, ZenohLink
from teamslam.robot.peer import Habits, Peer
from worlds import team

pytest.importorskip("zenoh")


def free_place() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def linked(*addresses: Address) -> Iterator[list[ZenohLink]]:
    links = [ZenohLink(address) for address in addresses]
    try:
        yield links
    finally:
        for link in links:
            link.close()


def heard_within(link: ZenohLink, seconds: float, enough: int = 1) -> list[tuple[int, bytes]]:
    found: list[tuple[int, bytes]] = []
    until = time.monotonic() + seconds
    while time.monotonic() < until and len(found) < enough:
        found += link.receive()
        time.sleep(0.02)
    return found


def within(seconds: float, there: Callable[[], bool]) -> bool:
    """Whether something comes about in a time."""
    until = time.monotonic() + seconds
    while not there() and time.monotonic() < until:
        time.sleep(0.05)
    return there()


def greet(
    speaker: ZenohLink, to: int, hearer: ZenohLink, seconds: float, words: bytes = b"here I am"
) -> list[tuple[int, bytes]]:
    """What the hearer hears while the speaker says the same again and again (a packet may be dropped), until it is
    heard."""
    until, found = time.monotonic() + seconds, list[tuple[int, bytes]]()
    while time.monotonic() < until and words not in [data for _, data in found]:
        speaker.send(to, words)
        found += heard_within(hearer, 0.3)
    return found


@pytest.mark.parametrize("secret", [False, True])
def test_packets_arrive(tmp_path: Path, secret: bool) -> None:
    place = free_place()
    if secret:
        make_certificates(tmp_path, [1, 2])
    folder = tmp_path if secret else None
    one = Address("blue", 1, place, (), folder, (1, 2))
    two = Address("blue", 2, free_place(), (place,), folder, (1, 2))
    with linked(one, two) as (a, b):
        assert greet(a, 0, b, 60.0)[:1] == [(1, b"here I am")]
        assert greet(b, 1, a, 60.0)[:1] == [(2, b"here I am")]
        large = bytes(range(256)) * 4000
        assert (1, large) in greet(a, 2, b, 60.0, large)
        assert within(60.0, lambda: a.alive == {2} and b.alive == {1})
        b.close()
        assert within(60.0, lambda: not a.alive)


def test_who_is_not_of_the_team_is_not_heard(tmp_path: Path) -> None:
    place = free_place()
    make_certificates(tmp_path / "blue", [1, 2, 3])
    make_certificates(tmp_path / "red", [2])
    one = Address("blue", 1, place, (), tmp_path / "blue", (1, 2))
    friend = Address("blue", 2, free_place(), (place,), tmp_path / "blue", (1, 2))
    strangers = {
        "no certificate": Address("blue", 2, free_place(), (place,)),
        "of another authority": Address("blue", 2, free_place(), (place,), tmp_path / "red", (1, 2)),
        "revoked": Address("blue", 3, free_place(), (place,), tmp_path / "blue", (1, 2, 3)),
    }
    with linked(one) as (a,):
        for what, address in strangers.items():
            with linked(address) as (stranger,):
                assert greet(stranger, 1, a, 2.0) == [], what
                a.send(0, b"for the team")
                assert heard_within(stranger, 0.5) == [], what
        with linked(friend) as (b,):
            assert greet(b, 1, a, 60.0)[:1] == [(2, b"here I am")]


def test_nobody_speaks_for_another(tmp_path: Path) -> None:
    place = free_place()
    make_certificates(tmp_path, [1, 2, 3])
    one = Address("blue", 1, place, (), tmp_path, (1, 2, 3))
    two = Address("blue", 2, free_place(), (place,), tmp_path, (1, 2, 3))
    with linked(one, two) as (a, b):
        assert greet(b, 1, a, 60.0)
        token = b._session.liveliness().declare_token("teamslam/blue/alive/3")
        for _ in range(10):
            b._session.put("teamslam/blue/1/3", b"I am robot 3")
        heard = greet(b, 1, a, 60.0, b"I am robot 2")
        assert (2, b"I am robot 2") in heard and {sender for sender, _ in heard} == {2}
        assert within(60.0, lambda: 2 in a.alive) and a.alive == {2}
        token.undeclare()


def test_only_who_has_a_robots_certificate_tells_its_rows(tmp_path: Path) -> None:
    place = free_place()
    make_certificates(tmp_path, [1, 2])
    own = Address("blue", 1, place, (), tmp_path, (1, 2))
    sensors, two = (Address("blue", n, free_place(), (place,), tmp_path, (1, 2)) for n in (1, 2))
    told, rows = list[bytes](), "teamslam/blue/rows/1"
    with linked(own, sensors, two) as (a, s, b):
        hearer = threading.Thread(target=lambda: told.extend(a.rows()))
        hearer.start()
        assert greet(b, 1, a, 60.0)

        def heard() -> bool:
            b._session.put(rows, b"another's row")
            s._session.put(rows, b"a row\nand one more\n")
            return b"and one more" in told

        assert within(60.0, heard)
        greet(b, 1, a, 60.0, b"it was all said")
        assert set(told) == {b"a row", b"and one more"}
        a.close()
        hearer.join(60.0)
        assert not hearer.is_alive()


def test_a_team_exchanges_over_sockets(tmp_path: Path) -> None:
    log = team("2d", robots=2, poses=16, landmarks=6)
    submaps = {robot: [build(p) for p in split(log.of_robot(robot), poses_per_piece=9)] for robot in (1, 2)}
    make_certificates(tmp_path, [1, 2])
    place = free_place()
    peers = {robot: Peer(robot, Habits(0.2, 0.5)).with_submaps(submaps[robot]) for robot in (1, 2)}
    one = Address("blue", 1, place, (), tmp_path, (1, 2))
    with linked(one, Address("blue", 2, free_place(), (place,), tmp_path, (1, 2))) as links:
        until = time.monotonic() + 90.0
        while time.monotonic() < until and len({peer.root for peer in peers.values()}) > 1:
            for robot, link in zip((1, 2), links, strict=True):
                peers[robot], out = step(peers[robot], time.monotonic(), link.receive())
                for packet in out:
                    link.send(packet.to, packet.data)
            time.sleep(0.02)
    assert peers[1].held == peers[2].held and len(peers[1].held.submaps) == 4


class Wire:
    """What goes from whoever connects to `place` on to `to`, and back: TCP, carried byte for byte and counted."""

    def __init__(self, to: str) -> None:
        self.place, self.up, self.down, self._to = free_place(), 0, 0, to
        self._ends = [socket.create_server(_host_and_port(self.place))]
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def close(self) -> None:
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for end in self._ends:
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                self._ends.append(near := self._ends[0].accept()[0])
                self._ends.append(far := socket.create_connection(_host_and_port(self._to)))
                for way in (("up", near, far), ("down", far, near)):
                    self._threads.append(threading.Thread(target=self._carry, args=way))
                    self._threads[-1].start()

    def _carry(self, name: str, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                setattr(self, name, getattr(self, name) + len(data))
                sink.sendall(data)


def _host_and_port(place: str) -> tuple[str, int]:
    host, _, port = place.partition(":")
    return host, int(port)


def test_the_ledger_is_what_goes_over_the_wire(tmp_path: Path) -> None:
    """Of each robot, but for what Zenoh needs: some bytes a packet, and what it says of itself when it connects and
    now and then."""
    log = team("2d", robots=2, poses=16, landmarks=6)
    submaps = {robot: [build(p) for p in split(log.of_robot(robot), poses_per_piece=5)] for robot in (1, 2)}
    place = free_place()
    wire = Wire(place)
    one, two = Address("blue", 1, place), Address("blue", 2, free_place(), (wire.place,))
    peers = {robot: Peer(robot, Habits(0.2, 0.5)) for robot in (1, 2)}
    with closing(wire), linked(one, two) as links:
        assert within(60.0, lambda: links[0].alive == {2} and links[1].alive == {1})
        for robot in peers:
            peers[robot] = peers[robot].with_submaps(submaps[robot])
        before, until, quiet = (wire.down, wire.up), time.monotonic() + 90.0, 0
        while time.monotonic() < until and quiet < 50:
            for robot, link in zip((1, 2), links, strict=True):
                peers[robot], out = step(peers[robot], time.monotonic(), link.receive())
                for packet in out:
                    link.send(packet.to, packet.data)
            quiet = quiet + 1 if len({peer.root for peer in peers.values()}) == 1 else 0
            time.sleep(0.02)
        assert len({peer.root for peer in peers.values()}) == 1
        for robot, link, count in zip((1, 2), links, ("down", "up"), strict=True):
            said = [line.sent for line in peers[robot].lines.values()]
            ledger, packets = sum(sent.bytes for sent in said), sum(sent.bodies + sent.words for sent in said)
            carried = getattr(wire, count) - before[robot - 1]
            assert not link.dropped and packets > 10
            assert ledger <= carried <= ledger + 20 * packets + 500


def test_what_cannot_be_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="letters, digits"):
        Address("blue/red", 1, "127.0.0.1:1")
    with pytest.raises(InputError, match="which robots are members"):
        Address("blue", 1, "127.0.0.1:1", certificates=tmp_path)
    with pytest.raises(InputError, match=r"no such file"):
        ZenohLink(Address("blue", 1, free_place(), certificates=tmp_path, members=(1,)))
    make_certificates(tmp_path, [1])
    with pytest.raises(InputError, match="has a certificate already"):
        make_certificates(tmp_path, [1])
    assert (tmp_path / "robot-1.key").stat().st_mode & 0o077 == 0
    with pytest.raises(InputError, match="cannot be opened"):
        ZenohLink(Address("blue", 1, "no.such.host.invalid:1"))
