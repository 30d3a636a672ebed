"""A robot's tags in its images as tables of the model `corners`, of landmarks and of other robots.

An image belongs to the last keyframe that is not after it, and a line of a rolling shutter is read a little before or
after the image's instant, which is that of its middle line. What was seen late is put where it would have been seen at
the keyframe's instant (`frontend.tags.late`).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from teamslam.frontend.stamps import keyframe_of
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.late import Motion
from teamslam.frontend.tags.rows import LOOKING, corner_rows
from teamslam.frontend.way import moved
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.team_file import TeamFile
from teamslam.model import Loss, Table, landmark_key, landmark_number, pose_key

SOURCES = ("landmarks", "robots")


def sightings_of(robot: Seen, team: Sequence[Seen], keyframes: Mapping[int, IntArray], file: TeamFile) -> list[Table]:
    """A robot's sightings, a table for each camera and source. Robots are numbered from 1 in the order of `team`, and
    have keyframes [ticks] by number; `robot` may be one of them with its tags renamed."""
    numbers = {other.entry.name: k for k, other in enumerate(team, 1)}
    number = numbers[robot.entry.name]
    tables: list[Table] = []
    first = dict.fromkeys(SOURCES, 0)
    loss = Loss(file.tags.loss, file.tags.loss_scale)
    for view in robot.used().views:
        sensor = view.entry.pose @ LOOKING
        for source in SOURCES:
            part = view.select(np.array([tag.is_robot == (source == "robots") for tag in view.tags], bool))
            if not len(part.corners):
                continue
            observers = keyframe_of(keyframes[number], part.ticks)
            carriers = np.array([numbers[tag.carrier] if tag.is_robot else 0 for tag in part.tags])
            targets = part.ticks.copy()
            for other in np.unique(carriers[carriers > 0]).tolist():
                targets[carriers == other] = keyframe_of(keyframes[other], part.ticks[carriers == other])
            motion = _motion(part, number, observers, carriers, targets, team)
            values, white, good = corner_rows(
                part.corners, part.camera, list(part.tags), part.entry.floor_px, part.entry.edge_px, motion
            )
            keys = np.stack([pose_key(number, observers), _keys_of(part, carriers, targets)], -1)
            ids = first[source] + np.arange(len(values))
            first[source] += len(values)
            tables.append(
                Table(number, source, "corners", 3, keys[good], values[good], white[good], ids[good], sensor, loss)
            )
    return tables


def _keys_of(view: View, carriers: IntArray, targets: IntArray) -> IntArray:
    """What each tag stands for: the pose of a robot at its keyframe, or a landmark."""
    return np.array([
        pose_key(other, tick) if other else landmark_key(landmark_number(tag.carrier))
        for tag, other, tick in zip(view.tags, carriers.tolist(), targets.tolist(), strict=True)
    ], np.int64)  # fmt: skip


def _motion(
    view: View, number: int, observers: IntArray, carriers: IntArray, targets: IntArray, team: Sequence[Seen]
) -> Motion | None:
    """How eye and carriers moved from their keyframes until each corner was seen, as far as odometry says; None where
    all were seen there."""
    late = _late(view, observers, team[number - 1])
    moving = {other: _late(view, targets, team[other - 1]) for other in np.unique(carriers[carriers > 0]).tolist()}
    if not late.any() and not any(times[carriers == other].any() for other, times in moving.items()):
        return None
    body = Pose.identity(3, late.shape)
    rotation, translation = body.rotation.copy(), body.translation.copy()
    for other, times in moving.items():
        rows = carriers == other
        way = _moved(team[other - 1], targets[rows], times[rows])
        rotation[rows], translation[rows] = way.rotation, way.translation
    sensor = view.entry.pose @ LOOKING
    eye = sensor.inverse() @ _moved(team[number - 1], observers, late) @ sensor
    return Motion(eye, Pose(rotation, translation))


def _late(view: View, instants: IntArray, mover: Seen) -> Array:
    """How long after a mover's instants [ticks] (m,) each corner (m, 4) was seen [s]; 0 where nothing tells how it
    moved meanwhile."""
    seen = (view.ticks - instants)[:, None] / TICKS_PER_S + view.line_late_s
    return np.zeros_like(seen) if mover.track is None else np.asarray(seen)


def _moved(mover: Seen, ticks: IntArray, over_s: Array) -> Pose:
    """How a robot moved; not at all without odometry."""
    if mover.track is None:
        return Pose.identity(3, over_s.shape)
    return moved(mover.track, ticks, over_s, mover.entry.motion)
