"""What a team file states and nobody measured, as numbers: clocks of robots, latencies and places of cameras, focal
lengths, lines of shutters, edges of tags. Those count that the file says are uncertain, and that move some row.

A place is told by six numbers beside the stated one: X' = (T + d, Exp(w) R), d and w along the axes of the body.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from teamslam.geometry import Array, Pose, so3
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.team_file import CameraEntry, TeamFile
from teamslam.model import Unknown

TAGS, CLOCK, DRIFT, DELAY, LINE, FOCAL = "edge", "clock offset", "clock drift", "latency", "line time", "focal length"
TIMES = {
    CLOCK: (1.0, 0.02, "s", 2e-3, 0.2),
    DRIFT: (1e-4, 5e-5, "", 1e-4, 1e-3),
    DELAY: (0.5, 0.01, "s", 2e-3, 0.2),
}
"""Where nobody says: how far off they may be, a standard deviation; and as in `Unknown` useful, unit, step and most."""
PLACE = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


@dataclass(frozen=True)
class Stated:
    """One number of a team file: `what` of the names above, of which robot and camera (from 0; -1: of none)."""

    what: str
    robot: int
    camera: int
    unknown: Unknown


def stated_in(file: TeamFile, team: Sequence[Seen]) -> tuple[Stated, ...]:
    """What is uncertain in a team file of robots that saw something."""
    return tuple(_all_of(file, team))


def _all_of(file: TeamFile, team: Sequence[Seen]) -> Iterator[Stated]:
    met = {robot.entry.name for robot in team if any(tag.is_robot for view in robot.views for tag in view.tags)}
    met |= {tag.carrier for robot in team for view in robot.views for tag in view.tags if tag.is_robot}
    if file.tags.size_sigma > 0.0:
        yield Stated(TAGS, -1, -1, Unknown("all tags", TAGS, "", file.tags.size_scale, file.tags.size_sigma, 1e-4, 0.1))
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
    for axis, name in enumerate(PLACE):
        spread, unit = (sigma.xyz_m, "m") if axis < 3 else (sigma.rotation_rad, "rad")
        if spread > 0.0:
            yield Stated(name, k, j, Unknown(of, name, unit, 0.0, spread, 1e-4, 0.2))
    if sigma.focal > 0.0:
        yield Stated(FOCAL, k, j, Unknown(of, FOCAL, "", entry.focal_scale, sigma.focal, 1e-4, 0.1))


def _time(what: str, k: int, j: int, of: str, stated: float, sigma: float | None) -> Iterator[Stated]:
    """A clock or latency, of which most people state nothing; then it may be anything within reason."""
    prior, useful, unit, step, most = TIMES[what]
    clock = k + 1 if what == CLOCK else 0
    if sigma is None:
        yield Stated(what, k, j, Unknown(of, what, unit, stated, prior, step, most, useful, clock))
    elif sigma > 0.0:
        yield Stated(what, k, j, Unknown(of, what, unit, stated, sigma, step, most, 0.0, clock))


def file_with(file: TeamFile, stated: Sequence[Stated], values: Array) -> TeamFile:
    """The team file, were these numbers `values` (k,)."""
    robots = list(file.robot)
    for one, value in zip(stated, values.tolist(), strict=True):
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


def _camera_with(entry: CameraEntry, what: str, value: float) -> CameraEntry:
    if what in PLACE:
        move = np.zeros(6)
        move[PLACE.index(what)] = value
        return moved_by(entry, move)
    field = {DELAY: "delay_s", LINE: "line_s", FOCAL: "focal_scale"}[what]
    return msgspec.structs.replace(entry, **{field: value})


def moved_by(entry: CameraEntry, move: Array) -> CameraEntry:
    """A camera moved by (6,): along, and turned about, the axes of the body, where it is."""
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
    sizes = {number: tag.size_m for number, tag in file.carried().items()}
    robots = []
    for robot, entry in zip(team, file.robot, strict=True):
        views = tuple(
            replace(
                view,
                entry=camera,
                camera=view.camera.longer(camera.focal_scale / view.entry.focal_scale),
                tags=tuple(replace(tag, size_m=sizes.get(tag.number) or file.size_of(tag.number)) for tag in view.tags),
            )
            for view, camera in zip(robot.views, entry.camera, strict=True)
        )
        robots.append(replace(robot, entry=entry, views=views))
    return tuple(robots)
