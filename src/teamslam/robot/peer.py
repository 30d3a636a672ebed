"""A robot among others: it tells what it holds, asks for what it lacks, and ends up with what all know together.

    step    (peer, time, packets in) -> (peer, packets out): pure, the same packets at the same times give the same

It pulls: nobody sends a body that was not asked for. Every packet may be lost, late, out of order or repeated: what is
held is a set that grows (`SubmapSet`), what was asked for and did not come is asked for again, of whoever has it, and
what is known already changes nothing. So robots that can reach each other, directly or through others, hold the same in
the end, and make one map of it, to the bit. A body is passed on as the bytes that were heard, and under a seal only
what its own robot has signed is taken.

Bodies wait for their turn: `rate` bytes a second to each robot. The one who asks says in which order: what others know
by name first, which is small; then the submaps with the most measurements.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import IntArray
from teamslam.model import Submap
from teamslam.robot.forms import VERSIONS, Order, allowance, made, orders, stock
from teamslam.robot.line import Content, Line
from teamslam.robot.namesakes import left_out
from teamslam.robot.opened import announcements, opened
from teamslam.robot.packets import (
    EVER,
    Answer,
    Ask,
    Body,
    Entry,
    Have,
    List,
    Packet,
    Question,
    Removal,
    Want,
    digest_of,
    from_bytes,
    root_of,
    shelf_of,
    shelves_of,
    to_bytes,
)
from teamslam.robot.seal import Seal
from teamslam.team import Knowledge, SubmapSet

EVERYONE = 0  # in place of a robot's number: all that can be reached
NEVER = (-1e300, 0)
DOUBLINGS = 2  # of the time that an answer is waited for
RESTS = 5  # doublings of the time before a submap that went in short comes again
REASONS, OTHERWISE = 100, "for other reasons"  # why packets were refused: so many are told apart


@dataclass(frozen=True)
class Habits:
    """How often a robot tells what it holds [s], how long it waits for an answer [s], how many bytes of bodies it sends
    to each other robot [a second; None: all that is asked for], how large a packet it takes [bytes], and how many bytes
    it sends to each other robot in all [None: any number]; what it tells to all at once does not count there."""

    announce_s: float = 1.0
    patience_s: float = 3.0
    rate: float | None = None
    largest: int = 64 << 20
    budget: float | None = None

    def __post_init__(self) -> None:
        for name in ("announce_s", "patience_s", "rate", "largest", "budget"):
            found = getattr(self, name)
            if found is not None and not 0 < found < float("inf"):
                raise InputError(f"a number above 0 is needed, found {found}", field=name)


@dataclass(frozen=True)
class Outgoing:
    """A packet to a robot, or to EVERYONE."""

    to: int
    data: bytes


@dataclass(frozen=True, eq=False)
class Peer:
    """A robot among others. `seal`: how it signs, and knows what others signed; None: nobody signs.

    `held`: the team's submaps, `known`: what each robot knows by name, as far as was heard, last at `heard_s`; `own`:
    its own submaps, whole; `bodies` by digest, `mine`: those of them that it made; `lines` to others by their number;
    `wanted`: when each body was last asked for, and how often; `announced_s`: when it last told what it holds;
    `asides`: what the last step heard that is not of the exchange; `refused`: packets that made no sense, by reason.
    """

    number: int
    habits: Habits = field(default_factory=Habits)
    seal: Seal | None = None
    held: SubmapSet = field(default_factory=SubmapSet)
    known: Knowledge = field(default_factory=Knowledge)
    own: Mapping[str, Submap] = field(default_factory=lambda: MappingProxyType({}))
    bodies: Mapping[bytes, Content] = field(default_factory=lambda: MappingProxyType({}))
    mine: frozenset[bytes] = frozenset()
    lines: Mapping[int, Line] = field(default_factory=lambda: MappingProxyType({}))
    wanted: Mapping[bytes, tuple[float, int]] = field(default_factory=lambda: MappingProxyType({}))
    announced_s: float = -1e300
    heard_s: float = -1e300
    asides: tuple[tuple[int, Question | Answer], ...] = ()
    refused: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))

    # --- what it holds --------------------------------------------------------------------------------------------

    @cached_property
    def listing(self) -> List:
        """All that it holds, in order."""
        entries = [content.entry for content in self.bodies.values()]
        return List(tuple(sorted(entries, key=lambda entry: (entry.id, entry.digest))))

    @cached_property
    def root(self) -> bytes:
        """What names all that it holds."""
        return root_of(self.listing)

    @cached_property
    def shelves(self) -> tuple[bytes, ...]:
        """What names each part of what it holds."""
        return shelves_of(self.listing)

    def beside(self, shelves: Sequence[bytes]) -> List:
        """What it holds on the shelves that are not the same elsewhere. So what words cost is what is new, not what
        both hold already."""
        if len(shelves) != len(self.shelves):
            return List(self.listing.entries, self.root)
        differ = {n for n, (mine, theirs) in enumerate(zip(self.shelves, shelves, strict=True)) if mine != theirs}
        return List(tuple(e for e in self.listing.entries if shelf_of(e.id) in differ), self.root)

    @cached_property
    def missing(self) -> tuple[Entry, ...]:
        """What others said they hold, and this one lacks: what they know first, then submaps with the most
        measurements."""
        known = {e.digest: e for line in self.lines.values() for e in line.lists}
        lacked = [entry for entry in known.values() if entry.digest not in self.bodies and self._news(entry)]
        return tuple(sorted(lacked, key=lambda entry: (not entry.knows, -entry.rows, entry.digest)))

    def _news(self, entry: Entry) -> bool:
        """Whether what an entry stands for would change what is held."""
        if entry.robot:
            return self.held.removed_robots.get(entry.robot, -1) < entry.version
        if entry.knows:
            return all(c.entry.version <= entry.version for c in self.bodies.values() if c.entry.id == entry.id)
        mine = self.held.held.get(entry.id)
        if mine is None:
            return True
        return (entry.version, entry.gone) > (mine.version, mine.removed) or (
            entry.version == mine.version and not mine.removed and not entry.gone
        )

    @property
    def in_short(self) -> int:
        """How many of the submaps that it holds went rounded or condensed."""
        return sum(content.opened.short for content in self.bodies.values())

    def revoked(self, robot: int) -> bool:
        """Whether all submaps of a robot are out, for ever."""
        return self.held.removed_robots.get(robot, -1) == EVER

    def with_submaps(self, submaps: Iterable[Submap]) -> "Peer":
        """With submaps of its own and their messages, made at once: `owning`, and what is in its `orders`."""
        peer = self.owning(submaps)
        return peer.with_messages(made(peer.orders))

    def owning(self, submaps: Iterable[Submap]) -> "Peer":
        """With submaps of its own, new or in newer versions, of which no message is made yet; what they name is told to
        others."""
        fresh = [s for s in submaps if s.id not in self.own or self.own[s.id].version < s.version]
        if not fresh:
            return self
        named = [keys for s in fresh for keys in (s.keys, *(table.keys.ravel() for table in s.raw))]
        own = MappingProxyType({**self.own, **{submap.id: submap for submap in fresh}})
        return replace(self, own=own).knowing(np.concatenate(named))

    @cached_property
    def unmade(self) -> tuple[Order, ...]:
        """The messages of its own submaps that are yet to be made: of new ones and newer versions, and of those that
        went in short and lack what others know by now. Of a version there is one message: where that is held, it
        stays."""
        spent = (line.sent.bytes for to, line in self.lines.items() if to != EVERYONE)
        most = allowance(self.habits.budget, self.habits.rate, spent)
        there = stock(self.own, self.held, self.bodies, self.mine)
        return orders(self.number, self.own, there, self.known, most)

    @property
    def orders(self) -> tuple[Order, ...]:
        """Those that are to be made now: for what others know by now once nothing new was heard of for a while, each
        time twice as long, so that what is still changing is not sent again and again."""
        quiet_s, patience_s = self.announced_s - self.heard_s, self.habits.patience_s
        again = ((order, order.version % VERSIONS) for order in self.unmade)
        return tuple(order for order, n in again if not n or order.held or quiet_s >= patience_s * 2 ** min(n, RESTS))

    def knowing(self, keys: IntArray) -> "Peer":
        """With landmarks and poses of others that it knows, as announcements."""
        return self.with_bodies(announcements(self.known.with_more(self.number, keys)))

    def with_messages(self, messages: Iterable[bytes]) -> "Peer":
        """With messages of its own submaps as they were ordered; one that came too late, or that none could be made of,
        changes nothing."""
        made = [data for data in messages if data and self._news(opened(data).entry)]
        return replace(self.with_bodies(made), mine=self.mine | set(map(digest_of, made)))

    @cached_property
    def left_out(self) -> dict[str, str]:
        """The submaps that are held, or that it made, and that are in no map, each with the reason."""
        return left_out({id_: VERSIONS * s.version + VERSIONS - 1 for id_, s in self.own.items()}, self.held)

    def with_bodies(self, bodies: Iterable[bytes]) -> "Peer":
        """With submaps of its own as messages, or removals, which it signs. Raises InputError where one is not sound,
        or under a seal is of another robot."""
        peer = self
        for data in bodies:
            peer = peer._with_body(Body(data) if self.seal is None else self.seal.signed(data))
        return peer

    def recalling(self, bodies: Iterable[Body]) -> "Peer":
        """With what it held once, its own and that of others; what is not sound, or not signed by a member, is refused
        and counted."""
        peer = self
        for body in bodies:
            try:
                peer = peer._with_body(body)
            except TeamslamError as error:
                peer = peer._refusing(EVERYONE, str(error))
        return peer

    def with_set(self, known: SubmapSet) -> "Peer":
        """With what is known from elsewhere: of a robot that begins anew, and removals. Raises InputError as
        `with_bodies` does."""
        out = [Removal(self._owner(id_), id_, held.version) for id_, held in known.held.items() if held.removed]
        out += [Removal(robot, "", version) for robot, version in known.removed_robots.items()]
        peer = self.with_bodies(data for held in known.held.values() for data in sorted(held.contents))
        return peer.with_bodies(map(to_bytes, out))

    def _owner(self, id_: str) -> int:
        """The robot whose submaps have such an id; 0 where that is not known."""
        names = {} if self.seal is None else {self.seal.names.robot(r): r for r in self.seal.known if r}
        return names.get(id_.rpartition("/")[0], 0)

    def _with_body(self, body: Body) -> "Peer":
        """With one body more. Raises InputError where it is no sound message, or under a seal not signed by its
        robot."""
        if (digest := digest_of(body.data)) in self.bodies:
            return self
        if self.seal is not None:
            self.seal.verify(body)
        found = opened(body.data)
        if self.seal is not None:
            self.seal.refuse_borrowed(body, found)
        held = self.held.merge(found.news)
        known = self.known.merge(found.told) if found.told.pages else self.known
        bodies = {**self.bodies, digest: Content(body, found)}
        kept = {d: c for d, c in bodies.items() if c.entry.id != found.entry.id or c.opened.stands(held, known)}
        return replace(self, held=held, known=known, bodies=MappingProxyType(kept))

    # --- a step ---------------------------------------------------------------------------------------------------

    def step(self, now_s: float, inbox: Sequence[tuple[int, bytes]]) -> tuple["Peer", list[Outgoing]]:
        """The peer after some packets (from whom, bytes) at a time, and what it says."""
        peer, out = replace(self, asides=()), list[tuple[int, Packet]]()
        for sender, data in inbox:
            try:
                if peer.revoked(sender):
                    raise InputError("a packet of a robot that is out for ever")
                if len(data) > self.habits.largest:
                    raise InputError(f"a packet of more than {self.habits.largest} bytes")
                peer, said = peer._heard(now_s, sender, from_bytes(data))
                peer = peer._on(sender, replace(peer.lines[sender], heard_s=now_s))
                out += said
            except TeamslamError as error:
                peer = peer._refusing(sender, str(error))
        if peer.known is not self.known:
            peer = replace(peer, heard_s=now_s)
        for turn in (_asking, _sending, _telling):
            peer, said = turn(peer, now_s)
            out += said
        return peer._spending(out)

    def saying(self, said: Sequence[tuple[int, Packet]]) -> tuple["Peer", list[Outgoing]]:
        """What is said beside the exchange, to whom, and the peer with it written down."""
        return self._spending(said)

    def _heard(self, now_s: float, sender: int, packet: Packet) -> tuple["Peer", list[tuple[int, Packet]]]:
        line = self.lines.get(sender, Line())
        match packet:
            case Question() | Answer():
                return replace(self, asides=(*self.asides, (sender, packet)))._on(sender, line), []
            case Have(root):
                line = replace(line, root=root)
                if root in (self.root, line.listed) or now_s - line.asked_s < self.habits.patience_s:
                    return self._on(sender, line), []
                return self._on(sender, replace(line, asked_s=now_s)), [(sender, Ask(self.shelves))]
            case Ask(shelves):
                return self._on(sender, line), [(sender, self.beside(shelves))]
            case List(entries, root):
                lacked = tuple(e for e in entries if e.digest not in self.bodies and self._news(e))
                return self._on(sender, replace(line, lists=lacked, listed=root, asked_s=-1e300)), []
            case Want(digests):
                more = tuple(d for d in digests if d in self.bodies and d not in line.waiting)
                return self._on(sender, replace(line, waiting=line.waiting + more)), []
            case Body(data):
                wanted = MappingProxyType({d: t for d, t in self.wanted.items() if d != digest_of(data)})
                return replace(self._with_body(packet), wanted=wanted)._on(sender, line), []
        raise AssertionError(packet)

    def _refusing(self, sender: int, reason: str) -> "Peer":
        line = self.lines.get(sender, Line())
        reason = reason if reason in self.refused or len(self.refused) < REASONS else OTHERWISE
        refused = MappingProxyType({**self.refused, reason: self.refused.get(reason, 0) + 1})
        return replace(self, refused=refused)._on(sender, replace(line, refused=line.refused + 1))

    def _on(self, sender: int, line: Line) -> "Peer":
        if self.lines.get(sender) is line:
            return self
        return replace(self, lines=MappingProxyType({**self.lines, sender: line}))

    def _spending(self, out: Sequence[tuple[int, Packet]]) -> tuple["Peer", list[Outgoing]]:
        """What is said, as far as each line's budget goes, and the peer with it written down."""
        peer, packets = self, list[Outgoing]()
        for to, packet in out:
            data, line = to_bytes(packet), peer.lines.get(to, Line())
            s, size = line.sent, len(data)
            if self.habits.budget is not None and to != EVERYONE and s.bytes + size > self.habits.budget:
                s = replace(s, withheld=s.withheld + 1)
            else:
                packets.append(Outgoing(to, data))
                s = s.with_body(opened(packet.data).kind, size) if isinstance(packet, Body) else s.with_word(size)
            peer = peer._on(to, replace(line, sent=s))
        return peer, packets


Said = tuple[Peer, list[tuple[int, Packet]]]


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
            peer = peer._on(to, replace(line, free_s=free_s, waiting=tuple(waiting)))
    return peer, out


def _telling(peer: Peer, now_s: float) -> Said:
    """Tell what is held, if it is time."""
    if now_s - peer.announced_s < peer.habits.announce_s:
        return peer, []
    return replace(peer, announced_s=now_s), [(EVERYONE, Have(peer.root))]
