"""What robots sign: neither who passes a submap on nor another member can alter, invent or withdraw one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.joining import build, split
from teamslam.model import Names, Sources, Submap
from teamslam.robot.exchange import step
from teamslam.robot.journal import Journal
from teamslam.robot.link.keys import make_certificates, read_revocations, read_seal, revoke
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import announcements
from teamslam.robot.packets import EVER, Body, Entry, List, Removal, digest_of, from_bytes, to_bytes
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.rows import head_of
from teamslam.robot.seal import Seal
from teamslam.team import Knowledge, SubmapSet
from teamslam.wire.messages import send
from worlds import team

pytest.importorskip("cryptography")

ROBOTS = (1, 2, 3)
LOG = team("2d", robots=3, poses=9, landmarks=5, sees=0.8)
SUBMAPS = {robot: [build(piece) for piece in split(LOG.of_robot(robot), poses_per_piece=5)] for robot in ROBOTS}


@pytest.fixture(scope="module")
def secrets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("secrets")
    make_certificates(folder, ROBOTS)
    return folder


@pytest.fixture(scope="module")
def seals(secrets: Path) -> dict[int, Seal]:
    return {robot: read_seal(secrets, "blue", robot, ROBOTS, LOG.names) for robot in ROBOTS}


def message(submap: Submap) -> bytes:
    return send("sparse", submap, submap.values.layout.keys).data


def heard(peer: Peer, sender: int, *bodies: Body, now_s: float = 0.0) -> Peer:
    """A peer after bodies that came from another robot."""
    return step(peer, now_s, [(sender, to_bytes(body)) for body in bodies])[0]


def refused(peer: Peer, sender: int, says: str) -> bool:
    """Whether one packet of a robot was refused, with these words, and nothing came of it."""
    return list(peer.refused.values()) == [1] and says in next(iter(peer.refused)) and peer.lines[sender].refused == 1


def exchanged(peers: dict[int, Peer], first_s: int = 0) -> dict[int, Peer]:
    """Robots in a row that reach their neighbours, for 20 s."""
    air = Air(Weather(), 0, lambda a, b, now_s: abs(a - b) == 1)
    links = {robot: air.link(robot) for robot in peers}
    for tick in range(first_s, first_s + 20):
        air.tick(float(tick))
        for robot, peer in peers.items():
            peers[robot], out = step(peer, float(tick), links[robot].receive())
            for packet in out:
                links[robot].send(packet.to, packet.data)
    return peers


def test_what_is_signed_is_passed_on_and_makes_one_map(seals: dict[int, Seal]) -> None:
    peers = exchanged({robot: Peer(robot, seal=seals[robot]).with_submaps(SUBMAPS[robot]) for robot in ROBOTS})
    offline = SubmapSet.of(*(submap for submaps in SUBMAPS.values() for submap in submaps))
    assert all(peer.held == offline and not peer.refused for peer in peers.values())
    signed_by = {
        content.entry.id: content.body.robot for content in peers[3].bodies.values() if not content.entry.knows
    }
    assert signed_by == {submap.id: robot for robot, submaps in SUBMAPS.items() for submap in submaps}


def test_a_submap_that_a_relay_altered_is_refused(seals: dict[int, Seal]) -> None:
    """Altered so that the message's own digest fits again: only the signature tells."""
    body = seals[1].signed(message(SUBMAPS[1][0]))
    other = message(replace(SUBMAPS[1][0], version=7))
    peer = heard(Peer(3, seal=seals[3]), 2, Body(other, 1, body.signature))
    assert refused(peer, 2, "not what robot 1 signed") and not peer.bodies


def test_a_submap_that_was_invented_for_another_robot_is_refused(seals: dict[int, Seal]) -> None:
    data = message(SUBMAPS[1][0])
    unsigned, under_its_own_name = Body(data), seals[2].signed(data)
    under_another = Body(data, 1, under_its_own_name.signature)
    for body, says in (
        (unsigned, "not what robot 0 signed"),
        (under_its_own_name, "robot 2 signed a body that is of robot 1"),
        (under_another, "not what robot 1 signed"),
    ):
        peer = heard(Peer(3, seal=seals[3]), 2, body)
        assert refused(peer, 2, says) and not peer.bodies


def test_a_submap_of_ones_own_that_would_replace_anothers_is_refused(seals: dict[int, Seal]) -> None:
    stolen = replace(SUBMAPS[2][0], id=SUBMAPS[1][0].id, version=99)
    named = replace(stolen, names=replace(stolen.names, robots={2: "1"}))
    peer = Peer(3, seal=seals[3]).recalling([seals[1].signed(message(SUBMAPS[1][0]))])
    for submap in (stolen, named):
        after = heard(peer, 2, seals[2].signed(message(submap)))
        assert refused(after, 2, "give all robots the same names") and after.held == peer.held


def test_a_submap_of_rows_of_another_robot_is_refused(seals: dict[int, Seal]) -> None:
    """Rows that count as used are used by nobody else: who could claim another's would take them out of the map."""
    mine, theirs = SUBMAPS[2][0], SUBMAPS[1][0]
    claims = replace(mine, sources=mine.sources.merge(theirs.sources))
    peer = heard(Peer(3, seal=seals[3]), 2, seals[2].signed(message(claims)))
    assert refused(peer, 2, "robot 2 signed a body that is of robot 1, 2") and not peer.bodies


def test_a_submap_that_names_no_rows_is_refused(seals: dict[int, Seal]) -> None:
    """Under its own robot's name and signature: its rows would count again in every other submap that holds them."""
    nameless = replace(SUBMAPS[2][0], sources=Sources())
    peer = heard(Peer(3, seal=seals[3]), 2, seals[2].signed(message(nameless)))
    assert refused(peer, 2, "robot 2 signed a submap that names no rows") and not peer.bodies


def test_a_submap_that_is_written_from_another_robots_pose_is_refused(seals: dict[int, Seal]) -> None:
    """Whose pose it is written from is asked for its rows in exact rounds."""
    mine, theirs = SUBMAPS[2][0], SUBMAPS[1][0]
    peer = heard(Peer(3, seal=seals[3]), 2, seals[2].signed(message(replace(mine, base=theirs.base))))
    assert refused(peer, 2, "robot 2 signed a body that is of robot 1, 2") and not peer.bodies


def test_what_was_recorded_and_is_sent_again_changes_nothing(seals: dict[int, Seal]) -> None:
    old, new = (seals[1].signed(message(replace(SUBMAPS[1][0], version=v))) for v in (0, 1))
    peer = heard(Peer(3, seal=seals[3]), 1, old, new)
    again = heard(peer, 2, old, new, old)
    assert again.held == peer.held and again.root == peer.root and not again.refused


def test_what_was_signed_in_another_team_is_refused(secrets: Path, seals: dict[int, Seal]) -> None:
    yesterday = read_seal(secrets, "yesterday", 1, ROBOTS, LOG.names)
    peer = heard(Peer(3, seal=seals[3]), 1, yesterday.signed(message(SUBMAPS[1][0])))
    assert refused(peer, 1, "not what robot 1 signed")


def test_what_a_robot_signed_that_is_no_member_is_refused(secrets: Path, seals: dict[int, Seal]) -> None:
    peer = Peer(3, seal=read_seal(secrets, "blue", 3, (2, 3), LOG.names))
    assert refused(heard(peer, 2, seals[1].signed(message(SUBMAPS[1][0]))), 2, "robot 1 signed, which is no member")


def test_what_makes_no_sense_is_refused_though_it_is_signed(seals: dict[int, Seal]) -> None:
    sound = message(SUBMAPS[2][0])
    broken = (b"", b"tsm", sound[:-1], sound + b"x", to_bytes(Removal(2, "2/0", 1)) + b"x", bytes(1000))
    peer = Peer(3, seal=seals[3])
    for number, data in enumerate(broken, 1):
        peer = heard(peer, 2, seals[2].signed(data))
        assert peer.lines[2].refused == number
    assert not peer.bodies


def test_what_is_too_large_is_refused_before_it_is_looked_at(seals: dict[int, Seal]) -> None:
    peer = Peer(3, Habits(largest=1000), seal=seals[3])
    assert refused(heard(peer, 2, seals[2].signed(bytes(1000))), 2, "more than 1000 bytes")


def test_a_robot_withdraws_its_own_submaps_and_nobody_elses(seals: dict[int, Seal]) -> None:
    peers = {robot: Peer(robot, seal=seals[robot]).with_submaps(SUBMAPS[robot]) for robot in ROBOTS}
    gone = SUBMAPS[1][0]
    peers[1] = peers[1].with_set(SubmapSet().remove(gone.id, gone.version))
    peers = exchanged(peers)
    assert peers[1].held == peers[2].held == peers[3].held and not any(peer.refused for peer in peers.values())
    assert gone.id not in {submap.id for submap in peers[3].held.submaps} and len(peers[3].held.submaps) == 5
    for removal in (Removal(1, SUBMAPS[1][1].id, 5), Removal(2, SUBMAPS[1][1].id, 5), Removal(1, "", EVER)):
        after = heard(peers[3], 2, seals[2].signed(to_bytes(removal)))
        assert after.held == peers[3].held and after.lines[2].refused == 1
    with pytest.raises(InputError, match="robot 2 signed a body that is of robot 1"):
        peers[2].with_set(SubmapSet().remove_robot(1, 5))


def test_a_revocation_spreads_and_ends_what_the_robot_said(tmp_path: Path) -> None:
    make_certificates(tmp_path, ROBOTS)
    revoke(tmp_path, "blue", [1])
    peers = {
        robot: Peer(robot, seal=read_seal(tmp_path, "blue", robot, ROBOTS, LOG.names)).with_submaps(SUBMAPS[robot])
        for robot in ROBOTS
    }
    peers = exchanged(peers)
    assert len(peers[3].held.submaps) == 6
    peers[2] = peers[2].recalling(read_revocations(tmp_path))
    peers = exchanged(peers, 50)
    assert {r for submap in peers[3].held.submaps for r in submap.robots} == {2, 3}
    assert peers[3].revoked(1) and peers[2].root == peers[3].root
    after, out = step(peers[3], 100.0, [(1, to_bytes(List(())))])
    assert "out for ever" in next(iter(after.refused)) and after.lines[1].refused == 1
    assert not [packet for packet in out if packet.to == 1]


def test_signatures_are_remembered(tmp_path: Path, seals: dict[int, Seal]) -> None:
    """A robot that was started anew passes on what it heard, with the signatures; removals as well."""
    peer = Peer(2, seal=seals[2]).recalling(seals[1].signed(message(submap)) for submap in SUBMAPS[1])
    peer = peer.with_submaps(SUBMAPS[2])
    peer = peer.with_set(SubmapSet().remove(SUBMAPS[2][0].id, 4))
    with Journal(tmp_path / "journal.db", head_of(LOG, 2)) as journal:
        assert journal.bodies(content.body for content in peer.bodies.values())
    with Journal(tmp_path / "journal.db", head_of(LOG, 2)) as journal:
        again = Peer(2, seal=seals[2]).recalling(journal.recall().bodies)
    assert again.root == peer.root and again.held == peer.held and not again.refused
    assert exchanged({2: again, 3: Peer(3, seal=seals[3])})[3].held == peer.held


def test_nobody_tells_what_another_robot_knows(seals: dict[int, Seal]) -> None:
    (page,) = announcements(Knowledge().with_more(1, np.arange(3)))
    peer = Peer(3, seal=seals[3])
    assert refused(heard(peer, 2, seals[2].signed(page)), 2, "robot 2 signed a body that is of robot 1")
    said = heard(peer, 2, seals[1].signed(page))  # passed on
    assert said.known.of(1) == {0, 1, 2} and not said.refused


def test_a_removal_in_the_list_is_only_a_word(seals: dict[int, Seal]) -> None:
    """A list says what there is to be fetched, and changes nothing that is held."""
    peer = Peer(3, seal=seals[3]).recalling([seals[1].signed(message(SUBMAPS[1][0]))])
    entry = Entry(SUBMAPS[1][0].id, 9, digest_of(b"not there"), gone=True)
    after, out = step(peer, 0.0, [(2, to_bytes(List((entry,))))])
    assert after.held == peer.held
    assert [type(from_bytes(packet.data)).__name__ for packet in out if packet.to == 2] == ["Want"]


def test_keys_that_do_not_fit_are_named(tmp_path: Path) -> None:
    make_certificates(tmp_path / "blue", (1, 2))
    make_certificates(tmp_path / "red", (1, 2))
    blue = tmp_path / "blue"
    with pytest.raises(InputError, match=r"robot-3.sign.crt: there is no such file"):
        read_seal(blue, "blue", 1, (1, 2, 3), Names())
    (blue / "robot-2.sign.crt").write_bytes((blue / "robot-1.sign.crt").read_bytes())
    with pytest.raises(InputError, match="not the certificate by which robot-2 signs"):
        read_seal(blue, "blue", 1, (1, 2), Names())
    (blue / "robot-2.sign.crt").write_bytes((tmp_path / "red" / "robot-2.sign.crt").read_bytes())
    with pytest.raises(InputError, match="no certificate of the authority"):
        read_seal(blue, "blue", 1, (1, 2), Names())
    with pytest.raises(InputError, match="only the authority"):
        revoke(tmp_path / "green", "blue", [1])
    assert (blue / "robot-1.sign.key").stat().st_mode & 0o077 == 0


def test_a_key_that_does_not_fit_its_certificate_is_named_and_whose_it_is(tmp_path: Path) -> None:
    make_certificates(tmp_path, (1, 2))
    for kind in ("sign.key", "key"):
        own = tmp_path / f"robot-1.{kind}"
        kept = own.read_bytes()
        own.write_bytes((tmp_path / f"robot-2.{kind}").read_bytes())
        with pytest.raises(InputError, match=f"robot-1.{kind}: this key does not fit robot-1.{kind[:-3]}crt") as error:
            read_seal(tmp_path, "blue", 1, (1, 2), Names())
        assert f"it is that of robot-2.{kind[:-3]}crt" in str(error.value)
        (tmp_path / f"robot-2.{kind[:-3]}crt").rename(tmp_path / "away")
        with pytest.raises(InputError, match="it fits no certificate here"):
            read_seal(tmp_path, "blue", 1, (1,), Names())
        (tmp_path / "away").rename(tmp_path / f"robot-2.{kind[:-3]}crt")
        own.write_bytes(kept)
    read_seal(tmp_path, "blue", 1, (1, 2), Names())
