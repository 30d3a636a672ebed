"""What a robot answers in exact rounds, as bytes: information and slope over separators, to the bit."""

import zlib

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.joining.exact.robot import Reduced, Sending, dense
from teamslam.model.sparse import sp

LARGEST = 20_000  # unknowns of one submap


class Numbers(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The upper triangle of a matrix; of a sparse one, where its numbers stand too, deflated."""

    matrix: bytes
    columns: bytes
    rows: bytes
    slope: bytes
    cost: float
    interior: float
    numbers: int
    rounding: float


def to_numbers(found: Reduced) -> bytes:
    """An answer as bytes."""
    matrix, n = found.information, len(found.slope)
    if matrix.nnz == n * n:
        packed = _bytes(matrix.toarray()[np.triu_indices(n)]), b"", b""
    else:
        entries = matrix.tocoo()
        upper = entries.col >= entries.row
        row, column = (zlib.compress(at[upper].astype("<i4").tobytes()) for at in (entries.row, entries.col))
        packed = _bytes(entries.data[upper]), column, row
    return msgspec.msgpack.encode(
        Numbers(*packed, _bytes(found.slope), found.cost, found.interior, found.numbers, found.rounding)
    )


def reduced_from(data: bytes, sending: Sending) -> Reduced:
    """An answer from bytes, of what is sent of a submap. Raises InputError where it does not fit."""
    found, n = msgspec.msgpack.decode(data, type=Numbers), sending.kept.dof
    numbers, slope = _array(found.matrix), _array(found.slope)
    whole = found.columns or found.rows
    if len(slope) != n or (not whole and len(numbers) != n * (n + 1) // 2) or n > LARGEST:
        raise InputError(f"an answer of another size than the {n} unknowns that were asked for")
    if not (np.isfinite(numbers).all() and np.isfinite(slope).all()):
        raise InputError("an answer holds a number that is not finite")
    if whole:
        matrix = _mirrored(n, _places(found.rows, len(numbers)), _places(found.columns, len(numbers)), numbers)
    else:
        full = np.zeros((n, n))
        full[np.triu_indices(n)] = numbers
        matrix = dense(full + np.triu(full, 1).T)
    return Reduced(matrix, slope, found.cost, found.interior, found.numbers, found.rounding)


def _places(data: bytes, count: int) -> IntArray:
    inflated = zlib.decompressobj().decompress(data, 4 * count + 1)
    if len(inflated) != 4 * count:
        raise InputError("an answer says of another number of numbers where they stand")
    return np.frombuffer(inflated, "<i4").astype(np.int64)


def _mirrored(n: int, row: IntArray, column: IntArray, numbers: Array) -> sp.csr_array:
    """A symmetric matrix from its upper triangle, with the zeros that it has: where they are must not change."""
    if len(row) and not (row.min() >= 0 and (row <= column).all() and column.max() < n):
        raise InputError("an answer has numbers outside of its matrix")
    off = row != column
    parts = ((row, column[off]), (column, row[off]), (numbers, numbers[off]))
    rows, columns, data = (np.concatenate(part) for part in parts)
    found = sp.coo_array((data, (rows, columns)), shape=(n, n)).tocsr()
    found.sort_indices()
    return found


def _bytes(numbers: Array) -> bytes:
    return np.ascontiguousarray(numbers, "<f8").tobytes()


def _array(data: bytes) -> Array:
    return np.frombuffer(data, "<f8").astype(float)
