"""A robot among others: what it holds of the team, what it lacks, and what its lines to others have carried.

What is held is a set that grows (`SubmapSet`), in whatever order it is heard. A body is kept as the bytes that were
heard, to be passed on as these, and under a seal only what its own robot has signed is taken. How it is told and asked
for: `exchange`.
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
    Body,
    Entry,
    List,
    Question,
    Removal,
    digest_of,
    root_of,
    shelf_of,
    shelves_of,
    to_bytes,
)
from teamslam.robot.seal import Seal
from teamslam.team import Knowledge, SubmapSet

EVERYONE = 0  # in place of a robot's number: all that can be reached
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
        lacked = [entry for entry in known.values() if entry.digest not in self.bodies and self.is_news(entry)]
        return tuple(sorted(lacked, key=lambda entry: (not entry.knows, -entry.rows, entry.digest)))

    def is_news(self, entry: Entry) -> bool:
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
        made = [data for data in messages if data and self.is_news(opened(data).entry)]
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
            peer = peer.with_heard(Body(data) if self.seal is None else self.seal.signed(data))
        return peer

    def recalling(self, bodies: Iterable[Body]) -> "Peer":
        """With what it held once, its own and that of others; what is not sound, or not signed by a member, is refused
        and counted."""
        peer = self
        for body in bodies:
            try:
                peer = peer.with_heard(body)
            except TeamslamError as error:
                peer = peer.refusing(EVERYONE, str(error))
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

    def with_heard(self, body: Body) -> "Peer":
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

    def refusing(self, sender: int, reason: str) -> "Peer":
        """With a packet that made no sense counted."""
        line = self.lines.get(sender, Line())
        reason = reason if reason in self.refused or len(self.refused) < REASONS else OTHERWISE
        refused = MappingProxyType({**self.refused, reason: self.refused.get(reason, 0) + 1})
        return replace(self, refused=refused).on(sender, replace(line, refused=line.refused + 1))

    def on(self, other: int, line: Line) -> "Peer":
        """With a line to another robot as it is now."""
        if self.lines.get(other) is line:
            return self
        return replace(self, lines=MappingProxyType({**self.lines, other: line}))
