"""What a page shows: words and tables as they are read, arrays for what is drawn.

Places are in space, those of a plane at height 0; stamps are [s] since the start of the run (or counts of poses).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from teamslam.geometry import Array, BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class Way:
    """One robot's way in one map: `stamps` (n,), `places` (n, 3) [m], `forward` (n, 3) the unit vector it looks along,
    `truth` (n, 3), nan where nobody knows it. `region_stamps` (k,) and `regions` (k, 3, 3) [m^2]: covariances of the
    position at some of them. `robot` is a place in the page's robots; `all` how many poses there are, `n` are drawn."""

    robot: int
    all: int
    stamps: Array
    places: Array
    forward: Array
    truth: Array
    region_stamps: Array
    regions: Array


@dataclass(frozen=True, eq=False)
class Marks:
    """The landmarks of one map: `places` (m, 3), `covariances` (m, 3, 3), `truth` (m, 3) and `second` (m, 3), another
    place that fits nearly as well, each nan where there is none; `doubted` (m,): some name of it may lie."""

    names: Sequence[str]
    places: Array
    covariances: Array
    truth: Array
    second: Array
    doubted: BoolArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Measurements of one sensor of one robot in one part, rising in time: `size` (n,) of the residual in sigmas,
    `target` (n,): the place of a landmark in the part, or -1 - the place of a robot in the page's robots."""

    part: int
    robot: int
    source: str
    stamps: Array
    size: Array
    target: IntArray


@dataclass(frozen=True, eq=False)
class Sightings:
    """Robots that saw each other in one part, rising in time: who (n, 2), when each was where it was (n, 2)."""

    robots: IntArray
    stamps: Array


@dataclass(frozen=True, eq=False)
class Part:
    """One map. `spatial`: it is looked at from the side, and turned. `quantile`: of the chi-square of its regions.
    `magnification`: how many times larger regions are drawn to begin with. `weakest` (n, 2, 3): lines [m] of what its
    weakest direction moves, `weakest_times` as long as one sigma to either side is."""

    title: str
    frame: str
    spatial: bool
    magnification: int
    quantile: float
    ways: Sequence[Way]
    marks: Marks
    sightings: Sightings
    weakest: Array
    weakest_times: int


@dataclass(frozen=True)
class Table:
    """A table in words. `bars`: the column whose numbers are drawn as bars as well. `folded`: shown when asked for."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    bars: int | None = None
    folded: bool = False


@dataclass(frozen=True, eq=False)
class Page:
    """All of a page. `verdict` is the level (fits, loose, strained, misfit, unknown), `sentence` what it says;
    `summary` names and values, a name is empty where it goes on; `thinned` says what is drawn in part, `alerts` why the
    map is not whole, or not to be believed; `rejected` are sightings that look wrong; `pictures` are
    titles with PNG files."""

    title: str
    verdict: str
    sentence: str
    summary: Sequence[tuple[str, str]]
    robots: Sequence[str]
    colours: Sequence[str]
    counts: bool
    parts: Sequence[Part]
    rows: Sequence[Rows]
    tables: Sequence[Table]
    config: str
    thinned: Sequence[str] = field(default=())
    alerts: Sequence[str] = field(default=())
    rejected: Sequence[Rows] = field(default=())
    pictures: Sequence[tuple[str, bytes]] = field(default=())
