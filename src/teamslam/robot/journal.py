"""What a robot has heard, on its disk: so that a robot that was killed goes on as if nothing had happened.

A robot's state is a function of the rows that it took and the bodies that it holds; so these are what is written, in
the order in which they came, and all else is made of them again.

It is an SQLite database in WAL mode, a well-kept store that does what a file of our own would have to: a record is
there whole or not at all, a torn tail is cut when it is opened, and it can be copied while it is written to. What it
does not know is whether an old page has rotted: every record carries a digest of its own, and one that does not fit is
named and left out.

    rows      are on their way to the disk after each step: a process that is killed loses nothing, a machine that
              loses power at most what the system had not written yet
    bodies    are on the disk (fsync) before anybody is told of them: nothing contradicts what others hold

A disk that is full or read-only ends nothing: the trouble is kept (`trouble`), records wait in memory, and the next
write tries again.
"""

import hashlib
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.model import Dataset, Table, pack
from teamslam.robot.packets import Body, to_bytes
from teamslam.robot.robot import Robot
from teamslam.robot.rows import channel_of

FORMAT = 2
RECORD = "n INTEGER PRIMARY KEY, kind TEXT, data BLOB, digest BLOB"
WAITING = 100_000  # records that wait for a disk at most
DIGEST = 16
LOCKED_S = 2.0  # for a process that is just being ended


class Rows(msgspec.Struct, frozen=True, array_like=True):
    """Rows of a channel: numbers as little-endian bytes; no whitening where the channel has one for all."""

    channel: int
    count: int
    keys: bytes
    values: bytes
    ids: bytes
    whitening: bytes | None


@dataclass(frozen=True, eq=False)
class Memory:
    """What a journal holds: rows and bodies (submaps, announcements and removals, with their signatures) as they came,
    the versions of closed pieces that got late rows or poses by agreement (`agreed`), what landmarks are called, and
    what is damaged, in words."""

    tables: tuple[Table, ...] = ()
    bodies: tuple[Body, ...] = ()
    versions: Mapping[int, int] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)
    agreed: tuple[int, ...] = ()
    damaged: tuple[str, ...] = ()


class Journal:
    """The journal of one robot in one file. `head`: the channels that its rows come from.

    Raises InputError where the file is no journal, or that of another robot or of other channels, or another process
    writes it: what a robot holds is of one hand.
    """

    def __init__(self, path: str | Path, head: Dataset) -> None:
        self.path, self._head = Path(path), head
        self.trouble = ""
        self._waiting: list[tuple[str, bytes]] = []
        self.lost = 0  # records that could not even wait
        self._versions: dict[int, int] = {}
        self._agreed: set[int] = set()
        self._called, self._names = dict(head.names.landmarks), head.names
        self._lock = self._locked()
        try:
            self._base = self._opened()
        except InputError:
            self._lock.close()
            raise

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- writing --------------------------------------------------------------------------------------------------

    def step(self, robot: Robot) -> None:
        """Write down what a robot took in its last step."""
        records = [("rows", self._packed(table)) for table in robot.took] + self._versioned(robot)
        self._write(records + [("name", msgspec.msgpack.encode(pair)) for pair in self._fresh_names(robot)], sync=False)

    def agree(self, robot: Robot) -> None:
        """Write down the poses that a robot agreed to since."""
        self._write(self._versioned(robot), sync=False)

    def _versioned(self, robot: Robot) -> list[tuple[str, bytes]]:
        """What makes pieces come again, but for rows: poses by agreement, and the versions that they have come to."""
        agreed = [key for key in robot.agreed.tolist() if key not in self._agreed]
        self._agreed.update(agreed)
        newer = {p.number: p.version for p in robot.closed if p.version > self._versions.get(p.number, 0)}
        self._versions |= newer
        found = [("agreed", msgspec.msgpack.encode(agreed))] if agreed else []
        return found + [("version", msgspec.msgpack.encode(pair)) for pair in newer.items()]

    def _fresh_names(self, robot: Robot) -> list[tuple[int, str]]:
        if robot.head.names is self._names:
            return []
        self._names = robot.head.names
        fresh = {n: name for n, name in self._names.landmarks.items() if n not in self._called}
        self._called |= fresh
        return list(fresh.items())

    def bodies(self, bodies: Iterable[Body]) -> bool:
        """Write down bodies that were made or heard. True once they are on the disk: only then may others be told."""
        return self._write([("body", to_bytes(body)) for body in bodies], sync=True)

    def close(self) -> None:
        """No more will be written."""
        self._write([], sync=True)
        self._base.close()
        self._lock.close()

    def _write(self, records: Sequence[tuple[str, bytes]], *, sync: bool) -> bool:
        self._waiting += records
        if not self._waiting:
            return True
        try:
            self._base.execute(f"PRAGMA synchronous = {'FULL' if sync else 'NORMAL'}")
            with self._base:
                self._base.executemany(
                    "INSERT INTO records (kind, data, digest) VALUES (?, ?, ?)",
                    [(kind, data, _digest(kind, data)) for kind, data in self._waiting],
                )
        except sqlite3.Error as error:
            self.trouble = f"{self.path}: {error}; {len(self._waiting)} records wait in memory"
            self.lost += max(0, len(self._waiting) - WAITING)
            del self._waiting[:-WAITING]
            return False
        self._waiting, self.trouble = [], ""
        return True

    # --- reading --------------------------------------------------------------------------------------------------

    def recall(self) -> Memory:
        """All that was written down."""
        tables: list[Table] = []
        bodies: list[Body] = []
        damaged: list[str] = []
        last = 0
        while True:
            try:
                found = self._base.execute(
                    "SELECT n, kind, data, digest FROM records WHERE n > ? ORDER BY n LIMIT 1000", (last,)
                ).fetchall()
            except sqlite3.DatabaseError as error:
                damaged.append(f"{self.path}: nothing can be read after record {last}: {error}")
                break
            if not found:
                break
            for last, kind, data, digest in found:
                try:
                    if _digest(kind, data) != digest:
                        raise ValueError("its digest does not fit its content")
                    if kind == "rows":
                        tables.append(self._unpacked(data))
                    elif kind == "version":
                        number, version = msgspec.msgpack.decode(data, type=tuple[int, int])
                        self._versions[number] = max(version, self._versions.get(number, 0))
                    elif kind == "agreed":
                        self._agreed.update(msgspec.msgpack.decode(data, type=list[int]))
                    elif kind == "name":
                        landmark, name = msgspec.msgpack.decode(data, type=tuple[int, str])
                        self._called[landmark] = name
                    else:
                        bodies.append(msgspec.msgpack.decode(data, type=Body))
                except (ValueError, TypeError, AttributeError, msgspec.DecodeError) as error:
                    damaged.append(f"{self.path}: record {last} is damaged and left out: {error}")
        agreed = tuple(sorted(self._agreed))
        return Memory(tuple(tables), tuple(bodies), dict(self._versions), dict(self._called), agreed, tuple(damaged))

    # --- inside ---------------------------------------------------------------------------------------------------

    def _locked(self) -> sqlite3.Connection:
        """What no other process has at the same time; it goes with its process, however that ends."""
        try:
            lock = sqlite3.connect(f"{self.path}.lock", check_same_thread=False, timeout=LOCKED_S)
            lock.execute("BEGIN EXCLUSIVE")
        except sqlite3.Error as error:
            reason = f"the journal cannot be opened: {error}"
            if "locked" in str(error):
                reason = "another process writes this journal: this robot is running already; end it first"
            raise InputError(reason, path=self.path) from None
        return lock

    def _opened(self) -> sqlite3.Connection:
        try:
            base = sqlite3.connect(self.path, check_same_thread=False)
            base.execute("PRAGMA journal_mode = WAL")
            base.execute("CREATE TABLE IF NOT EXISTS about (format INTEGER, channels BLOB)")
            base.execute(f"CREATE TABLE IF NOT EXISTS records ({RECORD})")
            about = base.execute("SELECT format, channels FROM about").fetchone()
            if about is None:
                with base:
                    base.execute("INSERT INTO about VALUES (?, ?)", (FORMAT, _fingerprint(self._head)))
        except sqlite3.Error as error:
            raise InputError(f"the journal cannot be opened: {error}", path=self.path) from None
        if about is not None and about[0] != FORMAT:
            raise InputError(
                f"a journal of format {about[0]}; this teamslam writes format {FORMAT}: begin in another folder",
                path=self.path,
            )
        if about is not None and about[1] != _fingerprint(self._head):
            raise InputError("the journal of another robot, or of other sensors than these", path=self.path)
        return base

    def _packed(self, table: Table) -> bytes:
        channel = channel_of(self._head, table)
        shared = len(self._head.tables[channel].whitening) == 1
        each = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
        whitening = None if shared else _bytes(each)
        return msgspec.msgpack.encode(
            Rows(channel, len(table), _bytes(table.keys), _bytes(table.values), _bytes(table.ids), whitening)
        )

    def _unpacked(self, data: bytes) -> Table:
        rows = msgspec.msgpack.decode(data, type=Rows)
        if not 0 <= rows.channel < len(self._head.tables):
            raise ValueError(f"there is no channel {rows.channel}")
        channel, m = self._head.tables[rows.channel], rows.count
        r = channel.whitening.shape[-1]
        whitening = channel.whitening if rows.whitening is None else _floats(rows.whitening).reshape(m, r, r)
        return Table(
            channel.robot, channel.source, channel.model, channel.dim, _integers(rows.keys).reshape(m, -1),
            _floats(rows.values).reshape(m, -1), whitening, _integers(rows.ids), channel.sensor, channel.loss,
        )  # fmt: skip


def is_written(path: Path) -> bool:
    """Whether a process of this machine has a journal open to write: its robot runs. A folder that was copied from
    another machine, or lies on one, tells nothing."""
    lock = path.with_name(f"{path.name}.lock")
    if not lock.exists():
        return False
    try:
        with closing(sqlite3.connect(f"{lock.resolve().as_uri()}?mode=ro", uri=True, timeout=0.0)) as base:
            base.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error as error:
        return "locked" in str(error)
    return False


def _digest(kind: str, data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=DIGEST, person=kind.encode()).digest()


def _fingerprint(head: Dataset) -> bytes:
    """What tells channels apart."""
    told = hashlib.blake2b(digest_size=DIGEST)
    for t in head.tables:
        mount = b"" if t.sensor is None else _bytes(pack(t.sensor))
        words = (t.robot, t.source, t.model, t.dim, t.loss.name, t.loss.scale, head.names.tick_s, t.whitening.shape[1:])
        told.update(repr(words).encode() + mount + _bytes(t.whitening))
    return told.digest()


def _bytes(numbers: Array | IntArray) -> bytes:
    return np.ascontiguousarray(numbers, "<i8" if numbers.dtype.kind == "i" else "<f8").tobytes()


def _integers(data: bytes) -> IntArray:
    return np.frombuffer(data, "<i8").astype(np.int64)


def _floats(data: bytes) -> Array:
    return np.frombuffer(data, "<f8").astype(np.float64)
