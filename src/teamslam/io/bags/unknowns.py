"""What a team file states and nobody measured, as numbers: clocks of robots, latencies and places of cameras, focal
lengths and centres, lines of shutters, places of tags on bodies, edges of tags. Those count that the file says are
uncertain, and that move some row.

A place is told by six numbers beside the stated one: X' = (T + d, Exp(w) R), d and w along the axes of the body.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import is_
from typing import TypeVar

import msgspec
import numpy as np

from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.rows import Tag
from teamslam.geometry import Array, Pose, so3
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.team_file import CameraEntry, CarriedTag, LandmarkEntry, Placed, RobotEntry, TeamFile
from teamslam.model import Unknown

TAGS, CLOCK, DRIFT, DELAY, LINE, FOCAL = "edge", "clock offset", "clock drift", "latency", "line time", "focal length"
TIMES = {
    CLOCK: (1.0, 0.02, "s", 2e-3, 0.2),
    DRIFT: (1e-4, 5e-5, "", 1e-4, 1e-3),
    DELAY: (0.5, 0.01, "s", 2e-3, 0.2),
}
"""Where nobody says: how far off they may be, a standard deviation; and as in `Unknown` useful, unit, step and most."""
PLACE = ("x", "y", "z", "turn about x", "turn about y", "turn about z")
CENTRE = ("centre to the right", "centre down")
Body = TypeVar("Body", bound=Placed)
Carrier = TypeVar("Carrier", RobotEntry, LandmarkEntry)


@dataclass(frozen=True)
class Stated:
    """One number of a team file: `what` of the names above, of which robot and camera (from 0; -1: of none), or of
    which `tag` on a body."""

    what: str
    robot: int
    camera: int
    unknown: Unknown
    tag: int | None = None


def stated_in(file: TeamFile, team: Sequence[Seen]) -> tuple[Stated, ...]:
    """What is uncertain in a team file of robots that saw something."""
    return tuple(_all_of(file, team))


def _all_of(file: TeamFile, team: Sequence[Seen]) -> Iterator[Stated]:
    met = {robot.entry.name for robot in team if any(tag.is_robot for view in robot.views for tag in view.tags)}
    met |= {tag.carrier for robot in team for view in robot.views for tag in view.tags if tag.is_robot}
    if file.tags.size_sigma > 0.0:
        yield Stated(TAGS, -1, -1, Unknown("all tags", TAGS, "", file.tags.size_scale, file.tags.size_sigma, 1e-4, 0.1))
    seen = {tag.number for robot in team for view in robot.views for tag in view.tags}
    for carrier, _, tag in file.bodies():
        if tag.number in seen:
            yield from _of_tag(carrier, tag)
    for k, robot in enumerate(team):
        name, clock = robot.entry.name, robot.entry.clock
        if k and robot.track is not None and name in met:
            yield from _time(CLOCK, k, -1, name, clock.offset_s, clock.offset_sigma_s)
            yield from _time(DRIFT, k, -1, name, clock.drift, clock.drift_sigma)
        for j, view in enumerate(robot.views):
            if len(view.corners):
                yield from _of_camera(k, j, robot, view)


def _of_camera(k: int, j: int, robot: Seen, view: View) -> Iterator[Stated]:
    entry, sigma, of = view.entry, view.entry.sigma, f"{robot.entry.name}, {view.entry.name}"
    if robot.track is not None:
        yield from _time(DELAY, k, j, of, entry.delay_s, sigma.delay_s)
        if sigma.line_s > 0.0:
            yield Stated(LINE, k, j, Unknown(of, LINE, "s", entry.line_s, sigma.line_s, 1e-6, 1e-4))
    for name, unknown in _place(of, sigma.xyz_m, sigma.rotation_rad):
        yield Stated(name, k, j, unknown)
    if sigma.focal > 0.0:
        yield Stated(FOCAL, k, j, Unknown(of, FOCAL, "", entry.focal_scale, sigma.focal, 1e-4, 0.1))
    if sigma.centre_px > 0.0:
        for name, stated in zip(CENTRE, entry.centre_px, strict=True):
            yield Stated(name, k, j, Unknown(of, name, "px", stated, sigma.centre_px, 0.01, 20.0))


def _of_tag(carrier: str, tag: CarriedTag) -> Iterator[Stated]:
    of, sigma = f"tag {tag.number} on {carrier}", tag.sigma
    for name, unknown in _place(of, sigma.xyz_m, sigma.rotation_rad):
        yield Stated(name, -1, -1, unknown, tag.number)
    if sigma.edge > 0.0:
        yield Stated(TAGS, -1, -1, Unknown(of, TAGS, "", 1.0, sigma.edge, 1e-4, 0.1), tag.number)


def _place(of: str, xyz_m: float, rotation_rad: float) -> Iterator[tuple[str, Unknown]]:
    """How far a place is from the stated one, each number known so well."""
    for axis, name in enumerate(PLACE):
        spread, unit = (xyz_m, "m") if axis < 3 else (rotation_rad, "rad")
        if spread > 0.0:
            yield name, Unknown(of, name, unit, 0.0, spread, 1e-4, 0.2)


def _time(what: str, k: int, j: int, of: str, stated: float, sigma: float | None) -> Iterator[Stated]:
    """A clock or latency, of which most people state nothing; then it may be anything within reason."""
    prior, useful, unit, step, most = TIMES[what]
    clock, drift = (k + 1 if what == one else 0 for one in (CLOCK, DRIFT))
    if sigma is None:
        yield Stated(what, k, j, Unknown(of, what, unit, stated, prior, step, most, useful, clock, drift))
    elif sigma > 0.0:
        yield Stated(what, k, j, Unknown(of, what, unit, stated, sigma, step, most, 0.0, clock, drift))


def file_with(file: TeamFile, stated: Sequence[Stated], values: Array) -> TeamFile:
    """The team file, were these numbers `values` (k,)."""
    robots = list(file.robot)
    for one, value in zip(stated, values.tolist(), strict=True):
        if one.tag is not None:
            robots = [_carrying(robot, one, value, file) for robot in robots]
            file = msgspec.structs.replace(file, landmark=[_carrying(mark, one, value, file) for mark in file.landmark])
            continue
        if one.what == TAGS:
            file = msgspec.structs.replace(file, tags=msgspec.structs.replace(file.tags, size_scale=value))
            continue
        robot = robots[one.robot]
        if one.what in (CLOCK, DRIFT):
            field = {CLOCK: "offset_s", DRIFT: "drift"}[one.what]
            robots[one.robot] = msgspec.structs.replace(
                robot, clock=msgspec.structs.replace(robot.clock, **{field: value})
            )
            continue
        cameras = list(robot.camera)
        cameras[one.camera] = _camera_with(cameras[one.camera], one.what, value)
        robots[one.robot] = msgspec.structs.replace(robot, camera=cameras)
    return msgspec.structs.replace(file, robot=robots)


def _carrying(body: Carrier, one: Stated, value: float, file: TeamFile) -> Carrier:
    """A body with a number of one of its tags, if it carries it."""
    if all(tag.number != one.tag for tag in body.tag):
        return body
    tags = [_tag_with(tag, one.what, value, file) if tag.number == one.tag else tag for tag in body.tag]
    return msgspec.structs.replace(body, tag=tags)


def _tag_with(tag: CarriedTag, what: str, value: float, file: TeamFile) -> CarriedTag:
    if what in PLACE:
        return moved_by(tag, _move(what, value))
    return msgspec.structs.replace(tag, size_m=value * file.stated_size_of(tag))


def _camera_with(entry: CameraEntry, what: str, value: float) -> CameraEntry:
    if what in PLACE:
        return moved_by(entry, _move(what, value))
    if what in CENTRE:
        centre = [*entry.centre_px]
        centre[CENTRE.index(what)] = value
        return msgspec.structs.replace(entry, centre_px=tuple(centre))
    field = {DELAY: "delay_s", LINE: "line_s", FOCAL: "focal_scale"}[what]
    return msgspec.structs.replace(entry, **{field: value})


def _move(what: str, value: float) -> Array:
    move = np.zeros(6)
    move[PLACE.index(what)] = value
    return move


def moved_by(entry: Body, move: Array) -> Body:
    """A camera or a tag moved by (6,): along, and turned about, the axes of the body, where it is."""
    pose = entry.pose
    there = Pose(so3.exp(move[3:]) @ pose.rotation, pose.translation + move[:3])
    return msgspec.structs.replace(
        entry,
        xyz_m=tuple(there.translation.tolist()),
        quaternion_wxyz=tuple(there.quaternion_wxyz().tolist()),
        rotation_vector=None,
    )


def team_with(team: Sequence[Seen], file: TeamFile) -> tuple[Seen, ...]:
    """What a team saw, by the numbers of another team file of the same robots, cameras and tags."""
    carried = file.carried()
    robots = []
    for robot, entry in zip(team, file.robot, strict=True):
        views = tuple(
            replace(
                view,
                entry=camera,
                camera=_seeing(view, camera),
                tags=_tags_with(view.tags, carried, file),
            )
            for view, camera in zip(robot.views, entry.camera, strict=True)
        )
        robots.append(replace(robot, entry=entry, views=views))
    return tuple(robots)


def _seeing(view: View, entry: CameraEntry) -> Camera:
    """The lens of a camera as another entry of it has it."""
    shift = np.subtract(entry.centre_px, view.entry.centre_px).tolist()
    return view.camera.longer(entry.focal_scale / view.entry.focal_scale).shifted(*shift)


def _tags_with(tags: tuple[Tag, ...], carried: Mapping[int, Tag], file: TeamFile) -> tuple[Tag, ...]:
    """Tags as a team file has them: the very same where nothing of them changes, each and all together."""
    instead = {id(tag): _tag_as(tag, carried.get(tag.number), file) for tag in tags}
    out = tuple(instead[id(tag)] for tag in tags)
    return tags if all(map(is_, out, tags)) else out


def _tag_as(tag: Tag, carried: Tag | None, file: TeamFile) -> Tag:
    size, pose = (file.size_of(tag.number), tag.pose) if carried is None else (carried.size_m, carried.pose)
    return tag if size == tag.size_m and _same(pose, tag.pose) else replace(tag, size_m=size, pose=pose)


def _same(one: Pose | None, other: Pose | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.rotation, other.rotation) and np.array_equal(one.translation, other.translation)
