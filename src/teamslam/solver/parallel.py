"""Work on several parts at a time: the kernel lets go of Python while it computes."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from teamslam import kernel

T = TypeVar("T")
R = TypeVar("R")


def side_by_side(work: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """What `work` makes of each part, in their order, on as many threads as the kernel may use."""
    return list(each_side_by_side(work, parts))


def each_side_by_side(work: Callable[[T], R], parts: Sequence[T]) -> Iterator[R]:
    """The same, one after the other as they are done. Where one fails, or the caller stops listening, no other is
    begun."""
    threads = min(kernel.threads(), len(parts))
    if threads < 2:
        yield from map(work, parts)
        return
    team = ThreadPoolExecutor(threads)
    try:
        yield from team.map(work, parts)
    finally:
        team.shutdown(cancel_futures=True)


@contextmanager
def meanwhile(work: Callable[[], object]) -> Iterator[None]:
    """Does something ahead of time that others ask for afterwards, while the block goes on; done when the block ends.

    It is left to those who ask where the kernel may use one thread only. What goes wrong with it they find themselves.
    """
    if kernel.threads() < 2:
        yield
        return
    with ThreadPoolExecutor(1) as other:
        other.submit(work)
        yield
