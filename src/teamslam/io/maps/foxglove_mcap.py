"""Maps for Foxglove (.mcap, with Foxglove's own schemas in protobuf): a file a map.

    /robots/NAME    foxglove.FrameTransform a pose, from `map` to the robot's name, at its stamp
    /ways           foxglove.SceneUpdate: each robot's way as a line
    /landmarks      foxglove.SceneUpdate: each landmark as the ball of its 95 % region, with its name

Stamps are those of the log; of logs that count poses, a pose is a second. Scenes are at the first of them.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.whole import whole_file
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.space import Balls, Course, balls, courses
from teamslam.model import Dropped

FRAME = "map"
LANDMARK = (0.48, 0.12, 0.36)
POINT = 0.004  # of a map's size: how large a landmark is drawn whose covariance is not known
LATEST_S = 2**32 - 1  # that a stamp of Foxglove holds


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: its poses and places read back. InputError where the package
    foxglove-sdk is not installed, or a stamp is none that it knows."""
    try:
        import foxglove
        from foxglove import messages
    except ImportError:
        raise InputError("writing .mcap needs foxglove; install it with `pip install teamslam[foxglove]`") from None
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        ways = list(courses(found))
        start_s = _checked(ways)
        context = foxglove.Context()
        with whole_file(file) as out, foxglove.open_mcap(out, context=context):
            scene = _Scene(messages, foxglove.channels, context, start_s)
            scene.ways(ways)
            scene.landmarks(balls(found), _size(found))
            for course in ways:
                scene.transforms(course)
    poses = sum(len(course.stamps_s) for found in maps for course in courses(found))
    return (Dropped(poses, "covariances of poses: not drawn in Foxglove's scenes"),) if poses else ()


def _checked(ways: Sequence[Course]) -> float:
    """The first stamp."""
    stamps = np.concatenate([np.zeros(0), *(course.stamps_s for course in ways)])
    if len(stamps) and not (stamps.min() >= 0.0 and stamps.max() <= LATEST_S):
        raise InputError(f"Foxglove holds stamps from 0 to {LATEST_S} s, found {stamps.min():g} to {stamps.max():g}")
    return float(stamps.min()) if len(stamps) else 0.0


def _size(found: MapEstimate) -> float:
    places = found.values.positions(found.values.layout.keys, 3)
    return float(np.ptp(places, axis=0).max() or 1.0)


class _Scene:
    """A file that is being written: messages, in the words of Foxglove."""

    def __init__(self, messages: Any, channels: Any, context: Any, start_s: float) -> None:
        self.messages, self.channels, self.context, self.start_s = messages, channels, context, start_s

    def ways(self, ways: Sequence[Course]) -> None:
        """Each robot's way as a line."""
        m = self.messages
        lines = [
            (
                f"way of {course.robot}",
                {
                    "lines": [
                        m.LinePrimitive(
                            type=m.LinePrimitiveLineType.LineStrip,
                            thickness=2.0,
                            scale_invariant=True,
                            points=[m.Point3(x=x, y=y, z=z) for x, y, z in course.poses.translation.tolist()],
                            color=self._colour(course.colour, 1.0),
                        )
                    ]
                },
            )
            for course in ways
        ]
        self._update("/ways", lines)

    def landmarks(self, seen: Balls, extent: float) -> None:
        """Each landmark as a ball with its name."""
        m = self.messages
        known = len(seen.half_axes) > 0
        axes = seen.half_axes if known else np.full((len(seen.places), 3), POINT * extent)
        turns = seen.turns.quaternion_wxyz() if known else np.tile([1.0, 0.0, 0.0, 0.0], (len(seen.places), 1))
        entities = []
        for name, place, half, turn in zip(seen.names, seen.places, axes, turns, strict=True):
            ball = m.SpherePrimitive(
                pose=self._pose(place, turn), size=self._vector(2.0 * half), color=self._colour(LANDMARK, 0.5)
            )
            text = m.TextPrimitive(
                pose=self._pose(place, turn), billboard=True, font_size=12.0, scale_invariant=True,
                color=self._colour(LANDMARK, 1.0), text=name,
            )  # fmt: skip
            entities.append((f"landmark {name}", {"spheres": [ball], "texts": [text]}))
        self._update("/landmarks", entities)

    def transforms(self, course: Course) -> None:
        """Where a robot is, at each of its stamps."""
        m = self.messages
        channel = self.channels.FrameTransformChannel(topic=f"/robots/{course.robot}", context=self.context)
        rows = zip(course.stamps_s.tolist(), course.poses.translation, course.poses.quaternion_wxyz(), strict=True)
        for stamp_s, place, turn in rows:
            transform = m.FrameTransform(
                timestamp=self._stamp(stamp_s), parent_frame_id=FRAME, child_frame_id=course.robot,
                translation=self._vector(place), rotation=self._turn(turn),
            )  # fmt: skip
            channel.log(transform, log_time=_nanoseconds(stamp_s))

    def _update(self, topic: str, entities: Sequence[tuple[str, dict[str, Any]]]) -> None:
        m, stamp = self.messages, self._stamp(self.start_s)
        made = [m.SceneEntity(timestamp=stamp, frame_id=FRAME, id=name, **parts) for name, parts in entities]
        channel = self.channels.SceneUpdateChannel(topic=topic, context=self.context)
        channel.log(m.SceneUpdate(entities=made), log_time=_nanoseconds(self.start_s))

    def _stamp(self, stamp_s: float) -> Any:
        seconds, rest = divmod(_nanoseconds(stamp_s), 10**9)
        return self.messages.Timestamp(sec=seconds, nsec=rest)

    def _pose(self, place: Array, turn: Array) -> Any:
        return self.messages.Pose(position=self._vector(place), orientation=self._turn(turn))

    def _turn(self, wxyz: Array) -> Any:
        w, x, y, z = wxyz.tolist()
        return self.messages.Quaternion(x=x, y=y, z=z, w=w)

    def _vector(self, vector: Array) -> Any:
        x, y, z = vector.tolist()
        return self.messages.Vector3(x=x, y=y, z=z)

    def _colour(self, colour: Sequence[float], alpha: float) -> Any:
        return self.messages.Color(r=colour[0], g=colour[1], b=colour[2], a=alpha)


def _nanoseconds(stamp_s: float) -> int:
    return round(stamp_s * 1e9)
