"""Links between robots: packets out, packets in. A robot knows this face and nothing of what is behind it."""

from typing import Protocol


class Link(Protocol):
    """One robot's end of what connects it with others. Packets may be lost, late, out of order or repeated, and never
    wait for anybody."""

    def send(self, to: int, data: bytes) -> None:
        """A packet to a robot, or to all that can be reached (0)."""

    def receive(self) -> list[tuple[int, bytes]]:
        """The packets that have come since the last call: from whom, and the bytes."""
