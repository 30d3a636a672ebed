"""What every row of a log leaves at a map: how far it is off, in its own standard deviations."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from teamslam.answers.columns import Columns, Tabular
from teamslam.answers.maps import Maps
from teamslam.errors import in_words
from teamslam.geometry import Array, IntArray, Sealed, seal
from teamslam.model import Names, Submap, Table, index_of, is_landmark, is_pose, robot_of

LANDMARK = "landmark "  # what a target that is one begins with


@dataclass(frozen=True, eq=False)
class Residuals(Sealed):
    """m rows of one sensor of one robot in one component, as residuals.csv has them: `whitened` (m, r); `stamp_s` (m,)
    is nan where there is none; `target` (m,) is a place in `targets`."""

    component: int
    robot: str
    source: str
    model: str
    row: IntArray
    stamp_s: Array
    target: IntArray
    targets: tuple[str, ...]
    weight: Array
    whitened: Array

    def __post_init__(self) -> None:
        seal(self, "row", "stamp_s", "target", "weight", "whitened")

    def __repr__(self) -> str:
        return f"Residuals({in_words(self.robot)}'s {in_words(self.source)}: {len(self):,} rows of {self.model})"

    def __len__(self) -> int:
        return len(self.row)

    @cached_property
    def size(self) -> Array:
        """The length of each residual over the root of its numbers (m,): about 1 where the model is right."""
        return np.asarray(np.sqrt(np.mean(self.whitened**2, -1)))


@dataclass(frozen=True)
class Residual:
    """One row: who measured, what, when [s], and how far it is off: `size` [sigmas a number], `weight` by the loss."""

    component: int
    robot: str
    source: str
    row: int
    stamp_s: float
    target: str
    size: float
    weight: float

    def __str__(self) -> str:
        when = "" if np.isnan(self.stamp_s) else f" at {self.stamp_s:.3f}"
        forgiven = "" if self.weight > 0.99 else f", weight {self.weight:.2g}"
        return (
            f"robot {in_words(self.robot)}, {in_words(self.source)} row {self.row}{when}, of {in_words(self.target)}: "
            f"{self.size:.2f} sigma{forgiven}"
        )


@dataclass(frozen=True, eq=False)
class ResidualTable(Tabular):
    """All rows of a log at a team's maps, sensor by sensor in `parts`."""

    parts: tuple[Residuals, ...]

    def __repr__(self) -> str:
        return f"ResidualTable({len(self):,} rows of {len(self.parts)} sensors)"

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __iter__(self) -> Iterator[Residual]:
        return (_row(part, place) for part in self.parts for place in range(len(part)))

    def worst(self, count: int = 10) -> list[Residual]:
        """The rows with the largest residuals, largest first; what a loss forgives is among them, with its weight."""
        ends = np.cumsum([len(part) for part in self.parts])
        sizes = np.concatenate([*(part.size for part in self.parts), np.zeros(0)])
        found = []
        for place in np.argsort(-sizes, kind="stable")[:count].tolist():
            part = int(np.searchsorted(ends, place, side="right"))
            found.append(_row(self.parts[part], place - int(ends[part]) + len(self.parts[part])))
        return found

    def columns(self) -> Columns:
        """component, robot, source, model, row, stamp_s, target, weight, size; then u_1, u_2, ... (nan beyond a row's
        own) as residuals.csv has them."""
        widest = max((part.whitened.shape[-1] for part in self.parts), default=0)
        stacked: Columns = {
            "component": self._each(lambda p: np.full(len(p), p.component), int),
            "robot": self._each(lambda p: _words([p.robot], np.zeros(len(p), int)), object),
            "source": self._each(lambda p: _words([p.source], np.zeros(len(p), int)), object),
            "model": self._each(lambda p: _words([p.model], np.zeros(len(p), int)), object),
            "row": self._each(lambda p: p.row, int),
            "stamp_s": self._each(lambda p: p.stamp_s, float),
            "target": self._each(lambda p: _words(p.targets, p.target), object),
            "weight": self._each(lambda p: p.weight, float),
            "size": self._each(lambda p: p.size, float),
        }
        return stacked | {
            f"u_{n + 1}": self._each(lambda p, n=n: _part_of(p.whitened, n), float) for n in range(widest)
        }

    def _each(self, column: Any, kind: type) -> Any:
        return np.concatenate([np.zeros(0, kind), *(np.asarray(column(part), kind) for part in self.parts)])


def residual_table(team: Maps, tables: Iterable[Table]) -> ResidualTable:
    """What the rows of `tables` leave at the maps that were made of them, weighed by their losses."""
    tables = tuple(tables)
    return ResidualTable(
        tuple(
            part
            for number, submap in enumerate(team.maps, 1)
            for table in tables
            if (part := _at(number, submap, table))
        )
    )


def _at(number: int, submap: Submap, table: Table) -> Residuals | None:
    """The rows of a table in one map; None where there are none."""
    mask = submap.rows_of(table)
    if not mask.any():
        return None
    held = table if mask.all() else table.select(mask)
    whitened = held.whitened(submap.all_values if submap.base >= 0 else submap.values)
    return residuals_in_words(number, held, whitened, held.loss.weight(np.sum(whitened**2, -1)), submap.names)


def residuals_in_words(component: int, table: Table, whitened: Array, weight: Array, names: Names) -> Residuals:
    """Whitened residuals (m, r) of a table's rows, in words and stamps."""
    seers = observers(table)
    return Residuals(
        component=component,
        robot=names.robot(table.robot),
        source=table.source,
        model=table.model,
        row=table.ids,
        stamp_s=np.where(seers > 0, names.stamps_s(seers), np.nan),
        **_targets(table.keys[:, -1], names),
        weight=weight,
        whitened=whitened,
    )


def observers(table: Table) -> IntArray:
    """The robot's own pose that each row of a table was taken from (m,), the later of two; 0 where there is none."""
    own = (robot_of(table.keys) == table.robot) & is_pose(table.keys)
    return np.asarray(np.where(own, table.keys, 0).max(-1))


def _targets(keys: IntArray, names: Names) -> dict[str, Any]:
    """Landmarks, and the robots that poses belong to, in words."""
    known, which = np.unique(np.where(is_landmark(keys), keys, -robot_of(keys)), return_inverse=True)

    def word(n: int) -> str:
        return f"{LANDMARK}{names.landmark(int(index_of(n)))}" if n >= 0 else f"robot {names.robot(-n)}"

    return {"target": np.asarray(which), "targets": tuple(map(word, known.tolist()))}


def _row(part: Residuals, place: int) -> Residual:
    return Residual(
        part.component,
        part.robot,
        part.source,
        int(part.row[place]),
        float(part.stamp_s[place]),
        part.targets[int(part.target[place])],
        float(part.size[place]),
        float(part.weight[place]),
    )


def _words(words: Sequence[str], which: IntArray) -> Any:
    return np.array(words, object)[which]


def _part_of(whitened: Array, part: int) -> Array:
    return whitened[:, part] if part < whitened.shape[-1] else np.full(len(whitened), np.nan)
