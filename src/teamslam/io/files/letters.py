"""Columns of numbers as text, all rows at once: what Python's `%` writes of each, letter by letter.

A column is a matrix of bytes, a row a cell; where a cell is shorter than others, it holds EMPTY, in any place. `lines`
puts columns beside each other and takes these out. A number becomes digits by whole numbers, as rint(|x| 10^k); the few
that lie so near to the middle between two that rounding here could go wrong, and those of another form, are left to
Python.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from teamslam.geometry import Array, IntArray

Letters = NDArray[np.uint8]

EMPTY = 0xFF  # no letter of UTF-8
LEAST = 4  # `%g` writes 10^-4 without an exponent, and less with one
ROWS = 20_000  # that are put together at a time, so that they stay near the processor
ZERO, POINT, MINUS = b"0.-"


def words(texts: Sequence[str], places: IntArray) -> Letters:
    """The text at each of the places (n,)."""
    encoded = [text.encode("utf-8") for text in texts]
    width = max(map(len, encoded), default=0)
    whole = b"".join(text.ljust(width, bytes([EMPTY])) for text in encoded)
    return np.frombuffer(whole, np.uint8).reshape(len(encoded), width)[places]


def spelled(numbers: Array | IntArray, spell: Callable[[float], str]) -> Letters:
    """What `spell` makes of numbers (n,), of which there are few different ones."""
    different, which = np.unique(numbers, return_inverse=True)
    return words([spell(number) for number in different.tolist()], which)


def integers(numbers: IntArray) -> Letters:
    """Whole numbers (n,) as `%d` writes them."""
    if not len(numbers) or numbers.min() < 0:
        return spelled(numbers, "%d".__mod__)
    width = len(str(numbers.max()))
    shown = numbers[:, None] >= 10 ** np.arange(width - 1, -1, -1)
    shown[:, -1] = True
    return np.where(shown, _digits(numbers, width), np.uint8(EMPTY))


def significant(numbers: Array, digits: int) -> Letters:
    """Numbers (n,) with so many digits, as `%.5g` writes them."""
    size = np.abs(numbers)
    plain = (size >= 10.0**-LEAST) & (size < 10.0**digits)
    size = np.where(plain, size, 1.0)
    power = np.floor(np.log10(size)).astype(np.int64)
    scaled = size * (10.0 ** np.arange(digits + LEAST))[digits - 1 - power]
    rounded = np.rint(scaled)
    sure = plain & (rounded >= 10.0 ** (digits - 1)) & (rounded < 10.0**digits)
    sure &= np.abs(np.abs(scaled - rounded) - 0.5) > 1e-6
    out = _pointed(np.where(sure, rounded, 0.0).astype(np.int64), power, np.signbit(numbers), digits)
    if not sure.all():
        rest = spelled(numbers[~sure], f"%.{digits}g".__mod__)
        out[~sure] = EMPTY
        out[~sure, : rest.shape[1]] = rest
    return out


def fixed(numbers: Array, decimals: int) -> Letters:
    """Numbers (n,) with so many digits behind the point, as `%.6f` writes them; what is no number is left empty."""
    plain = (numbers < 2.0**52 / 10.0**decimals) & ~np.signbit(numbers)
    scaled = np.where(plain, numbers, 0.0) * 10.0**decimals
    rounded = np.rint(scaled)
    sure = plain & (np.abs(np.abs(scaled - rounded) - 0.5) > np.maximum(1e-6, 4.0 * np.spacing(scaled)))
    whole, behind = np.divmod(rounded.astype(np.int64), 10**decimals)
    point = np.full((len(numbers), 1), POINT, np.uint8)
    out = np.concatenate([integers(whole), point, _digits(behind, decimals)], -1)
    out[~sure] = EMPTY
    rest = spelled(numbers[~sure], lambda number: "" if number != number else f"{number:.{decimals}f}")
    if rest.shape[1] > out.shape[1]:
        out = np.pad(out, ((0, 0), (0, rest.shape[1] - out.shape[1])), constant_values=EMPTY)
    out[~sure, : rest.shape[1]] = rest
    return out


def lines(columns: Sequence[Letters]) -> Iterator[bytes]:
    """Rows of cells with commas between them, a line each, many lines at a time."""
    width = sum(column.shape[1] + 1 for column in columns)
    rows = len(columns[0])
    for start in range(0, rows, ROWS):
        stop, end = min(start + ROWS, rows), 0
        table = np.full((stop - start, width), ord(","), np.uint8)
        for column in columns:
            table[:, end : end + column.shape[1]] = column[start:stop]
            end += column.shape[1] + 1
        table[:, -1] = ord("\n")
        yield table[table != EMPTY].tobytes()


def _pointed(rounded: IntArray, power: IntArray, negative: NDArray[np.bool_], count: int) -> Letters:
    """Numbers of so many digits, the first of which stands for 10^power, without zeros at their ends behind the
    point."""
    digits = _digits(rounded, count)
    last = count - 1 - np.argmax(digits[:, ::-1] != ZERO, -1)
    power, last = power.astype(np.int8), last.astype(np.int8)
    kept = np.maximum(last, power)
    out = np.full((2 * count + LEAST + 1, len(rounded)), EMPTY, np.uint8)  # sign, "0." and zeros, digits and points
    out[0, negative] = MINUS
    out[1, power < 0] = ZERO
    out[2, power < 0] = POINT
    for zero in range(1, LEAST):
        out[2 + zero, power < -zero] = ZERO
    for place in range(count):
        at = LEAST + 2 + 2 * place
        out[at] = np.where(kept >= place, digits[:, place], np.uint8(EMPTY))
        if place < count - 1:
            out[at + 1, (power == place) & (last > place)] = POINT
    return out.T


def _digits(numbers: IntArray, count: int) -> Letters:
    """The last digits of whole numbers (n,), so many of each: (n, count)."""
    out = np.empty((count, len(numbers)), np.uint8)
    rest = numbers.astype(np.int32) if count < 10 else numbers
    for place in range(count - 1, -1, -1):
        shorter = rest // 10
        out[place] = rest - 10 * shorter + ZERO
        rest = shorter
    return out.T
