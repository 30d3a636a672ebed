"""What a robot knows of its team: a set of submaps that grows by messages and never minds their order.

    merge     commutative, associative, idempotent: a join-semilattice. Of one id the newest version wins, and at one
              version a removal wins over a submap
    join      a pure function of the set, to the bit: whatever was lost and sent again, repeated or late

So two robots that have heard the same things, in whatever order, hold the same map, byte for byte. Two different
submaps under one id and version cannot be told apart by anyone: both are kept, and the id is left out of the join with
the reason; so a robot sends one message of a version, to whomever it sends it, and relays pass on the bytes that they
heard. A submap that was removed leaves no trace in the map: it is as if it had never been there.
Source: Shapiro et al., "Conflict-free replicated data types" (2011).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

from teamslam.errors import ModelError
from teamslam.joining import Joined, join
from teamslam.model import Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.team.admission import Admission, Refusal, torn_reason, without_conflicts
from teamslam.wire.messages import Message, receive, send


@dataclass(frozen=True)
class Held:
    """What is known of one id: its newest version, whether that was a removal, and the message that brought it (more
    than one where the team contradicts itself)."""

    version: int
    removed: bool
    contents: frozenset[bytes] = frozenset()

    def merge(self, other: "Held") -> "Held":
        """The newer; at one version a removal, else both contents."""
        mine, theirs = (self.version, self.removed), (other.version, other.removed)
        if mine != theirs:
            return self if mine > theirs else other
        return Held(self.version, self.removed, self.contents | other.contents)


@dataclass(frozen=True, eq=False)
class SubmapSet:
    """An immutable set of submaps by id and version. `removed_robots`: up to which version a robot's submaps are out.

    Two sets are equal where they know the same, to the bit.
    """

    held: Mapping[str, Held] = field(default_factory=lambda: MappingProxyType({}))
    removed_robots: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SubmapSet) and self._known == other._known

    def __hash__(self) -> int:
        return hash(self._known)

    @cached_property
    def _known(self) -> tuple[frozenset[tuple[str, Held]], frozenset[tuple[int, int]]]:
        return frozenset(self.held.items()), frozenset(self.removed_robots.items())

    @classmethod
    def of(cls, *items: Submap | Message | bytes) -> "SubmapSet":
        """The set of some submaps or messages."""
        out = cls()
        for item in items:
            out = out.add(item)
        return out

    def add(self, item: Submap | Message | bytes) -> "SubmapSet":
        """With one more submap, made here or come by message; older than what is known of its id, it changes nothing.

        Raises InputError for bytes that are no sound message.
        """
        message = send("sparse", item, item.values.layout.keys) if isinstance(item, Submap) else item
        data = message.data if isinstance(message, Message) else message
        heard = receive(data)
        return self.merge(SubmapSet({heard.id: Held(heard.version, False, frozenset({data}))}))

    def remove(self, id: str, version: int | None = None) -> "SubmapSet":
        """Without a submap, up to this version (by default the one held). A later version brings it back."""
        if version is None:
            if id not in self.held:
                raise ModelError(f"there is no submap {id} in this set; name the version up to which it is removed")
            version = self.held[id].version
        return self.merge(SubmapSet({id: Held(version, True)}))

    def remove_robot(self, robot: int, version: int | None = None) -> "SubmapSet":
        """Without all submaps that hold a robot's measurements, up to this version (by default the newest held);
        those that are still on their way are out too."""
        if version is None:
            version = max((s.version for s in self._contents.values() if robot in s.robots), default=0)
        return self.merge(SubmapSet(removed_robots={robot: version}))

    def merge(self, other: "SubmapSet") -> "SubmapSet":
        """What both know together."""
        held = dict(self.held)
        for id_, theirs in other.held.items():
            held[id_] = held[id_].merge(theirs) if id_ in held else theirs
        robots = dict(self.removed_robots)
        for robot, version in other.removed_robots.items():
            robots[robot] = max(version, robots.get(robot, version))
        return SubmapSet(MappingProxyType(held), MappingProxyType(robots))

    @cached_property
    def admission(self) -> Admission:
        """The submaps that can be joined, and those that are refused with the reason."""
        present = [
            submap
            for submap in self._contents.values()
            if all(submap.version > self.removed_robots.get(robot, -1) for robot in submap.robots)
        ]
        found = without_conflicts(present)
        torn = [
            Refusal(id_, torn_reason(id_, entry.version, len(entry.contents)))
            for id_, entry in sorted(self.held.items())
            if len(entry.contents) > 1
        ]
        return Admission(found.good, (*torn, *found.refused))

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """The submaps that can be joined, by base and id."""
        return self.admission.good

    def join(self, options: Options = DEFAULTS) -> Joined:
        """The map of the set. Law: equal sets give equal bits. Raises as `teamslam.join` does, also for an empty
        set."""
        return join(self.submaps, options=options)

    @cached_property
    def _contents(self) -> dict[str, Submap]:
        """The submaps that are there and of which there is one content: opened from the bytes, so that it does not
        matter whether a submap was made here or came by message."""
        return {
            id_: receive(next(iter(entry.contents))).submap()
            for id_, entry in sorted(self.held.items())
            if not entry.removed and len(entry.contents) == 1
        }
