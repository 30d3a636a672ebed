"""What waits to be heard: bounded for each sender, and taken in turns; who shouts costs nobody else anything.

put     from any thread; of a sender who has too much waiting the packet is dropped, and counted
take    at most so many packets, one of each sender after another, each sender's in the order in which they came
"""

import threading
from collections import Counter, deque

SENDERS = 4096  # as many as there can be robots; more are not heard
PACKETS, BYTES = 256, 8 << 20  # of one sender that wait at most; one packet may be larger, if it is alone


class Inbox:
    """The packets that have come and were not taken yet. `dropped`: how many were not let in, by sender."""

    def __init__(self) -> None:
        self.dropped: Counter[int] = Counter()
        self._waiting: dict[int, deque[bytes]] = {}
        self._bytes: Counter[int] = Counter()
        self._lock = threading.Lock()

    def put(self, sender: int, data: bytes) -> None:
        """A packet that has come."""
        with self._lock:
            waiting = self._waiting.get(sender)
            if waiting is None and len(self._waiting) < SENDERS:
                waiting = self._waiting[sender] = deque()
            if waiting is None or (waiting and (len(waiting) >= PACKETS or self._bytes[sender] + len(data) > BYTES)):
                self.dropped[sender] += 1
                return
            waiting.append(data)
            self._bytes[sender] += len(data)

    def take(self, most: int) -> list[tuple[int, bytes]]:
        """At most so many packets, with their senders."""
        found: list[tuple[int, bytes]] = []
        with self._lock:
            while self._waiting and len(found) < most:
                sender = next(iter(self._waiting))
                waiting = self._waiting.pop(sender)
                data = waiting.popleft()
                self._bytes[sender] -= len(data)
                found.append((sender, data))
                if waiting:  # to the end of the row
                    self._waiting[sender] = waiting
                else:
                    del self._bytes[sender]
        return found
