"""Who makes the messages of a robot's own submaps: beside the steps where there is an executor, else at once.

A form costs up to some tenths of a second (`forms`), so no step waits for it. What is ordered is a function of what the
robot holds; it is asked for again when that has changed, and while something is being made nothing else is ordered.
"""

from concurrent.futures import BrokenExecutor, Executor, Future

from teamslam.robot.forms import made
from teamslam.robot.peer import Peer


class Scribe:
    """Makes messages, one round at a time; none while it `waits`, as for a disk."""

    def __init__(self, executor: Executor | None = None) -> None:
        self._executor, self.waits = executor, False
        self._round: Future[list[bytes]] | None = None
        self._seen: tuple[object, ...] = ()
        self._asked: tuple[object, ...] = ()
        self._unmade = False

    def busy(self, peer: Peer) -> bool:
        """Whether something is being made, or yet to be."""
        if not _same(self._asked, asked := (peer.own, peer.known, peer.held, peer.mine)):
            self._asked, self._unmade = asked, bool(peer.unmade)
        return self._round is not None or self._unmade

    def attend(self, peer: Peer) -> Peer:
        """The peer with what was made since, and what it wants now ordered."""
        if self.waits:
            return peer
        if self._round is not None:
            if not self._round.done():
                return peer
            try:
                peer = peer.with_messages(self._round.result())
            except BrokenExecutor:  # made at once from now on
                self._executor, self._seen = None, ()
            self._round = None
        while not _same(self._seen, seen := (peer.own, peer.known, peer.held, peer.mine, peer.announced_s)):
            self._seen = seen
            if not (orders := peer.orders):
                break
            if self._executor is not None:
                self._round = self._executor.submit(made, orders)
                break
            peer = peer.with_messages(made(orders))
        return peer


def _same(one: tuple[object, ...], other: tuple[object, ...]) -> bool:
    """Whether nothing that messages depend on has changed: no record is another."""
    return len(one) == len(other) and all(a is b for a, b in zip(one, other, strict=True))
