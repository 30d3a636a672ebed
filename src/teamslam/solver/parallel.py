"""Work on several parts at a time: the kernel lets go of Python while it computes."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from teamslam import kernel

T = TypeVar("T")
R = TypeVar("R")


def side_by_side(work: Callable[[T], R], parts: Sequence[T]) -> list[R]:
    """What `work` makes of each part, in their order, on as many threads as the kernel may use."""
    threads = min(kernel.threads(), len(parts))
    if threads < 2:
        return [work(part) for part in parts]
    with ThreadPoolExecutor(threads) as team:
        return list(team.map(work, parts))
