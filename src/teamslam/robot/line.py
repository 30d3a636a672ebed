"""What a robot knows of its line to another: what it asked, what it heard there is, what waits, what it sent."""

from dataclasses import dataclass

from teamslam.robot.opened import Opened
from teamslam.robot.packets import Body, Entry


@dataclass(frozen=True)
class Sent:
    """What went to one robot: packets and bytes of bodies, and of all else; and how many packets did not go, because
    they would have been more than the budget."""

    bodies: int = 0
    body_bytes: int = 0
    words: int = 0
    word_bytes: int = 0
    withheld: int = 0

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
    may go, and how many of its packets were `refused`."""

    asked_s: float = -1e300
    listed: bytes | None = None
    lists: tuple[Entry, ...] = ()
    waiting: tuple[bytes, ...] = ()
    free_s: float = 0.0
    sent: Sent = Sent()
    refused: int = 0
