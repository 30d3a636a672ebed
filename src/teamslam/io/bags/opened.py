"""A recording, open: its topics, and its messages one after another, whatever the file is.

Messages come raw and are decoded when somebody wants to know more than their stamp: the stamp of a message that begins
with a header is read from its first bytes. What cannot be read is counted (`Recording.dropped`): a message that does
not decode by itself, and everything after the place where the file breaks off.
"""

import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.errors import InputError, MissingExtraError, in_words
from teamslam.io.bags.roles import DEFINITIONS
from teamslam.model import Dropped

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".mcap", ".db3")
NS_PER_TICK = 1000
LATEST_S = 1 << 31  # of the seconds of a stamp; ticks of a microsecond last until 2041 (model.keys)


@dataclass(frozen=True)
class Message:
    """One message: its topic and type, when it was made (its header; else when it was recorded) and recorded [ns], and
    its bytes."""

    topic: str
    type: str
    stamp_ns: int
    received_ns: int
    raw: bytes

    @property
    def tick(self) -> int:
        """When it was made, in microseconds."""
        return self.stamp_ns // NS_PER_TICK


@dataclass(eq=False)
class Recording:
    """An open recording. `topics` maps each name to its types and how many messages there should be."""

    path: Path
    topics: dict[str, tuple[tuple[str, ...], int]]
    _reader: "AnyReader"
    _lost: dict[str, int] = field(default_factory=dict)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """The messages of some topics in the order in which they were recorded; ends where the file breaks off."""
        wanted = [c for c in self._reader.connections if c.topic in topics]
        if not wanted:
            return
        expected, read = sum(c.msgcount for c in wanted), 0
        headed = {c.msgtype: self._has_header(c.msgtype) for c in wanted}
        try:
            for connection, received, raw in self._reader.messages(wanted):
                read += 1
                stamp = self._stamp(raw) if headed[connection.msgtype] else 0
                yield Message(connection.topic, connection.msgtype, stamp or received, received, bytes(raw))
        except (GeneratorExit, KeyboardInterrupt, InputError):
            raise
        except Exception as error:  # whatever the decoders of a damaged file raise
            self.lose(max(expected - read, 1), f"after the place where the file breaks off ({_reason(error)})")

    def decode(self, message: Message) -> Any | None:
        """A message as an object with the fields of its type; None where it cannot be decoded, which is counted."""
        try:
            return self._reader.deserialize(message.raw, message.type)
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

    def _has_header(self, type: str) -> bool:
        definition = self._reader.typestore.fielddefs.get(type)
        first = definition[1][0][1] if definition and definition[1] else None
        return first is not None and first[1] == "std_msgs/msg/Header"

    def _stamp(self, raw: bytes | memoryview) -> int:
        """The stamp of a header at the beginning of a message [ns]; 0 where it has none that can be one."""
        try:
            if self._reader.is2:
                order = "<" if raw[1] & 1 else ">"
                seconds, nanoseconds = struct.unpack_from(f"{order}iI", raw, 4)
            else:
                seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
        except (struct.error, IndexError):
            return 0
        return seconds * 10**9 + nanoseconds if 0 <= seconds < LATEST_S and nanoseconds < 10**9 else 0


def is_recording(path: Path) -> bool:
    """Whether a path looks like a recording: by its ending, or a folder with the metadata of ROS 2."""
    return path.suffix in SUFFIXES if path.is_file() else (path / "metadata.yaml").is_file()


@contextmanager
def opened(path: str | Path) -> Iterator[Recording]:
    """A recording while it is open. Raises InputError where it cannot be read, MissingExtraError without `rosbags`."""
    path = Path(path)
    reader = _reader(path)
    try:
        reader.open()
    except Exception as error:  # whatever the readers of a damaged file raise
        raise _unreadable(path, error) from None
    try:
        topics: dict[str, tuple[tuple[str, ...], int]] = {}
        for connection in reader.connections:
            types, count = topics.get(connection.topic, ((), 0))
            both = types if connection.msgtype in types else (*types, connection.msgtype)
            topics[connection.topic] = both, count + connection.msgcount
        yield Recording(path, topics, reader)
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
