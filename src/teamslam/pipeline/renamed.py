"""What a log rests on, where the names of its landmarks were put right after it was read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from teamslam.geometry import Array, IntArray
from teamslam.model import Dataset, Stamps, Standing, Table, Unknown, Unknowns, Values


@dataclass(frozen=True, eq=False)
class Renamed:
    """The unknowns `of` a log (`teamslam.model.Unknowns`) whose landmarks have other names since: `mend` gives them in
    any reading of it, and gave `log`."""

    of: Unknowns
    mend: Callable[[Dataset], Dataset]
    log: Dataset

    @property
    def each(self) -> tuple[Unknown, ...]:
        """What is unknown."""
        return self.of.each

    @property
    def values(self) -> Array:
        """What the log was made by."""
        return self.of.values

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables of the log, by its new names."""
        return self.log.tables

    @property
    def truths(self) -> dict[int, tuple[IntArray, Array]]:
        """Where robots truly were."""
        return self.of.truths

    def again(self, values: Array) -> Dataset:
        """The log, were they others."""
        read = self.of.again(values)
        mended = self.mend(read)
        return replace(mended, unknowns=None if read.unknowns is None else Renamed(read.unknowns, self.mend, mended))

    def truth_with(self, stamps: Mapping[int, Stamps]) -> Values | None:
        """The truth of the log, were that of some robots stamped so."""
        return self.of.truth_with(stamps)

    def varied(self, values: Array, standing: Standing | None = None) -> tuple[Table, ...]:
        """Those sightings that would be others, were they."""
        return self.mend(self.log.with_tables(self.of.varied(values, standing))).tables
