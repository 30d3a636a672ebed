"""How long an answer is waited for before it is asked for again.

A line may lose packets, or be slow; what is slow comes no sooner if it is sent again, and what is sent twice makes the
line slower. Which of the two it is, answers tell: one that comes twice was asked for again for nothing, and the next of
its kind is waited for longer; one that came to a question that was asked once says how long it takes. And where an
attempt fails, as where what was asked for in vain fills the line, the next one asks more slowly.
"""

from collections import Counter

SLOWER = 2.0  # than the last of its kind an answer may be
DOUBLINGS = 2  # of the time, at most


def slower_s(least_s: float, failed: int) -> float:
    """How long an answer is waited for at least, after so many attempts that failed."""
    return least_s * 2.0 ** min(failed, DOUBLINGS)


def longest_s(least_s: float) -> float:
    """The longest that is waited where it is at least so long, after attempts that failed."""
    return slower_s(slower_s(least_s, DOUBLINGS), DOUBLINGS)


class Pace:
    """What was seen of answers so far, by the kind of question."""

    def __init__(self) -> None:
        self._took_s: dict[str, float] = {}
        self._needless: Counter[str] = Counter()

    def answered(self, kind: str, took_s: float, times: int) -> None:
        """A question was answered that had been asked so many times."""
        if times == 1:
            self._took_s[kind] = took_s
        self._needless[kind] = max(0, self._needless[kind] - 1) if times > 1 else 0

    def twice(self, kind: str) -> None:
        """An answer came that was there already, to a question that was asked again."""
        self._needless[kind] += 1

    def wait_s(self, kind: str, least_s: float) -> float:
        """How long the next answer is waited for, at least so long."""
        return min(
            max(slower_s(least_s, self._needless[kind]), SLOWER * self._took_s.get(kind, 0.0)),
            slower_s(least_s, DOUBLINGS),
        )
