"""Work on many things side by side, of which nothing goes on behind the back of an interruption.

A pool of threads waits at its end for the threads that it knows. A Ctrl-C that comes while one is being started leaves
it out of that account: it works on, and fills a folder that is being taken away.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import TypeVar

T = TypeVar("T")


def side_by_side(work: Callable[[T], object], things: Sequence[T]) -> None:
    """Do the work on each thing. When this returns or raises, nobody is at work and nobody begins any more.

    Raises what the work on the first thing that failed raised.
    """
    turns = [Lock() for _ in things]

    def one(turn: Lock, thing: T) -> None:
        if turn.acquire(blocking=False):
            try:
                work(thing)
            finally:
                turn.release()

    try:
        with ThreadPoolExecutor() as pool:
            list(pool.map(one, turns, things))
    finally:
        for turn in turns:  # of who is at work, after it; of who has not begun, for ever
            turn.acquire()
