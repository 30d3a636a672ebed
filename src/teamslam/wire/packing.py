"""Numbers as bytes: a writer and its reader, field by field in the same order.

Integers go in one of two ways, whichever is shorter; neither needs a table, both work on whole arrays:

    Rice      u = q 2^k + r as q ones, a zero, and k bits of r (Rice and Plaunt, 1971), k by group: where integers of
              a group are of like size, within a tenth of a bit of their entropy
    by width  how many bits u has, less the median of that, Rice coded; then its bits below the leading one: where
              sizes are mixed

u is the integer itself where none is negative, else 0, -1, 1, -2, 2, ... in that order.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray

UnsignedArray = NDArray[np.uint64]
RICE, BY_WIDTH, SIGNED = 0, 1, 2

DAMAGED = "the message is damaged: {}; ask for it again"


class Writer:
    """Collects fields; `content()` gives them one after another."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def content(self) -> bytes:
        """All that was written."""
        return b"".join(self._parts)

    def number(self, value: int) -> None:
        """An integer >= 0, seven bits a byte."""
        while value >= 0x80:
            self._parts.append(bytes([value & 0x7F | 0x80]))
            value >>= 7
        self._parts.append(bytes([value]))

    def signed(self, value: int) -> None:
        """Any integer."""
        self.number(2 * value if value >= 0 else -2 * value - 1)

    def raw(self, data: bytes) -> None:
        """Bytes as they are; the reader knows how many."""
        self._parts.append(data)

    def real(self, value: float) -> None:
        """A float64, to the bit."""
        self._parts.append(struct.pack("<d", value))

    def text(self, value: str) -> None:
        """A string."""
        data = value.encode()
        self.number(len(data))
        self._parts.append(data)

    def reals(self, values: Array, *, single: bool = False) -> None:
        """An array of floats to the bit (`single`: as float32), byte planes together, which compresses better."""
        flat = np.ascontiguousarray(values, "<f4" if single else "<f8").ravel()
        self._parts.append(flat.view(np.uint8).reshape(len(flat), flat.itemsize).T.tobytes())

    def integers(self, values: IntArray, groups: IntArray | None = None) -> None:
        """Integers of any sign; those of one group (0, 1, ...) are of like size. The reader knows their number."""
        flat = np.ascontiguousarray(values, np.int64).ravel()
        if len(flat):
            signed = bool(flat.min() < 0)
            unsigned = _zigzag(flat) if signed else flat.astype(np.uint64)
            ways = {RICE: _rice(unsigned, groups), BY_WIDTH: _by_width(unsigned)}
            way = min(ways, key=lambda name: len(ways[name]))
            self._parts.append(bytes([way | SIGNED * signed]) + ways[way])

    def columns(self, values: IntArray) -> None:
        """A table of integers (m, c): each column as steps from row to row, or about its median, whichever is less."""
        m, c = values.shape
        if not m:
            return
        out = np.zeros((m, c), np.int64)
        for at in range(c):
            column = values[:, at]
            centre = int(np.median(column))
            steps = np.diff(column, prepend=column[:1])
            walks = np.abs(steps).sum() < np.abs(column - centre).sum()
            self.number(int(walks))
            self.signed(int(column[0]) if walks else centre)
            out[:, at] = steps if walks else column - centre
        self.integers(out.T, np.repeat(np.arange(c), m))


class Reader:
    """Reads what a `Writer` wrote. Raises InputError where the bytes end too soon."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def take(self, count: int) -> bytes:
        """The next bytes."""
        if count < 0 or self._at + count > len(self._data):
            raise InputError(DAMAGED.format("it ends too soon"))
        self._at += count
        return self._data[self._at - count : self._at]

    @property
    def finished(self) -> bool:
        """True where nothing is left."""
        return self._at == len(self._data)

    def number(self) -> int:
        """An integer >= 0."""
        value, shift = 0, 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value
            if shift > 70:
                raise InputError(DAMAGED.format("a number in it has no end"))

    def count(self) -> int:
        """How many things follow: refused where the rest of the message could not hold as many."""
        found = self.number()
        if found > 8 * (len(self._data) - self._at) + 8:
            raise InputError(DAMAGED.format(f"it says that {found} things follow, more than it has room for"))
        return found

    def signed(self) -> int:
        """Any integer."""
        value = self.number()
        return value // 2 if value % 2 == 0 else -(value + 1) // 2

    def real(self) -> float:
        """A float64."""
        return float(struct.unpack("<d", self.take(8))[0])

    def text(self) -> str:
        """A string."""
        return self.take(self.number()).decode()

    def reals(self, count: int, *, single: bool = False) -> Array:
        """An array of floats."""
        size = 4 if single else 8
        planes = np.frombuffer(self.take(size * count), np.uint8).reshape(size, count)
        kind = "<f4" if single else "<f8"
        return np.ascontiguousarray(planes.T).view(kind).reshape(count).astype(float)

    def integers(self, count: int, groups: IntArray | None = None) -> IntArray:
        """As many integers, in the same groups as they were written in."""
        if not count:
            return np.zeros(0, np.int64)
        way = self.take(1)[0]
        if way > BY_WIDTH | SIGNED:
            raise InputError(DAMAGED.format("integers in it are written in no way that is known"))
        unsigned = self._by_width(count) if way & BY_WIDTH else self._rice(count, groups)
        return _unzigzag(unsigned) if way & SIGNED else unsigned.astype(np.int64)

    def _by_width(self, count: int) -> UnsignedArray:
        median = self.number()
        widths = _unzigzag(self._rice(count, None)) + median
        if widths.min() < 0 or widths.max() > 64:
            raise InputError(DAMAGED.format("an integer in it is wider than 64 bits"))
        below = self._bits(np.maximum(widths - 1, 0))
        leading = np.left_shift(np.uint64(1), np.maximum(widths - 1, 0).astype(np.uint64))
        return np.where(widths > 0, leading | below, np.uint64(0))

    def _rice(self, count: int, groups: IntArray | None) -> UnsignedArray:
        of_group = np.zeros(count, np.int64) if groups is None else np.asarray(groups)
        k = np.frombuffer(self.take(int(of_group.max()) + 1), np.uint8).astype(np.int64)[of_group]
        if k.max() > 63:
            raise InputError(DAMAGED.format("an integer in it is wider than 64 bits"))
        stream = np.unpackbits(np.frombuffer(self.take(self.number()), np.uint8))
        ends = np.flatnonzero(stream == 0)[:count]
        if len(ends) < count:
            raise InputError(DAMAGED.format("integers are missing in it"))
        quotients = (np.diff(ends, prepend=-1) - 1).astype(np.uint64)
        return np.asarray((quotients << k.astype(np.uint64)) | self._bits(k))

    def _bits(self, widths: IntArray) -> UnsignedArray:
        owner, place = _bit_places(widths)
        bits = np.unpackbits(np.frombuffer(self.take(-(-len(owner) // 8)), np.uint8))[: len(owner)]
        out = np.zeros(len(widths), np.uint64)
        np.bitwise_or.at(out, owner, bits.astype(np.uint64) << place.astype(np.uint64))
        return out

    def columns(self, rows: int, columns: int) -> IntArray:
        """A table of integers (rows, columns)."""
        if not rows:
            return np.zeros((0, columns), np.int64)
        heads = [(self.number() == 1, self.signed()) for _ in range(columns)]
        out = self.integers(rows * columns, np.repeat(np.arange(columns), rows)).reshape(columns, rows).T
        return np.stack(
            [(np.cumsum(part) if walks else part) + head for part, (walks, head) in zip(out.T, heads, strict=True)], -1
        )


def _zigzag(values: IntArray) -> UnsignedArray:
    """0, -1, 1, -2, 2 ... -> 0, 1, 2, 3, 4 ..."""
    return np.asarray(((values << 1) ^ (values >> 63)).astype(np.uint64))


def _unzigzag(unsigned: UnsignedArray) -> IntArray:
    magnitude = (unsigned >> np.uint64(1)).astype(np.int64)
    return np.where(unsigned & np.uint64(1), -magnitude - 1, magnitude)


def _rice(unsigned: UnsignedArray, groups: IntArray | None) -> bytes:
    of_group = np.zeros(len(unsigned), np.int64) if groups is None else np.asarray(groups)
    bits = _best_bits(unsigned, of_group)
    k = bits[of_group]
    ends = np.cumsum((unsigned >> k.astype(np.uint64)).astype(np.int64) + 1)
    ones = np.ones(int(ends[-1]), np.uint8)
    ones[ends - 1] = 0
    unary = np.packbits(ones).tobytes()
    head = Writer()
    head.number(len(unary))
    return bits.astype(np.uint8).tobytes() + head.content() + unary + _low_bits(unsigned, k)


def _by_width(unsigned: UnsignedArray) -> bytes:
    widths = np.zeros(len(unsigned), np.int64)
    for shift in range(int(unsigned.max()).bit_length()):
        widths += (unsigned >> np.uint64(shift)) > 0
    median = int(np.median(widths))
    head = Writer()
    head.number(median)
    coded = _rice(_zigzag(widths - median), None)
    return head.content() + coded + _low_bits(unsigned, np.maximum(widths - 1, 0))


def _low_bits(unsigned: UnsignedArray, widths: IntArray) -> bytes:
    owner, place = _bit_places(widths)
    return np.packbits((unsigned[owner] >> place.astype(np.uint64)).astype(np.uint8) & 1).tobytes()


def _best_bits(unsigned: UnsignedArray, groups: IntArray) -> IntArray:
    """The width k of the remainders that makes each group shortest."""
    count = np.maximum(np.bincount(groups), 1)
    mean = np.bincount(groups, unsigned.astype(float)) / count
    guess = np.floor(np.log2(np.maximum(mean, 1e-3))).astype(np.int64)
    best = np.clip(guess, 0, 62)
    least = np.full(len(count), np.inf)
    for offset in (0, -1, 1):
        k = np.clip(guess + offset, 0, 62)
        length = np.bincount(groups, (unsigned >> k[groups].astype(np.uint64)).astype(float)) + count * (1 + k)
        best, least = np.where(length < least, k, best), np.minimum(length, least)
    return best


def _bit_places(k: IntArray) -> tuple[IntArray, IntArray]:
    """For every bit of remainders of widths k: whose it is, and how far from the low end; high bits first."""
    owner = np.repeat(np.arange(len(k)), k)
    first = np.repeat(np.cumsum(k) - k, k)
    return owner, k[owner] - 1 - (np.arange(len(owner)) - first)
