"""Links between robots: packets out, packets in. A robot knows this face and nothing of what is behind it."""

from typing import Protocol

HEARD = 64  # packets at once


class Link(Protocol):
    """One robot's end of what connects it with others. Packets may be lost, late, out of order or repeated, and never
    wait for anybody."""

    def send(self, to: int, data: bytes) -> None:
        """A packet to a robot, or to all that can be reached (0)."""

    def receive(self, most: int = HEARD) -> list[tuple[int, bytes]]:
        """Packets that have come, at most so many, those of all senders in turns: from whom, and the bytes."""

    @property
    def alive(self) -> frozenset[int]:
        """The robots that are there and in reach now, as far as the link can tell: a word for people, on which nothing
        that is exchanged depends."""
