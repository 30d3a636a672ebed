"""Which kind of message to send, by its exact size: all kinds are made, the smallest goes, never more than raw.

What is small depends on the team: condensed submaps where few variables are shared, raw measurements where robots see
each other all the time (a dense matrix over many separators is larger than what it was made of). So it is not guessed.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from teamslam.joining import separators
from teamslam.model import Dataset, Submap
from teamslam.team.ledger import Ledger
from teamslam.wire.messages import CONDENSINGS, KINDS, Message, send, send_raw
from teamslam.wire.rounding import COMPACT, Precision

TOPOLOGIES = ("star", "all")


@dataclass(frozen=True, eq=False)
class Offer:
    """One submap's message in every kind; `pick` is the smallest (of equals, the one that says more)."""

    robot: int
    messages: Mapping[str, Message]

    @property
    def pick(self) -> Message:
        """The message to send."""
        return min((self.messages[kind] for kind in KINDS if kind in self.messages), key=len)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a team's exchange costs: an offer for each submap, and who sends to whom."""

    offers: tuple[Offer, ...]
    links: tuple[tuple[int, int], ...]

    def ledger(self, kind: str | None = None) -> Ledger:
        """Every message on every link: the picks, or one kind throughout."""
        ledger = Ledger()
        for sender, receiver, message in self.messages(kind):
            ledger = ledger.add(sender, receiver, message)
        return ledger

    def messages(self, kind: str | None = None) -> Iterator[tuple[int, int, Message]]:
        """Sender, receiver and message: the picks, or one kind throughout."""
        for sender, receiver in self.links:
            for offer in self.offers:
                if offer.robot == sender:
                    yield sender, receiver, offer.messages[kind] if kind else offer.pick


def plan(
    team: Sequence[tuple[Dataset, Submap]],
    precision: Precision = COMPACT,
    *,
    topology: str = "star",
    landmarks: bool = False,
) -> Plan:
    """The exchange of a team: pairs of a piece of log and the submap built from it.

    `topology`: 'star', all send to the lowest robot; 'all', everyone to everyone. `landmarks`: keep every landmark, so
    that all robots get the whole landmark map. Law: no link costs more than raw.
    """
    needed = separators((submap for _, submap in team), landmarks=landmarks)
    offers = []
    for piece, submap in team:
        messages = {"raw": send_raw(piece, submap.id, submap.version, precision)}
        messages |= {kind: send(kind, submap, needed[submap.id], precision) for kind in CONDENSINGS}
        offers.append(Offer(piece.tables[0].robot, messages))
    return Plan(tuple(offers), tuple(links_of((o.robot for o in offers), topology)))


def links_of(robots: Iterable[int], topology: str) -> list[tuple[int, int]]:
    """Who sends to whom."""
    team = sorted(set(robots))
    if topology == "star":
        return [(robot, team[0]) for robot in team[1:]]
    return [(a, b) for a in team for b in team if a != b]
