"""What a robot says and hears: it tells what it holds, asks for what it lacks, and gives what it is asked for.

    step    (peer, time, packets in) -> (peer, packets out): pure, the same packets at the same times give the same

It pulls: nobody sends a body that was not asked for. Every packet may be lost, late, out of order or repeated: what was
asked for and did not come is asked for again, of whoever has it, and what is known already changes nothing. So robots
that can reach each other, directly or through others, hold the same in the end, and make one map of it, to the bit.

Bodies wait for their turn: `rate` bytes a second to each robot. The one who asks says in which order: what others know
by name first, which is small; then the submaps with the most measurements.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from teamslam.errors import InputError, TeamslamError
from teamslam.robot.line import Line
from teamslam.robot.opened import opened
from teamslam.robot.packets import (
    Answer,
    Ask,
    Body,
    Have,
    List,
    Packet,
    Question,
    Want,
    digest_of,
    from_bytes,
    to_bytes,
)
from teamslam.robot.peer import EVERYONE, Peer

NEVER = (-1e300, 0)
DOUBLINGS = 2  # of the time that an answer is waited for

Said = tuple[Peer, list[tuple[int, Packet]]]


@dataclass(frozen=True)
class Outgoing:
    """A packet to a robot, or to EVERYONE."""

    to: int
    data: bytes


def step(peer: Peer, now_s: float, inbox: Sequence[tuple[int, bytes]]) -> tuple[Peer, list[Outgoing]]:
    """The peer after some packets (from whom, bytes) at a time, and what it says."""
    known, said = peer.known, list[tuple[int, Packet]]()
    peer = replace(peer, asides=())
    for sender, data in inbox:
        try:
            if peer.revoked(sender):
                raise InputError("a packet of a robot that is out for ever")
            if len(data) > peer.habits.largest:
                raise InputError(f"a packet of more than {peer.habits.largest} bytes")
            peer, more = _hearing(peer, now_s, sender, from_bytes(data))
            peer = peer.on(sender, replace(peer.lines[sender], heard_s=now_s))
            said += more
        except TeamslamError as error:
            peer = peer.refusing(sender, str(error))
    if peer.known is not known:
        peer = replace(peer, heard_s=now_s)
    for turn in (_asking, _sending, _telling):
        peer, more = turn(peer, now_s)
        said += more
    return saying(peer, said)


def saying(peer: Peer, said: Sequence[tuple[int, Packet]]) -> tuple[Peer, list[Outgoing]]:
    """What is said, to whom, as far as each line's budget goes, and the peer with it written down."""
    packets = list[Outgoing]()
    for to, packet in said:
        data, line = to_bytes(packet), peer.lines.get(to, Line())
        s, size = line.sent, len(data)
        if peer.habits.budget is not None and to != EVERYONE and s.bytes + size > peer.habits.budget:
            s = replace(s, withheld=s.withheld + 1)
        else:
            packets.append(Outgoing(to, data))
            s = s.with_body(opened(packet.data).kind, size) if isinstance(packet, Body) else s.with_word(size)
        peer = peer.on(to, replace(line, sent=s))
    return peer, packets


def _hearing(peer: Peer, now_s: float, sender: int, packet: Packet) -> Said:
    line = peer.lines.get(sender, Line())
    match packet:
        case Question() | Answer():
            return replace(peer, asides=(*peer.asides, (sender, packet))).on(sender, line), []
        case Have(root):
            line = replace(line, root=root)
            if root in (peer.root, line.listed) or now_s - line.asked_s < peer.habits.patience_s:
                return peer.on(sender, line), []
            return peer.on(sender, replace(line, asked_s=now_s)), [(sender, Ask(peer.shelves))]
        case Ask(shelves):
            return peer.on(sender, line), [(sender, peer.beside(shelves))]
        case List(entries, root):
            lacked = tuple(e for e in entries if e.digest not in peer.bodies and peer.is_news(e))
            return peer.on(sender, replace(line, lists=lacked, listed=root, asked_s=-1e300)), []
        case Want(digests):
            more = tuple(d for d in digests if d in peer.bodies and d not in line.waiting)
            return peer.on(sender, replace(line, waiting=line.waiting + more)), []
        case Body(data):
            wanted = MappingProxyType({d: t for d, t in peer.wanted.items() if d != digest_of(data)})
            return replace(peer.with_heard(packet), wanted=wanted).on(sender, line), []
    raise AssertionError(packet)


def _asking(peer: Peer, now_s: float) -> Said:
    """Ask for what is missing and was not asked for lately: each body of one who has it, each time of another. Each
    time it waits twice as long for the answer, to begin with: a line may be slow, and what is slow comes no sooner if
    it is sent again."""
    patience_s = peer.habits.patience_s
    asked = {e.digest: peer.wanted.get(e.digest, NEVER) for e in peer.missing}
    due = [d for d, (when, times) in asked.items() if now_s - when >= patience_s * 2 ** min(times - 1, DOUBLINGS)]
    if not due:
        return peer, []
    holders = {
        digest: [to for to, line in sorted(peer.lines.items()) if any(e.digest == digest for e in line.lists)]
        for digest in due
    }
    turn = round(now_s / patience_s)
    wants: dict[int, list[bytes]] = {}
    for number, digest in enumerate(due):
        whom = holders[digest][(turn + number) % len(holders[digest])]
        wants.setdefault(whom, []).append(digest)
    wanted = asked | {digest: (now_s, asked[digest][1] + 1) for digest in due}
    return replace(peer, wanted=MappingProxyType(wanted)), [(to, Want(tuple(digests))) for to, digests in wants.items()]


def _sending(peer: Peer, now_s: float) -> Said:
    """Send the bodies whose turn it is."""
    out: list[tuple[int, Packet]] = []
    for to, line in sorted(peer.lines.items()):
        free_s, waiting = line.free_s, list(line.waiting)
        while waiting and free_s <= now_s:
            content = peer.bodies.get(waiting.pop(0))
            if content is None:  # replaced since
                continue
            out.append((to, content.body))
            if peer.habits.rate is not None:
                free_s = max(free_s, now_s) + len(content.data) / peer.habits.rate
        if len(waiting) != len(line.waiting):
            peer = peer.on(to, replace(line, free_s=free_s, waiting=tuple(waiting)))
    return peer, out


def _telling(peer: Peer, now_s: float) -> Said:
    """Tell what is held, if it is time."""
    if now_s - peer.announced_s < peer.habits.announce_s:
        return peer, []
    return replace(peer, announced_s=now_s), [(EVERYONE, Have(peer.root))]
