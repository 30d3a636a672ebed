"""What a recording holds: each topic with its type, how many messages, how often, and where they are missing.

The rate is one over the median step between stamps. A gap is a step of more than GAP times the median; a step back is
a stamp before the one recorded before it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.geometry import Array
from teamslam.io.bags.opened import Message, Recording, opened
from teamslam.io.bags.roles import ROLES, TRUTH
from teamslam.io.bags.streams import hear
from teamslam.io.bags.tree import Broadcast, Pair, driven, name_of
from teamslam.model import Dropped

GAP = 5.0
SECOND_NS = 1_000_000_000
HEARD = 200  # messages of transforms that are looked at where there is odometry
LEVEL = 1e-6  # [m], and of a quaternion: what rounding lifts


@dataclass(frozen=True, eq=False)
class TopicContents:
    """One topic: its name, types, role (see ROLES; '' for what teamslam does not use), and `stamps_s` (n,) as they
    came. `frames` are the names in its headers: (parent, child), '' where there are none. `planar`: an odometry that
    never leaves the plane, looked at once a second. `late_s`: by how much its stamps are later than when its messages
    were recorded, most of the time."""

    name: str
    types: tuple[str, ...]
    role: str
    stamps_s: Array
    frames: tuple[str, str] = ("", "")
    planar: bool = False
    late_s: float = 0.0

    @property
    def steps_s(self) -> Array:
        """From each message to the next (n - 1,) [s]."""
        return np.diff(self.stamps_s)

    @property
    def rate_hz(self) -> float:
        """How often, usually; NaN for fewer than two messages."""
        step = float(np.median(self.steps_s)) if len(self.stamps_s) > 1 else 0.0
        return 1.0 / step if step > 0.0 else float("nan")

    @property
    def gaps_s(self) -> Array:
        """The steps that are gaps [s]."""
        return np.asarray(self.steps_s[self.steps_s * self.rate_hz > GAP])

    @property
    def steps_back(self) -> int:
        """How many stamps are earlier than the one before."""
        return int(np.count_nonzero(self.steps_s < 0.0))


@dataclass(frozen=True, eq=False)
class Contents:
    """A recording looked over: where it is, or its parts, its topics by name, what could not be read, and the
    transforms that were broadcast (beside odometry, the first of them). Without a topic of odometry the transforms that
    say how robots moved stand among the topics, as odometry."""

    paths: tuple[Path, ...]
    topics: tuple[TopicContents, ...]
    dropped: tuple[Dropped, ...]
    transforms: Mapping[Pair, Track]

    @property
    def start_s(self) -> float:
        """The earliest stamp [s]; NaN for an empty recording."""
        return min((float(t.stamps_s.min()) for t in self.topics if len(t.stamps_s)), default=float("nan"))

    @property
    def stop_s(self) -> float:
        """The latest stamp [s]."""
        return max((float(t.stamps_s.max()) for t in self.topics if len(t.stamps_s)), default=float("nan"))

    def of_role(self, role: str) -> list[TopicContents]:
        """The topics that are for one thing, those without a message left out."""
        return [topic for topic in self.topics if topic.role == role and len(topic.stamps_s)]


def contents(path: str | Path | Sequence[str | Path]) -> Contents:
    """Look a recording over, or the parts of one; every message is read once and none is decoded but the first of a
    topic, of odometry one a second, and transforms. Raises InputError where it cannot be opened."""
    with opened(path) as recording:
        stamps: dict[str, list[int]] = {topic: [] for topic in recording.topics}
        late: dict[str, list[int]] = {topic: [] for topic in recording.topics}
        frames: dict[str, tuple[str, str]] = {}
        looks: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        heard: dict[str, Broadcast] = {}
        moved = any(
            ROLES.get(types[0]) == "odometry" and count and not TRUTH.search(name)
            for name, (types, count) in recording.topics.items()
        )
        for message in recording.messages(recording.topics):
            role = ROLES.get(message.type)
            stamps[message.topic].append(message.stamp_ns)
            late[message.topic].append(message.stamp_ns - message.received_ns)
            if message.topic not in frames:
                frames[message.topic] = _frames(recording, message)
            if role == "odometry":
                looked = looks.setdefault(message.topic, [])
                if not looked or abs(message.stamp_ns - looked[-1][0]) >= SECOND_NS:
                    looked.append((message.stamp_ns, _off_plane(recording, message)))
            elif role == "transforms" and not (moved and len(stamps[message.topic]) > HEARD):
                hear(recording, heard.setdefault(message.topic, Broadcast()), message)
        topics = [
            TopicContents(
                name,
                types,
                ROLES.get(types[0], ""),
                np.array(stamps[name], float) * 1e-9,
                frames.get(name, ("", "")),
                _planar([off for _, off in looks.get(name, ())]),
                float(np.median(late[name])) * 1e-9 if late[name] else 0.0,
            )
            for name, (types, _) in sorted(recording.topics.items())
        ]
        transforms = {name: broadcast.tracks() for name, broadcast in heard.items()}
        together = {pair: track for tracks in transforms.values() for pair, track in tracks.items()}
        if not moved:
            topics += [
                TopicContents(
                    name_of(name, pair),
                    (f"a transform of {name}",),
                    "odometry",
                    tracks[pair].ticks / TICKS_PER_S,
                    pair,
                    _planar(_off_planes(tracks[pair])),
                )
                for name, tracks in sorted(transforms.items())
                for pair in driven(tracks)
            ]
        return Contents(recording.paths, tuple(topics), recording.dropped, together)


def _off_planes(track: Track) -> list[tuple[float, ...]]:
    """Of each pose of a track what `_off_plane` tells of a message."""
    return [
        (height, x, y)
        for height, (_, x, y, _) in zip(track.poses.translation[:, 2], track.poses.quaternion_wxyz(), strict=True)
    ]


def _off_plane(recording: Recording, message: Message) -> tuple[float, ...]:
    """The height of an odometry's pose, and the part of its quaternion that is no turn about the vertical."""
    found = recording.decode(message)
    if found is None:  # damaged
        return np.nan, np.nan, np.nan
    pose = found.pose.pose
    return float(pose.position.z), float(pose.orientation.x), float(pose.orientation.y)


def _planar(off: list[tuple[float, ...]]) -> bool:
    """Whether poses, two at least, lie at one height and upright, to rounding."""
    if len(off) < 2:
        return False
    height, *tilt = np.array(off).T
    return bool(np.ptp(height) <= LEVEL and np.abs(tilt).max() <= LEVEL)


def _frames(recording: Recording, message: Message) -> tuple[str, str]:
    """The names of frames in a message's header, where its type is one that teamslam uses."""
    if ROLES.get(message.type, "transforms") == "transforms":
        return "", ""
    found = recording.decode(message)
    return str(getattr(getattr(found, "header", None), "frame_id", "")), str(getattr(found, "child_frame_id", ""))
