"""What a robot knows of its line to another: what it asked, what it heard there is, what waits, what it sent."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

from teamslam.robot.opened import Opened
from teamslam.robot.packets import Body, Entry


@dataclass(frozen=True)
class Sent:
    """What went to one robot: packets and bytes of bodies, and of all else (`words`); bytes of bodies by kind; and how
    many packets did not go, because they would have been more than the budget."""

    bodies: int = 0
    body_bytes: int = 0
    words: int = 0
    word_bytes: int = 0
    withheld: int = 0
    kinds: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))

    def with_body(self, kind: str, size: int) -> "Sent":
        """With a body more."""
        kinds = MappingProxyType({**self.kinds, kind: self.kinds.get(kind, 0) + size})
        return replace(self, bodies=self.bodies + 1, body_bytes=self.body_bytes + size, kinds=kinds)

    def with_word(self, size: int) -> "Sent":
        """With a packet more of what is no body."""
        return replace(self, words=self.words + 1, word_bytes=self.word_bytes + size)

    def record(self) -> dict[str, Any]:
        """As a record."""
        return {each.name: getattr(self, each.name) for each in fields(self)} | {"kinds": dict(self.kinds)}

    @property
    def bytes(self) -> int:
        """In all."""
        return self.body_bytes + self.word_bytes


@dataclass(frozen=True, eq=False)
class Content:
    """A body that is held, and what it is."""

    body: Body
    opened: Opened

    @property
    def entry(self) -> Entry:
        """Its entry in the list."""
        return self.opened.entry

    @property
    def data(self) -> bytes:
        """Its bytes."""
        return self.body.data


@dataclass(frozen=True, eq=False)
class Line:
    """What a robot knows of its line to another: when it last asked for the list; what the last list was of
    (`listed`, a root), and what of it was lacked then; the bodies that the other waits for, when the next
    may go, how many of its packets were `refused`, when it was last `heard_s`,
    and what names all that it held then (`root`)."""

    asked_s: float = -1e300
    listed: bytes | None = None
    lists: tuple[Entry, ...] = ()
    waiting: tuple[bytes, ...] = ()
    free_s: float = 0.0
    sent: Sent = field(default_factory=Sent)
    refused: int = 0
    heard_s: float = -1e300
    root: bytes | None = None
