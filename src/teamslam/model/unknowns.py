"""What a log rests on and nobody measured: clocks, cameras in bodies, edges of tags. Such numbers are stated, with how
well that is known, and the rows that a reader makes depend on them; so the log brings along how it would read, were
they others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from teamslam.geometry import Array, IntArray, Pose

if TYPE_CHECKING:
    from teamslam.model.dataset import Dataset
    from teamslam.model.tables import Table
    from teamslam.model.values import Values

Stamps = Callable[[IntArray], IntArray]
"""The stamps that another clock has at those of a robot's (n,) [ticks]."""
Standing = Mapping[tuple[int, str], tuple[IntArray, Pose]]
"""By robot and source, how what was seen in rows by their ids (m,), rising, stands to the sensor that saw it (m,)."""


@dataclass(frozen=True)
class Unknown:
    """A number that a log rests on: of what it is (a robot, a camera of it), its `name` and `unit`, the value `stated`
    with its standard deviation `prior`, and a `step` small enough for rows to change in proportion; `most`: how far at
    once it may be moved before the rows are made again. `useful`: of a number that nobody called uncertain, which
    is moved only where rows contradict it, how well they must tell it to be said to confirm it, a standard deviation;
    0: it is always moved, as its prior allows.
    `clock_of`: the robot by how much whose stamps are late it is; 0: it is no clock's offset. `drift_of`: the robot
    whose clock's drift it is, which is moved wherever the offset of that clock is; 0: it is none.
    `quiet`: people are told of it where it is moved alone. `course`: of what it is the value at the moment `at_s` [s],
    where that goes evenly from one such value to the next; '': it is what it is throughout."""

    of: str
    name: str
    unit: str
    stated: float
    prior: float
    step: float
    most: float
    useful: float = 0.0
    clock_of: int = 0
    drift_of: int = 0
    quiet: bool = False
    course: str = ""
    at_s: float = 0.0


class Unknowns(Protocol):
    """The unknowns of a log, at the `values` (k,) by which its rows were made."""

    @property
    def each(self) -> tuple[Unknown, ...]:
        """What is unknown (k)."""
        ...

    @property
    def values(self) -> Array:
        """What the log was made by (k,)."""
        ...

    @property
    def tables(self) -> "tuple[Table, ...]":
        """The tables of the log that was made: who changed them since cannot have them made again."""
        ...

    def again(self, values: Array) -> "Dataset":
        """The log, were they `values` (k,): its poses, too, may be others."""
        ...

    @property
    def truths(self) -> "dict[int, tuple[IntArray, Array]]":
        """By robot, where it truly was: rising ticks (n,), and positions (n, 3), of those whose stamps may be late."""
        ...

    def truth_with(self, stamps: Mapping[int, Stamps]) -> "Values | None":
        """The truth of the log, were that of some robots stamped so."""
        ...

    def varied(self, values: Array, standing: Standing | None = None) -> "tuple[Table, ...]":
        """The sightings that would be others, were they `values` (k,), at the poses of the log as it is: rows that keep
        their ids. Only how they change counts, and that is asked of a map where `standing` says how that has what was
        seen; else of what each sighting tells by itself, whose noise is in the sighting as well."""
        ...
