"""The virtual lab's robots and room without images: corners where the lens would have them, with the noise that is
stated, and clocks, latencies and cameras that are off by what a test plants.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from teamslam.cli.film import EDGE_PX, team_of
from teamslam.frontend.streams import TICKS_PER_S, TagCorners
from teamslam.frontend.tags.depth import TagDepths, depths_on
from teamslam.frontend.tags.noise import corner_covariances
from teamslam.geometry import Pose
from teamslam.io.bags.first_guess import first_guess, looks_of
from teamslam.io.bags.seen import Book, Seen, View
from teamslam.io.bags.team import Recordings
from teamslam.io.bags.unknowns import stated_in
from teamslam.sim.film import PRESETS, film
from teamslam.sim.film.ranging import ranged
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.shutter import Shutter
from teamslam.sim.film.stage import CAMERA, FACE_TAG_M, TAG_M
from teamslam.sim.film.takes import START_TICK

HALF = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


@dataclass
class Planted:
    """What the team file states otherwise; clocks are those of the film."""

    camera: Pose = field(default_factory=lambda: CAMERA)  # where it truly is; the team file says CAMERA
    focal: float = 1.0  # longer than the calibration says
    size: float = 1.0  # larger than the team file says
    centre: tuple[float, float] = (0.0, 0.0)  # farther right and down than the calibration says [pixels]
    faces: dict[int, Pose] = field(default_factory=dict)  # where tags on cubes truly are; the team file says otherwise
    edges: dict[int, float] = field(default_factory=dict)  # longer than the team file says, by tag
    line_s: float = 0.0


def filmed(seed=0, seconds=60.0, images_hz=5.0, planted=None, noise=1.0, preset="clocks", deep=False):
    """What the two robots of a film recorded, as `Recordings` without a file, and the film; `deep`: with depths."""
    planted = planted or Planted()
    made = film(replace(PRESETS[preset], seconds=seconds, images_hz=images_hz), seed)
    file = team_of(made, "")
    rng = np.random.default_rng([seed, 77])
    seen = []
    for k in made.robots:
        entry = file.robot[k]
        corners = _corners(made, k, planted, rng, noise)
        entry = replaced(entry, camera=[replaced(entry.camera[0], line_s=planted.line_s)])
        view = View(
            entry.camera[0], made.options.camera, corners, depths=_depths(made, k, corners, planted) if deep else None
        )
        seen.append(Seen(entry, made.odometry(k), made.truth(k), (view,), ()))
    return seen, replaced(file, robot=[robot.entry for robot in seen]), made


def read(seen, file, path="memory"):
    """The log of what was recorded, as reading a team file gives it."""
    told = tuple(robot.with_tags(file, Book()) for robot in seen)
    recordings = Recordings(file, path, told, stated_in(file, told), (), ())
    return recordings.log(first_guess(told, recordings.stated, looks_of(told)))


def replaced(record, **fields):
    """A record of a team file with other fields."""
    return type(record)(**{name: getattr(record, name) for name in record.__struct_fields__} | fields)


def _corners(made, robot, planted, rng, noise):
    other = 1 - robot
    lens = made.options.camera.longer(planted.focal).shifted(*planted.centre)
    frames, frame, ids, corners = [], [], [], []
    for t in made.stamps_s.tolist():
        late = made.clocks.latency(robot)
        frames.append(int(made.clock(robot).own(START_TICK + np.array([round((t + late) * TICKS_PER_S)]))[0]))
        for number, size, place in _tags(made, other, planted):
            size *= planted.size * planted.edges.get(number, 1.0)
            pixels = _seen(made, robot, t, number, size, place, lens, planted)
            if pixels is None:
                continue
            root = np.linalg.cholesky(corner_covariances(pixels[None], 0.0, EDGE_PX)[0])  # as the film's team file says
            frame.append(len(frames) - 1)
            ids.append(number)
            corners.append(pixels + noise * (root @ rng.normal(size=8)).reshape(4, 2))
    n = len(ids)
    return TagCorners(
        np.array(frames), np.array(frame), np.array(ids), np.array(corners), np.zeros(n, int), ("tag36h11",) * n
    )


def _depths(made, robot, corners, planted):
    """What the film's sensor of depth says of the tags."""
    renderer = Renderer(made.stage, made.options.camera, Shutter(line_s=planted.line_s))
    parts = []
    for frame in np.unique(corners.frame).tolist():
        rng = np.random.default_rng([made.seed, 4, robot, frame])
        depth = ranged(renderer.depth(robot, float(made.stamps_s[frame])), made.options.ranger, rng)
        parts.append(depths_on(1e-3 * depth, corners.corners[corners.frame == frame]))
    return TagDepths.together(parts)


def _tags(made, other, planted):
    for number, pose in made.stage.walls.items():
        yield number, TAG_M, lambda t, pose=pose: pose
    for number, pose in made.stage.cubes[other].items():
        pose = planted.faces.get(number, pose)
        yield number, FACE_TAG_M, lambda t, pose=pose: body(made, other, t) @ pose


def body(made, robot, t):
    """Where a robot truly is, in space."""
    x, y, heading = made.stage.ways[robot].at(np.array(t))
    c, s = np.cos(heading), np.sin(heading)
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))


def _seen(made, robot, t, number, size, place, lens, planted):
    def at(t, corner=slice(None)):
        eye = (body(made, robot, t) @ planted.camera).inverse()
        return lens.project(eye.act(place(t).act(size * HALF[corner])))

    eye, tag = body(made, robot, t) @ planted.camera, place(t)
    away = eye.translation - tag.translation
    distance = np.linalg.norm(away)
    if tag.rotation[:, 2] @ away < 0.3 * distance or distance > 4.0 or distance < 0.4:
        return None
    pixels = at(t)
    for _ in range(3 if planted.line_s else 0):
        lines = pixels[:, 1] - 0.5 * (lens.size[1] - 1)
        pixels = np.stack([at(t + line * planted.line_s, [k])[0] for k, line in enumerate(lines.tolist())])
    inside = np.isfinite(pixels).all() and (pixels > 3).all() and (pixels < np.array(lens.size) - 4).all()
    return pixels if inside and np.linalg.norm(pixels[1] - pixels[0]) > 12 else None
