"""What one text file of a graph holds, with its ids as the file writes them: vertices, measurements, sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.records import Records
from teamslam.model import Dropped, Kind, Names


@dataclass(frozen=True, eq=False)
class Vertices:
    """Estimates of one kind: ids (n,), rows of the state vector (n, size), and where they stand."""

    kind: Kind
    ids: IntArray
    states: Array
    records: Records


@dataclass(frozen=True, eq=False)
class Measured:
    """Measurements of one tag: ids (m, k) of variables of the kinds `ends`; values (m, size) as MODELS has them and
    whitening (m, r, r) in teamslam's chart; `sensor` (m,) the places of their sensors in the part, -1 for the body."""

    model: str
    dim: int
    ends: tuple[Kind, ...]
    ids: IntArray
    values: Array
    whitening: Array
    sensor: IntArray
    records: Records

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class Part:
    """One file of a graph. `fixed` are the ids of vertices that it holds; `truth` are true values it states; `notes`
    say in words how it was read."""

    path: Path
    vertices: Sequence[Vertices] = ()
    measured: Sequence[Measured] = ()
    sensors: Sequence[Pose] = ()
    fixed: Sequence[Records] = ()
    truth: Sequence[Vertices] = ()
    dropped: Sequence[Dropped] = ()
    notes: Sequence[str] = ()
    names: Names | None = field(default=None)
