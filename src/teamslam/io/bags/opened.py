"""A recording, open: its topics, and its messages one after another, whatever the file is, or the files where it was
split into parts.

Messages come raw and are decoded when somebody wants to know more than their stamp: the stamp of a message that begins
with a header is read from its first bytes. What cannot be read is counted (`Recording.dropped`): a message that does
not decode by itself, and everything after the place where a file breaks off.
"""

import re
import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.errors import InputError, MissingExtraError, in_words
from teamslam.io.bags.roles import DEFINITIONS
from teamslam.model import Dropped

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".mcap", ".db3")
NS_PER_TICK = 1000
NUMBERED = re.compile(r".*_(?P<number>\d+)")
LATEST_S = 1 << 31  # of the seconds of a stamp; ticks of a microsecond last until 2041 (model.keys)


@dataclass(frozen=True)
class Message:
    """One message: its topic and type, when it was made (its header; else when it was recorded) and recorded [ns], its
    bytes, and which part of the recording it is in."""

    topic: str
    type: str
    stamp_ns: int
    received_ns: int
    raw: bytes
    part: int = 0

    @property
    def tick(self) -> int:
        """When it was made, in microseconds."""
        return self.stamp_ns // NS_PER_TICK


@dataclass(eq=False)
class Recording:
    """An open recording, of one part or several: `paths` as they were named. `topics` maps each name to its types and
    how many messages there should be. `unstamped`: those, of the read ones, whose messages have headers without a time,
    so that when they were recorded stands for it."""

    paths: tuple[Path, ...]
    topics: dict[str, tuple[tuple[str, ...], int]]
    _readers: "tuple[AnyReader, ...]"
    unstamped: set[str] = field(default_factory=set)
    _lost: dict[str, int] = field(default_factory=dict)

    @property
    def path(self) -> Path:
        """Where it is; of several parts the first."""
        return self.paths[0]

    @property
    def span_ns(self) -> tuple[int, int]:
        """When the first and the last message were recorded, as the index says."""
        return min(r.start_time for r in self._readers), max(r.end_time for r in self._readers)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """The messages of some topics in the order in which they were recorded; a part ends where its file breaks
        off."""
        yield from merge(*(self._in(part, topics) for part in range(len(self._readers))), key=lambda m: m.received_ns)

    def _in(self, part: int, topics: Collection[str]) -> Iterator[Message]:
        """The messages of one part."""
        reader = self._readers[part]
        wanted = [c for c in reader.connections if c.topic in topics]
        if not wanted:
            return
        expected, read = sum(c.msgcount for c in wanted), 0
        headed = {c.msgtype: _has_header(reader, c.msgtype) for c in wanted}
        try:
            for connection, received, raw in reader.messages(wanted):
                read += 1
                stamp = _stamp(raw, is2=reader.is2) if headed[connection.msgtype] else 0
                if headed[connection.msgtype] and not stamp:
                    self.unstamped.add(connection.topic)
                yield Message(connection.topic, connection.msgtype, stamp or received, received, bytes(raw), part)
        except (GeneratorExit, KeyboardInterrupt, InputError):
            raise
        except Exception as error:  # whatever the decoders of a damaged file raise
            self.lose(max(expected - read, 1), f"after the place where the file breaks off ({_reason(error)})")

    def decode(self, message: Message) -> Any | None:
        """A message as an object with the fields of its type; None where it cannot be decoded, which is counted."""
        try:
            return self._readers[message.part].deserialize(message.raw, message.type)
        except Exception as error:  # whatever the decoder makes of damaged bytes
            self.lose(1, f"{message.topic}: cannot be decoded as {message.type} ({_reason(error)})")
            return None

    def lose(self, count: int, reason: str) -> None:
        """Count messages that are not used."""
        self._lost[reason] = self._lost.get(reason, 0) + count

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        """What was not read so far, and why."""
        return tuple(Dropped(count, f"messages {reason}") for reason, count in self._lost.items())


def _has_header(reader: "AnyReader", type: str) -> bool:
    definition = reader.typestore.fielddefs.get(type)
    first = definition[1][0][1] if definition and definition[1] else None
    return first is not None and first[1] == "std_msgs/msg/Header"


def _stamp(raw: bytes | memoryview, *, is2: bool) -> int:
    """The stamp of a header at the beginning of a message [ns]; 0 where it has none that can be one."""
    try:
        if is2:
            order = "<" if raw[1] & 1 else ">"
            seconds, nanoseconds = struct.unpack_from(f"{order}iI", raw, 4)
        else:
            seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
    except (struct.error, IndexError):
        return 0
    return seconds * 10**9 + nanoseconds if 0 <= seconds < LATEST_S and nanoseconds < 10**9 else 0


def is_recording(path: Path) -> bool:
    """Whether a path looks like a recording: by its ending, or a folder of ROS 2."""
    return path.suffix in SUFFIXES if path.is_file() else (path / "metadata.yaml").is_file() or bool(_left(path))


@contextmanager
def opened(path: str | Path | Sequence[str | Path]) -> Iterator[Recording]:
    """A recording, or the parts of one, while it is open. Raises InputError where it cannot be read, MissingExtraError
    without `rosbags`."""
    named = [Path(path)] if isinstance(path, str | Path) else [Path(part) for part in path]
    paths = tuple(part for one in named for part in (_left(one) or (one,)))
    for part in paths:
        if paths.count(part) > 1:
            raise InputError("this part of a recording is given twice", path=part)
    with ExitStack() as open_ones:
        readers = tuple(open_ones.enter_context(_open(part)) for part in paths)
        topics: dict[str, tuple[tuple[str, ...], int]] = {}
        for connection in (c for reader in readers for c in reader.connections):
            types, count = topics.get(connection.topic, ((), 0))
            both = types if connection.msgtype in types else (*types, connection.msgtype)
            topics[connection.topic] = both, count + connection.msgcount
        yield Recording(tuple(named), topics, readers)


def _left(folder: Path) -> tuple[Path, ...]:
    """The files of a folder of ROS 2 that has no metadata.yaml, as what records it was stopped before it wrote that:
    called by one name and their numbers. Empty for any other folder."""
    if not folder.is_dir() or (folder / "metadata.yaml").exists():
        return ()
    files = [file for file in folder.iterdir() if file.suffix in (".mcap", ".db3")]
    numbers = {file: int(found["number"]) for file in files if (found := NUMBERED.fullmatch(file.stem))}
    if len(numbers) < len(files) or len({file.name.rsplit("_", 1)[0] for file in files}) != 1:
        return ()
    return tuple(sorted(files, key=lambda file: numbers[file]))


@contextmanager
def _open(path: Path) -> "Iterator[AnyReader]":
    """The reader of one file or folder, open."""
    reader = _reader(path)
    try:
        reader.open()
    except Exception as error:  # whatever the readers of a damaged file raise
        raise _unreadable(path, error) from None
    try:
        yield reader
    finally:
        reader.close()


def _reader(path: Path) -> "AnyReader":
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MissingExtraError(
            "recordings need the package rosbags; install it with `pip install teamslam[bags]`"
        ) from None
    if not path.exists():
        raise InputError("there is no such recording; check the path", path=path)
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    try:
        return AnyReader([path], default_typestore=store)
    except Exception as error:  # whatever the readers of a damaged file raise
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> InputError:
    reason = _reason(error)
    if "not indexed" in reason or "index position" in reason.lower():
        return InputError(
            "the recording was not closed and has no index; mend it with `rosbag reindex` (a .bag.active with "
            "`rosbag fix`), and try again",
            path=path,
        )
    return InputError(
        f"the recording cannot be opened ({reason}); it may be cut short or damaged. `ros2 bag reindex`, "
        f"`rosbag reindex` or `mcap recover` may save what is in it",
        path=path,
    )


def _reason(error: Exception) -> str:
    words = " ".join(in_words(str(error)).split()) or type(error).__name__
    return words if len(words) <= 120 else f"{words[:117]}..."
