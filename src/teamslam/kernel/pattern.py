"""Which blocks of a symmetric block matrix are stored."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teamslam.errors import ModelError
from teamslam.kernel.library import Floats, Integers, checked, floats, indices, integers, library


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """The lower triangle of a symmetric matrix of blocks, by block column.

    Variable v has dofs[v] unknowns. Column c stores blocks column_start[c] to column_start[c + 1]: its diagonal block
    first, then rows (variables) in rising order. Block k begins at value_start[k] of the values, dense, column-major;
    diagonal blocks are stored whole. scalar_start[v] is the first scalar unknown of variable v.
    Raises ModelError if the arrays do not say so.
    """

    dofs: NDArray[np.int32]
    column_start: NDArray[np.int64]
    row: NDArray[np.int32]

    def __post_init__(self) -> None:
        dofs = integers("dofs", self.dofs, (None,))
        n = len(dofs)
        column_start = integers("column_start", self.column_start, (n + 1,))
        row = integers("row", self.row, (None,))
        if n and (dofs.min() < 1 or dofs.max() > np.iinfo(np.int32).max):
            raise ModelError(f"dofs: variable {int(dofs.argmin())} has {dofs.min()} unknowns, expected at least 1")
        lengths = np.diff(column_start)
        if column_start[0] != 0 or column_start[-1] != len(row) or (n and lengths.min() < 1):
            raise ModelError(
                "column_start: expected to rise from 0 to the number of blocks, one block or more a column"
            )
        column = np.repeat(np.arange(n), lengths)
        if not np.array_equal(row[column_start[:-1]], np.arange(n)):
            raise ModelError("row: every column must begin with its diagonal block")
        if (np.diff(row)[np.diff(column) == 0] <= 0).any() or (n and (row.min() < 0 or row.max() >= n)):
            raise ModelError(f"row: rows must rise within a column and be below {n}")
        object.__setattr__(self, "dofs", dofs.astype(np.int32))
        object.__setattr__(self, "column_start", column_start)
        object.__setattr__(self, "row", row.astype(np.int32))

    @classmethod
    def trusted(
        cls, dofs: NDArray[np.int32], column_start: NDArray[np.int64], row: NDArray[np.int32], size: int, scalars: int
    ) -> "BlockPattern":
        """The pattern that these arrays say, with its `size` and `scalars`: from the kernel, and not checked."""
        pattern = cls.__new__(cls)
        pattern.__dict__.update(dofs=dofs, column_start=column_start, row=row, size=size, scalars=scalars)
        return pattern

    @classmethod
    def from_pairs(cls, dofs: ArrayLike, first: ArrayLike, second: ArrayLike) -> "BlockPattern":
        """All diagonal blocks, and one block for every pair of variables (in any order, any number of times)."""
        sizes = integers("dofs", dofs, (None,))
        a = integers("first", first, (None,))
        b, n = integers("second", second, (len(a),)), len(sizes)
        if len(a) and (min(a.min(), b.min()) < 0 or max(a.max(), b.max()) >= n):
            raise ModelError(f"pairs: found variables outside 0 to {n - 1}")
        code = np.unique(np.concatenate([np.minimum(a, b) * n + np.maximum(a, b), np.arange(n) * (n + 1)]))
        return cls(
            sizes.astype(np.int32), np.searchsorted(code, np.arange(n + 1) * n), (code % max(n, 1)).astype(np.int32)
        )

    @classmethod
    def of_sparse_rows(
        cls, dofs: ArrayLike, data: ArrayLike, columns: ArrayLike, start: ArrayLike
    ) -> tuple["BlockPattern", Floats]:
        """The blocks of a symmetric matrix by rows of scalars, columns rising in each, and their values. Of the two
        triangles the lower one counts. The inverse of `sparse_rows`. Raises ModelError for rows that do not fit."""
        sizes = integers("dofs", dofs, (None,)).astype(np.int32)
        rows = integers("row starts", start, (int(sizes.sum()) + 1,))
        at = indices("columns", columns, int(rows[-1]))
        numbers = floats("data", data, (int(rows[-1]),))
        counts = np.empty(2, np.int64)
        found = library.blocks_new(len(sizes), sizes, rows, at, numbers, counts)
        if not found:
            raise ModelError(library.error().decode())
        blocks, size = counts.tolist()
        column_start, row, values = np.empty(len(sizes) + 1, np.int64), np.empty(blocks, np.int32), np.empty(size)
        library.blocks_take(found, column_start, row, values)
        return cls.trusted(sizes, column_start, row, size, int(rows.size) - 1), values

    def sparse_rows(self, values: ArrayLike) -> tuple[Floats, NDArray[np.int32], NDArray[np.int32] | Integers]:
        """The matrix with `values` as (data, columns, row starts): by rows of scalars, both triangles, columns rising.

        Row starts are int32 where they fit, as SciPy has them.
        """
        numbers = floats("values", values, (self.size,))
        diagonal = int((self.dofs.astype(np.int64) ** 2).sum())
        data = np.empty(2 * self.size - diagonal)
        columns, start = np.empty(len(data), np.int32), np.empty(self.scalars + 1, np.int64)
        checked(
            library.sparse_rows(len(self.dofs), self.dofs, self.column_start, self.row, numbers, start, columns, data)
        )
        return data, columns, start.astype(np.int32) if len(data) < 1 << 31 else start

    @cached_property
    def value_start(self) -> NDArray[np.int64]:
        """Where each block begins in the values, and their number."""
        sizes = self.dofs.astype(np.int64)
        return _starts(sizes[self.row] * np.repeat(sizes, np.diff(self.column_start)))

    @cached_property
    def scalar_start(self) -> NDArray[np.int64]:
        """The first unknown of each variable, and the number of unknowns."""
        return _starts(self.dofs.astype(np.int64))

    @cached_property
    def size(self) -> int:
        """Numbers stored."""
        return int(self.value_start[-1])

    @cached_property
    def scalars(self) -> int:
        """Scalar unknowns: the matrix is scalars x scalars."""
        return int(self.dofs.sum())


def _starts(lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    starts = np.zeros(len(lengths) + 1, np.int64)
    np.cumsum(lengths, out=starts[1:])
    return starts
