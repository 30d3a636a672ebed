"""What a misfit looks like, in words."""

from collections.abc import Callable
from dataclasses import dataclass, field

from teamslam.model import Dataset

MISTAKES = ("sign", "degrees", "unit", "axes", "direction", "clock", "jump", "landmark", "size", "frame")
"""The kinds of causes that are mistakes in a log; others ('sigma', 'outliers') are noise that was stated wrongly."""


@dataclass(frozen=True)
class Cause:
    """A sentence that a test on the data itself has found true, and the share of the excess cost that it `explains`
    where it was tested. `robots` are those concerned, all whose it may be where nobody knows; `kind` is what it is
    called in scripts. `mend` takes it out of the log that it was found in; None where that is left to those who seek
    names that lie (`labels`)."""

    kind: str
    sentence: str
    explains: float
    robots: tuple[int, ...] = ()
    mend: Callable[[Dataset], Dataset] | None = field(default=None, compare=False, repr=False)

    @property
    def is_mistake(self) -> bool:
        """Whether the log is wrong, and not only its noise."""
        return self.kind in MISTAKES


def rows_called(source: str) -> str:
    """What the rows of a source are."""
    known = {"landmarks": "sightings of landmarks", "robots": "sightings of robots", "odometry": "steps of odometry"}
    return known.get(source, f"rows of {source}")
