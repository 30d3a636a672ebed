"""In what form a robot's own submap goes to others: whole while the links carry that, else shorter; the most
informative form that is short enough.

    to the bit     sparse
    rounded        sparse, within a certified bound (`wire.rounding`)
    partly         without interiors whose elimination makes it shorter, rounded
    landmarks      condensed to all landmarks and what others need, rounded
    needed         condensed to what others need, rounded

What others need: what stands in another submap of its own, the last pose of its way, other robots' poses, what raw rows
name, and all that others say they know (`team.Knowledge`). What they come to know later and a form lacks brings a new
version with it kept.

The robot that made a submap chooses, one form for all: what it signs nobody else can shorten, and one set of messages
is what makes one map. A message may have a share of what is left of the tightest line's budget, and what its rate
carries in some seconds; where no form is short enough the shortest goes.
"""

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import IntArray
from teamslam.joining import separators
from teamslam.model import Submap, is_landmark, is_pose, robot_of
from teamslam.robot.line import Content
from teamslam.robot.namesakes import tells
from teamslam.robot.opened import Opened
from teamslam.team import Knowledge, SubmapSet
from teamslam.wire import send
from teamslam.wire.rounding import COMPACT, EXACT, Precision

SHARE, SECONDS = 0.1, 10.0  # of a line's budget that one message may have, and of its rate
VERSIONS = 1000  # of messages of one version of a submap at most
MENDED = 10  # times that one more is made because two tell the same


@dataclass(frozen=True)
class Form:
    """A kind of message, how far it is rounded, and whether all landmarks stay."""

    kind: str
    precision: Precision
    landmarks: bool = True


FORMS = (
    Form("sparse", EXACT),
    Form("sparse", COMPACT),
    Form("partial", COMPACT),
    Form("condensed", COMPACT),
    Form("condensed", COMPACT, landmarks=False),
)


@dataclass(frozen=True, eq=False)
class Order:
    """A message to be made of a submap: its `version`, what others `needed` of it when it was ordered, how many bytes
    it may have at `most`, and the messages that are `held` of this version, which the robot may have made once."""

    submap: Submap
    version: int
    needed: IntArray
    most: float
    held: tuple[bytes, ...] = ()

    def made(self) -> bytes:
        """One that is held and says the same; else the message in the first form that is short enough, else in the
        shortest."""
        for data in self.held:
            if tells(data, self.submap):
                return data
        submap, shortest = replace(self.submap, version=self.version), b""
        for form in FORMS:
            try:
                data = send(form.kind, submap, self._kept(form), form.precision).data
            except TeamslamError:  # an interior that only just holds, or numbers that cannot be rounded
                continue
            if len(data) <= self.most:
                return data
            shortest = data if not shortest or len(data) < len(shortest) else shortest
        return shortest

    def _kept(self, form: Form) -> IntArray:
        keys = self.submap.values.layout.keys
        return np.union1d(self.needed, keys[is_landmark(keys)]) if form.landmarks else self.needed


def made(orders: Sequence[Order]) -> list[bytes]:
    """The messages that were ordered."""
    return [order.made() for order in orders]


def allowance(budget: float | None, rate: float | None, spent: Iterable[int]) -> float:
    """How many bytes a message may have, where each line has a `budget` of which so much is `spent`, and a `rate`."""
    left = float("inf") if budget is None else max(0.0, budget - max(spent, default=0))
    return min(SHARE * left, SECONDS * (float("inf") if rate is None else rate))


def needed(own: Sequence[Submap], known: IntArray) -> dict[str, IntArray]:
    """Of each of a robot's own submaps, the variables (rising) that others need, who know the keys `known`."""
    shared = separators(own)
    found = {}
    for submap in own:
        keys = submap.values.layout.keys
        last = submap.trajectory_keys(int(robot_of(submap.base)))[-1]
        others = keys[is_pose(keys) & (robot_of(keys) != robot_of(submap.base))]
        wanted = np.concatenate([shared[submap.id], keys[keys == last], others, keys[np.isin(keys, known)]])
        found[submap.id] = np.unique(wanted)
    return found


@dataclass(frozen=True)
class Stock:
    """Of a robot's own submaps that others hold too, by id: the version that was `sent`, with what is held of it (None:
    it was removed, or several are held); the messages of which it is `unsure` whether they are its own; and those that
    are held `twice`, in two forms that tell the same."""

    sent: Mapping[str, tuple[int, Opened | None]]
    unsure: Mapping[str, tuple[bytes, ...]]
    twice: Set[str]


def stock(own: Mapping[str, Submap], held: SubmapSet, bodies: Mapping[bytes, Content], mine: Set[bytes]) -> Stock:
    """What is held of a robot's own submaps; it is unsure of a version where none of its messages is among `mine`."""
    there = [(digest, c) for digest, c in bodies.items() if c.entry.id in own and not c.entry.gone]
    found = {c.entry.id: c.opened for _, c in there if len(held.held[c.entry.id].contents) == 1}
    sent = {id_: (held.held[id_].version, found.get(id_)) for id_ in own if id_ in held.held}
    unsure: dict[str, tuple[bytes, ...]] = {}
    for id_ in {c.entry.id for _, c in there} - {c.entry.id for digest, c in there if digest in mine}:
        if sent[id_][0] // VERSIONS == own[id_].version:
            unsure[id_] = tuple(sorted(c.data for _, c in there if c.entry.id == id_))
    several = [(id_, held.held[id_]) for id_ in sent if id_ not in unsure and len(held.held[id_].contents) > 1]
    twice = {
        id_
        for id_, known in several
        if known.version // VERSIONS == own[id_].version
        and known.version % VERSIONS < MENDED
        and all(tells(data, own[id_]) for data in known.contents)
    }
    return Stock(sent, unsure, twice)


def orders(robot: int, own: Mapping[str, Submap], stock: Stock, known: Knowledge, most: float) -> tuple[Order, ...]:
    """The messages that are to be made of a robot's own submaps, of which so much is held, where others say what they
    know."""
    sent, unsure = stock.sent, stock.unsure
    new = {id_: VERSIONS * s.version for id_, s in own.items() if sent.get(id_, (-1, None))[0] < VERSIONS * s.version}
    new |= {id_: sent[id_][0] for id_ in unsure} | {id_: sent[id_][0] + 1 for id_ in stock.twice}
    kept = {id_: found.keys for id_, (_, found) in sent.items() if found is not None and found.kind != "sparse"}
    short = {id_: keys for id_, keys in kept.items() if id_ in own and id_ not in new}
    if not new and not short:
        return ()
    wanted = needed(list(own.values()), known.beside(robot))
    for id_, keys in short.items():
        version = sent[id_][0] + 1
        if version % VERSIONS and len(np.setdiff1d(wanted[id_], keys)):
            new[id_] = version
    return tuple(Order(own[id_], n, wanted[id_], most, unsure.get(id_, ())) for id_, n in new.items())
