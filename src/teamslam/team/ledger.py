"""Every byte that was sent, or would be: by link, by message, by kind."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from teamslam.wire.messages import Message

K = TypeVar("K")


@dataclass(frozen=True)
class Line:
    """One message on one link: from a robot to a robot."""

    sender: int
    receiver: int
    kind: str
    id: str
    version: int
    bytes: int


@dataclass(frozen=True)
class Ledger:
    """Lines in the order in which they were written down."""

    lines: tuple[Line, ...] = ()

    def add(self, sender: int, receiver: int, message: Message) -> "Ledger":
        """With one message more."""
        line = Line(sender, receiver, message.kind, message.id, message.version, len(message))
        return Ledger((*self.lines, line))

    def merge(self, others: Iterable["Ledger"]) -> "Ledger":
        """This ledger and others, one after another."""
        return Ledger(sum((other.lines for other in others), start=self.lines))

    @property
    def total(self) -> int:
        """All bytes."""
        return sum(line.bytes for line in self.lines)

    def by_link(self) -> dict[tuple[int, int], int]:
        """Bytes from each sender to each receiver."""
        return self._sums(lambda line: (line.sender, line.receiver))

    def by_kind(self) -> dict[str, int]:
        """Bytes of each kind of message."""
        return self._sums(lambda line: line.kind)

    def by_sender(self) -> dict[int, int]:
        """Bytes that each robot sent."""
        return self._sums(lambda line: line.sender)

    def _sums(self, of: Callable[[Line], K]) -> dict[K, int]:
        sums: dict[K, int] = {}
        for line in self.lines:
            sums[of(line)] = sums.get(of(line), 0) + line.bytes
        return sums
