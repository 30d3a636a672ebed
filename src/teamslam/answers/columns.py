"""Records as columns, under the names that the CSV files of a run have, and as a DataFrame where pandas is there.

Covariances are upper triangles, columns `cov_a_b`, of the errors [x y heading] of planar poses, [x y z rx ry rz] of
spatial ones (translation in the map's frame, rotation in the body's own), [x y] or [x y z] of points.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import MissingExtraError
from teamslam.geometry import AnyArray, Array, Pose

if TYPE_CHECKING:
    import pandas

AXES = ("x", "y", "z")
POSE_ERRORS = {2: ("x", "y", "heading"), 3: ("x", "y", "z", "rx", "ry", "rz")}
POSE_COLUMNS = {2: ("x_m", "y_m", "heading_rad"), 3: ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")}
UNITS = {"x": "m", "y": "m", "z": "m", "heading": "rad", "rx": "rad", "ry": "rad", "rz": "rad"}

Columns = dict[str, AnyArray]


class Tabular(ABC):
    """A record that is a table: `columns()` as arrays, `to_dataframe()` with pandas."""

    @abstractmethod
    def columns(self) -> Columns:
        """The table as arrays (n,) by the name of their column."""

    def to_dataframe(self) -> "pandas.DataFrame":
        """The table as a pandas DataFrame. Raises MissingExtraError without pandas; `columns()` needs none."""
        return dataframe(self.columns())

    def _repr_html_(self) -> str:
        from teamslam.cards import card

        columns = self.columns()
        rows = len(next(iter(columns.values()), ()))
        shown = [(f"{name}", _some(column)) for name, column in columns.items() if not name.startswith("cov_")]
        return card(f"{type(self).__name__}: {rows:,} rows, {len(columns)} columns", shown)


def dataframe(columns: Columns, index: Sequence[str] | None = None) -> "pandas.DataFrame":
    """Columns as a DataFrame. Raises MissingExtraError without pandas."""
    try:
        import pandas
    except ImportError:
        raise MissingExtraError(
            "a DataFrame needs pandas: pip install 'teamslam[pandas]'; without it, columns() gives the same as arrays"
        ) from None
    return pandas.DataFrame(columns, index=None if index is None else list(index))


def pose_columns(poses: Pose) -> Columns:
    """Poses (n,) as people write them."""
    return dict(zip(POSE_COLUMNS[poses.dim], poses.numbers().T, strict=True))


def place_columns(positions: Array) -> Columns:
    """Positions (n, d)."""
    return {f"{axis}_m": column for axis, column in zip(AXES, positions.T, strict=False)}


def covariance_columns(blocks: Array, errors: Sequence[str]) -> Columns:
    """The upper triangles of covariances (n, d, d) of these errors."""
    rows, columns = np.triu_indices(len(errors))
    return dict(zip(triangle(errors), blocks[:, rows, columns].T, strict=True))


def triangle(errors: Sequence[str]) -> list[str]:
    """The names of an upper triangle's columns."""
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(errors, 2)]


def _some(column: AnyArray) -> str:
    """The first three, and the last."""
    told = [f"{value:.6g}" if isinstance(value, float) else str(value) for value in [*column[:3], *column[-1:]]]
    return ", ".join(told[:-1] if len(column) <= 3 else [*told[:3], "...", told[3]])
