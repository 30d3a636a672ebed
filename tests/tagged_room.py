"""The paper's experiment as recordings without images: two robots with a camera and a cube of tags each drive about a
room of 5 x 5 m with tags on its walls; a detector reports corners, with the noise that is stated.

Written from the definitions (projection of points), not with the code under test, but for the camera's formulas.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

import recordings
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.noise import corner_covariances

CAMERA = Camera((540.0, 540.0), (319.5, 239.5), "radtan", (-0.05, 0.02, 1e-4, -2e-4), (640, 480))
START = 1_700_000_000 * 10**9
SIZE = 0.14
HEIGHT = 0.3  # of the camera above the ground
UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera's axes in the body: z ahead
FLOOR, EDGE = 0.2, 0.3


@dataclass
class Room:
    """The truth: tags on walls (number: (R, T)) and where each robot was at each tick (n, 3) x, y, heading."""

    walls: dict
    ticks_ns: np.ndarray
    ways: list
    line_s: float = 0.0  # of a shutter that rolls
    called: dict = field(default_factory=dict)  # the number printed on a tag, where it is that of another
    moved: dict = field(default_factory=dict)  # tags that are carried elsewhere: number -> (from which tick on, (R, T))

    def wall(self, number, k):
        """Where a tag is at a tick."""
        since, place = self.moved.get(number, (np.inf, None))
        return place if k >= since else self.walls[number]


def wall_tags(rng, count=8):
    """Tags on the four walls, read from within."""
    out = {}
    for number in range(count):
        side = number % 4
        inward = np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])[side]
        place = -2.5 * inward + np.array([inward[1], inward[0]]) * rng.uniform(-1.8, 1.8)
        z = np.array([*inward, 0.0])
        x = np.cross([0, 0, 1.0], z)
        R = np.stack([x, [0, 0, 1.0], z], 1) @ Rotation.from_euler("z", rng.uniform(-0.1, 0.1)).as_matrix()
        out[number] = (R, np.array([*place, rng.uniform(0.2, 0.8)]))
    return out


def cube(first):
    """Four faces about a post behind the camera: number -> (R, T) in the body."""
    out = {}
    for face in range(4):
        out_ = Rotation.from_euler("z", face * np.pi / 2).as_matrix()
        z = out_[:, 0]
        R = np.stack([np.cross([0, 0, 1.0], z), [0, 0, 1.0], z], 1)
        out[first + face] = (R, np.array([-0.1, 0.0, 0.45]) + 0.08 * z)
    return out


CUBES = [cube(100), cube(200)]


def make(seed=0, seconds=60.0, rate=5.0, line_s=0.0):
    """The room and the robots' ways: two rounds each, looking about."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    ways = []
    for phase in (0.0, np.pi):
        a = 2.0 * np.pi * 2.0 * t / seconds + phase
        xy = np.stack([1.2 * np.cos(a), 1.0 * np.sin(a)], 1)
        heading = a + np.pi / 2 + 1.3 * np.sin(3.0 * a)
        ways.append(np.concatenate([xy, heading[:, None]], 1))
    return Room(wall_tags(rng), START + (t * 1e9).astype(np.int64), ways, line_s)


def pose(xyth):
    return Rotation.from_euler("z", xyth[2]).as_matrix(), np.array([xyth[0], xyth[1], 0.0])


def camera_of(xyth):
    R, T = pose(xyth)
    return R @ UPRIGHT, T + np.array([0.0, 0.0, HEIGHT])


def between(room, robot, k, late_s):
    """Where a robot was a little beside an image."""
    way, step = room.ways[robot], (room.ticks_ns[1] - room.ticks_ns[0]) * 1e-9
    before, after = max(k - 1, 0), min(k + 1, len(way) - 1)
    return way[k] + (way[after] - way[before]) * late_s / (step * (after - before))


def seen(room, robot, k, rng, noise=1.0):
    """What the detector says of one image: (number, corners (4, 2))."""
    other = 1 - robot
    tags = list(room.walls) + list(CUBES[other])

    def at(number, late_s):
        """A tag's pose, and the camera's, so long after the image's instant."""
        way, others = (between(room, who, k, late_s) for who in (robot, other))
        Ro, To = pose(others)
        if number in room.walls:
            return *room.wall(number, k), *camera_of(way)
        Rt, Tt = CUBES[other][number]
        return Ro @ Rt, Ro @ Tt + To, *camera_of(way)

    found = []
    square = 0.5 * SIZE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    for number in tags:
        Rt, Tt, R, T = at(number, 0.0)
        corners = (square @ Rt.T + Tt - T) @ R
        facing = (Rt[:, 2] @ (T - Tt)) / np.linalg.norm(T - Tt)
        if corners[:, 2].min() < 0.2 or facing < 0.25:
            continue
        pixels = CAMERA.project(corners)
        for _ in range(3 if room.line_s else 0):  # each corner where it is when its line is read
            for corner, line in enumerate((pixels[:, 1] - 0.5 * (CAMERA.size[1] - 1)).tolist()):
                Rt, Tt, R, T = at(number, line * room.line_s)
                pixels[corner] = CAMERA.project((Rt @ square[corner] + Tt - T) @ R)
        if not ((pixels > 2).all() and (pixels < np.array(CAMERA.size) - 3).all()):
            continue
        side = np.linalg.norm(np.roll(pixels, -1, 0) - pixels, axis=1)
        if side.min() < 12:
            continue
        root = np.linalg.cholesky(corner_covariances(pixels[None], FLOOR, EDGE)[0])
        error = (root @ rng.normal(size=8)).reshape(4, 2)
        found.append((room.called.get(number, number), pixels + noise * error + 0.5))  # as detectors count
    return found


def write(room, folder, kind="mcap", seed=0, odometry_noise=1.0, noise=1.0):
    """A recording for each robot, and the team file, which says that stamps are right; returns the path of the file."""
    rng = np.random.default_rng(seed + 1000)
    text = [f"[tags]\nsize_m = {SIZE}\n"]
    for robot in (0, 1):
        way = room.ways[robot]
        place, messages = np.array([5.0, -3.0, 1.0]), []
        for k, stamp in enumerate(room.ticks_ns.tolist()):
            if k:
                c, s = np.cos(way[k - 1, 2]), np.sin(way[k - 1, 2])
                step = np.array([[c, s], [-s, c]]) @ (way[k, :2] - way[k - 1, :2])
                step = step + odometry_noise * 0.02 * np.sqrt(np.linalg.norm(step)) * rng.normal(size=2)
                turn = way[k, 2] - way[k - 1, 2]
                turn += odometry_noise * 0.015 * np.sqrt(abs(turn) + 1e-3) * rng.normal()
                c, s = np.cos(place[2]), np.sin(place[2])
                place = place + np.array([*(np.array([[c, -s], [s, c]]) @ step), turn])
            quaternion = Rotation.from_euler("z", place[2]).as_quat()
            messages.append(recordings.odometry("/odom", stamp, (*place[:2], 0.0), quaternion))
            messages.append(
                recordings.detections("/camera/tags", stamp, seen(room, robot, k, rng, noise), stamp + 30_000)
            )
        (folder / f"robot{robot}").mkdir(parents=True)
        path = recordings.write(folder / f"robot{robot}", kind, messages)
        text.append(f"""
[[robot]]
name = "robot{robot}"
recording = "{path.relative_to(folder)}"
odometry = "/odom"
dim = 2
image_every_s = 0.0
clock = {{ offset_sigma_s = 0.0, drift_sigma = 0.0 }}
motion = {{ drift_m = 0.001, slip_m = 0.02, drift_rad = 0.0005, slip_rad = 0.015 }}
[[robot.camera]]
name = "front"
tags = "/camera/tags"
calibration = "camera.json"
xyz_m = [0.0, 0.0, {HEIGHT}]
quaternion_wxyz = [0.5, -0.5, 0.5, -0.5]
floor_px = {FLOOR}
edge_px = {EDGE}
line_s = {room.line_s}
sigma = {{ delay_s = 0.0 }}
""")
        for number, (R, T) in CUBES[robot].items():
            x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
            text.append(f"[[robot.tag]]\nnumber = {number}\nxyz_m = {T.tolist()}\nquaternion_wxyz = {[w, x, y, z]}\n")
    f, c = CAMERA.focal, CAMERA.centre
    (folder / "camera.json").write_text(
        f'{{"camera_matrix": [{f[0]}, 0, {c[0]}, 0, {f[1]}, {c[1]}, 0, 0, 1], '
        f'"distortion_coefficients": {list(CAMERA.distortion)}, "image_width": 640, "image_height": 480}}'
    )
    (folder / "team.toml").write_text("".join(text))
    return folder / "team.toml"
