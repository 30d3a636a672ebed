"""The tree of frames that was broadcast (tf): which of them move against the one above, and where those stand that do
not.

A transform stands in for a topic of odometry as `odom -> base_link`, and with the topic where that is not /tf:
`/robot1/tf: odom -> base_link`.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from teamslam.frontend.streams import Track
from teamslam.geometry import Pose
from teamslam.io.bags.poses import is_pose, poses_of, seven_of

Pair = tuple[str, str]
USUAL = "/tf"
NAMED = re.compile(r"\s*(?:(?P<topic>/\S+):\s+)?(?P<parent>\S+)\s*->\s*(?P<child>\S+)\s*")
MOVES = 1e-6  # [m, rad]: what rounding lifts


def pair_named(text: str) -> tuple[str, Pair] | None:
    """The topic and the frames (parent, child) that a text names; None where it names no transform."""
    found = NAMED.fullmatch(text)
    if found is None:
        return None
    return found["topic"] or USUAL, (found["parent"].lstrip("/"), found["child"].lstrip("/"))


def name_of(topic: str, pair: Pair) -> str:
    """The text that names a transform. Law: pair_named gives it back."""
    text = f"{pair[0]} -> {pair[1]}"
    return text if topic == USUAL else f"{topic}: {text}"


class Broadcast:
    """Transforms as they come: the stamps and poses of each pair of frames."""

    def __init__(self) -> None:
        self._heard: dict[Pair, tuple[list[int], list[list[float]]]] = {}

    def hear(self, found: Any, tick: int) -> int:
        """Take in a message that came at a tick, which stands for stamps of zero. How many of its transforms are
        none."""
        wrong = 0
        for one in found.transforms:
            seven = seven_of(one.transform.translation, one.transform.rotation)
            if not is_pose(seven):
                wrong += 1
                continue
            stamp = one.header.stamp.sec * 10**6 + one.header.stamp.nanosec // 1000
            pair = one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")
            ticks, numbers = self._heard.setdefault(pair, ([], []))
            ticks.append(stamp or tick)
            numbers.append(seven)
        return wrong

    def tracks(self) -> dict[Pair, Track]:
        """A track for each pair of frames."""
        return {
            pair: Track(np.array(ticks, np.int64), poses_of(numbers), *pair)
            for pair, (ticks, numbers) in self._heard.items()
        }


def moves(track: Track) -> bool:
    """Whether a frame moves against the one above it."""
    return len(track) > 1 and bool(np.abs(track.poses.minus(track.poses[0])).max() > MOVES)


def driven(tracks: Mapping[Pair, Track]) -> list[Pair]:
    """The transforms that say how robots moved: of frames that move in one called after odometry, or else in one that
    nothing moves; what turns on a robot moves in one that moves."""
    moving = [pair for pair, track in tracks.items() if moves(track)]
    moved = {child for _, child in moving}
    odometry = [pair for pair in moving if "odom" in pair[0].rsplit("/", 1)[-1].lower()]
    return odometry or [pair for pair in moving if pair[0] not in moved]


def body_of(tracks: Mapping[Pair, Track], frame: str) -> str:
    """The frame that all stands in, along transforms that do not move, which a frame stands in; itself, where that
    stands in none."""
    above = {child: parent for (parent, child), track in tracks.items() if not moves(track)}
    here, passed = frame.lstrip("/"), set[str]()
    while here in above and here not in passed:
        passed.add(here)
        here = above[here]
    return here


def standing_in(tracks: Mapping[Pair, Track], above: str, below: str) -> Pose | None:
    """Where a frame is in another, along transforms that do not move, up or down; None where none lead there."""
    above, below = above.lstrip("/"), below.lstrip("/")
    found = {above: Pose(np.eye(3), np.zeros(3))}
    fixed = {pair: track.poses[0] for pair, track in tracks.items() if not moves(track)}
    left = [above]
    while left:
        here = left.pop()
        for other, pose in _beside(fixed, here):
            if other not in found:
                found[other] = found[here] @ pose
                left.append(other)
    return found.get(below)


def _beside(fixed: Mapping[Pair, Pose], here: str) -> Iterator[tuple[str, Pose]]:
    for (parent, child), pose in fixed.items():
        if parent == here:
            yield child, pose
        elif child == here:
            yield parent, pose.inverse()
