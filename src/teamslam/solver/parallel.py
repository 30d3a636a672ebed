"""Work on several parts at a time: the kernel lets go of Python while it computes."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Lock
from typing import TypeVar

from teamslam import kernel

T = TypeVar("T")
R = TypeVar("R")


def side_by_side(work: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """What `work` makes of each part, in their order, on as many threads as the kernel may use."""
    return list(each_side_by_side(work, parts))


def each_side_by_side(work: Callable[[T], R], parts: Sequence[T]) -> Iterator[R]:
    """The same, one after the other as they are done. Where one fails, the caller stops listening, or a Ctrl-C comes,
    no other is begun, and nobody is at work any more when this ends.

    A pool waits at its end for the threads that it knows. A Ctrl-C that comes while one is being started leaves it out
    of that account, and it would work on behind everybody's back; so each part has a turn of its own to wait for.
    """
    threads = min(kernel.threads(), len(parts))
    if threads < 2:
        yield from map(work, parts)
        return
    turns = [Lock() for _ in parts]

    def done(turn: Lock, part: T) -> R | None:
        if not turn.acquire(blocking=False):
            return None  # nobody listens any more
        try:
            return work(part)
        finally:
            turn.release()

    team = ThreadPoolExecutor(threads)
    try:
        yield from team.map(done, turns, parts)  # type: ignore[misc]
    finally:
        team.shutdown(cancel_futures=True)
        for turn in turns:  # of who is at work, after it; of who has not begun, for ever
            turn.acquire()


@contextmanager
def meanwhile(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Does something ahead of time that others ask for afterwards, while the block goes on; done when the block ends.
    It gives a function that returns what came of it, and raises what went wrong with it.

    It is left to those who ask where the kernel may use one thread only.
    """
    if kernel.threads() < 2:
        yield work
        return
    with ThreadPoolExecutor(1) as other:
        yield other.submit(work).result
