"""What a robot sends of a submap, in four kinds; all to the bit, or rounded within a bound that travels along.

    raw         the measurements themselves, shared noise once; the receiver builds the submap
    sparse      the whole submap, information as it is
    partial     interiors eliminated while that makes the message smaller
    condensed   only what others need, all else eliminated

A message is four bytes of name and version, a flag (deflated or not), eight bytes of blake2b over the rest, and the
rest. A message that was damaged on its way is refused, never half read.
"""

import hashlib
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import AnyArray
from teamslam.io.submaps.arrays import submap_from_bytes, submap_to_bytes
from teamslam.io.submaps.soundness import check_table
from teamslam.joining import build, condense, condense_partially
from teamslam.model import Dataset, Sources, Submap
from teamslam.model.keys import MAX_ROBOT
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.wire.codec_places import get_known, get_names, put_known, put_names
from teamslam.wire.codec_submap import get_submap, put_submap
from teamslam.wire.codec_tables import get_tables, put_tables
from teamslam.wire.packing import DAMAGED, Reader, Writer
from teamslam.wire.rounding import EXACT, Precision

MAGIC, VERSION = b"tsm", 2
PLAIN, DEFLATED = 0, 1
DIGEST = 8
LARGEST = 1 << 31  # bytes after inflation: a guard against messages made to exhaust memory

Condensing = Callable[[Submap, AnyArray], Submap]
CONDENSINGS: dict[str, Condensing] = {
    "sparse": lambda submap, keep: submap,
    "partial": lambda submap, keep: condense_partially(submap, keep)[0],
    "condensed": lambda submap, keep: condense(submap, keep)[0],
}
KINDS = ("raw", *CONDENSINGS)


@dataclass(frozen=True)
class Message:
    """Bytes on their way: what kind, of which submap and version, and how far its numbers may be off (`rounding`)."""

    kind: str
    id: str
    version: int
    data: bytes
    rounding: Precision

    def __len__(self) -> int:
        return len(self.data)


@dataclass(frozen=True, eq=False)
class Received:
    """A message opened: a submap, or a piece of log of which `submap` is built."""

    kind: str
    id: str
    version: int
    rounding: Precision
    content: Submap | Dataset

    def submap(self, options: Options = DEFAULTS) -> Submap:
        """The submap that was sent, or the one built from the measurements that were. Raises as `build` does."""
        if isinstance(self.content, Submap):
            return self.content
        return build(self.content, id=self.id, version=self.version, options=options)


def send(kind: str, submap: Submap, keep: AnyArray, precision: Precision = EXACT) -> Message:
    """A submap as a message of one of the kinds but raw; `keep` as `teamslam.joining.separators` says."""
    if kind not in CONDENSINGS:
        raise InputError(f"unknown kind of message '{kind}'; choose one of {', '.join(CONDENSINGS)}")
    small = CONDENSINGS[kind](submap, keep)
    body = Writer()
    rounding = put_submap(body, small, precision.as_limit())
    return _seal(kind, small.id, small.version, rounding, body)


def send_raw(piece: Dataset, id: str, version: int = 0, precision: Precision = EXACT) -> Message:
    """A piece of one robot's log as a message: `teamslam.build` makes the same submap of it at the other end."""
    known = np.unique(np.concatenate([np.zeros(0, np.int64), *(t.keys.ravel() for t in piece.tables)]))
    body = Writer()
    body.text(id)
    body.number(version)
    named = {int(r) for t in piece.tables for r in np.unique(t.keys >> 51) if r > 0} | {t.robot for t in piece.tables}
    body.number(len(named))
    for robot in sorted(named):
        body.number(robot)
        body.number(piece.robots[robot])
    put_known(body, known)
    put_names(body, piece.names, known, Sources.of(piece.tables))
    rounding = put_tables(body, piece.tables, known, precision.as_limit())
    return _seal("raw", id, version, rounding, body)


def receive(data: bytes) -> Received:
    """Open a message. Raises InputError where it is none, of an unknown version, or damaged."""
    if data[:3] != MAGIC:
        raise InputError("these bytes are no teamslam message (they do not begin with 'tsm')")
    if data[3:4] != bytes([VERSION]):
        raise InputError(
            f"the message is of version {data[3] if len(data) > 3 else 'none'}; this teamslam reads version {VERSION}: "
            f"use the same release on all robots"
        )
    if len(data) < 5 + DIGEST or _digest(data[:5] + data[5 + DIGEST :], DIGEST) != data[5 : 5 + DIGEST]:
        raise InputError(DAMAGED.format("its digest does not fit its content"))
    try:
        source = Reader(_inflate(data[4], data[5 + DIGEST :]))
        kind = KINDS[source.number()]
        rounding = Precision(source.real(), source.real())
        received = _open_raw(source, rounding) if kind == "raw" else _open_submap(source, kind, rounding)
    except TeamslamError:
        raise
    except (ValueError, IndexError, OverflowError, KeyError, zlib.error) as error:
        raise InputError(DAMAGED.format(f"its content makes no sense ({error})")) from None
    if not source.finished:
        raise InputError(DAMAGED.format("something follows its end"))
    return received


def check(submap: Submap) -> None:
    """Raise InputError with the reason where a submap makes no sense: numbers that are not finite, rotations that are
    none, no base frame, information that is not positive definite. The checks are those of the submap file."""
    submap_from_bytes(submap_to_bytes(submap))


def canonical(submap: Submap) -> bytes:
    """The submap to the bit, as bytes: equal exactly where two submaps say the same."""
    body = Writer()
    put_submap(body, submap, EXACT)
    return body.content()


def _seal(kind: str, id_: str, version: int, rounding: Precision, body: Writer) -> Message:
    head = Writer()
    head.number(KINDS.index(kind))
    head.real(rounding.shift_sigma)
    head.real(rounding.information)
    plain = head.content() + body.content()
    deflated = zlib.compress(plain, 9)
    flag, content = (DEFLATED, deflated) if len(deflated) < len(plain) else (PLAIN, plain)
    start = MAGIC + bytes([VERSION, flag])
    return Message(kind, id_, version, start + _digest(start + content, DIGEST) + content, rounding)


def _inflate(flag: int, content: bytes) -> bytes:
    if flag == PLAIN:
        return content
    machine = zlib.decompressobj()
    plain = machine.decompress(content, LARGEST)
    if not machine.eof:
        raise InputError(DAMAGED.format("it cannot be inflated"))
    return plain


def _open_raw(source: Reader, rounding: Precision) -> Received:
    id_, version = source.text(), source.number()
    robots = {source.number(): source.number() for _ in range(source.count())}
    if not all(1 <= robot <= MAX_ROBOT and dim in (2, 3) for robot, dim in robots.items()):
        raise InputError(DAMAGED.format(f"a team of robots {robots} (number: dimension) cannot be"))
    known = get_known(source)
    names = get_names(source)
    tables = get_tables(source, known)
    for table in tables:
        check_table(table)
    return Received("raw", id_, version, rounding, Dataset(robots, tables, names))


def _open_submap(source: Reader, kind: str, rounding: Precision) -> Received:
    submap = get_submap(source)
    check(submap)
    return Received(kind, submap.id, submap.version, rounding, submap)


def _digest(data: bytes, size: int) -> bytes:
    return hashlib.blake2b(data, digest_size=size).digest()
