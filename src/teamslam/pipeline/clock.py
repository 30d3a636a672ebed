"""How long each stage of a run took, and how far it is."""

import time
from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Hears the stage, how much of it is done, and of how much (0: nobody knows)."""


class Clock:
    """Times the stages of a run and tells `progress` about them."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress or (lambda stage, done, of: None)
        self._seconds: dict[str, float] = {}
        self._stage, self._of, self._began = "", 0, time.perf_counter()
        self._done = 0

    def start(self, stage: str, of: int = 0) -> None:
        """End the stage before and start the next, of `of` parts (0: nobody knows)."""
        self.stop()
        self._stage, self._of, self._began = stage, of, time.perf_counter()
        self._done = 0
        self._progress(stage, 0, of)

    def tick(self) -> None:
        """One part of the stage more is done."""
        self._done += 1
        self._progress(self._stage, self._done, self._of)

    def hear(self, stage: str, done: int, of: int) -> None:
        """A stage that tells its own progress."""
        if stage != self._stage:
            self.start(stage, of)
        self._progress(stage, done, of)

    def each(self, parts: Iterable[T]) -> tuple[T, ...]:
        """All parts of a stage, told one by one."""
        done = []
        for part in parts:
            done.append(part)
            self.tick()
        return tuple(done)

    def stop(self) -> dict[str, float]:
        """End the last stage; the seconds of all."""
        if self._stage:
            spent = time.perf_counter() - self._began  # a stage may come again
            self._seconds[self._stage] = self._seconds.get(self._stage, 0.0) + spent
            self._progress(self._stage, self._of or 1, self._of or 1)
            self._stage = ""
        return dict(self._seconds)
