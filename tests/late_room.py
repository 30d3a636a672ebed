"""A robot that drives about a room of tags with one camera, without images: odometry as often and as noisy as is
wished, images beside its messages or at them, stamped late. All is in memory, as a reader of recordings has it.

Written from the definitions, not with the code under test, but for the camera's formulas.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tagged_room import UPRIGHT, wall_tags
from teamslam.frontend.streams import TagCorners, Track
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.noise import corner_covariances
from teamslam.frontend.way_noise import WayNoise
from teamslam.geometry import Pose
from teamslam.io.bags.first_guess import first_guess, looks_of
from teamslam.io.bags.seen import Book, Seen, View
from teamslam.io.bags.team import Recordings
from teamslam.io.bags.team_file import CameraEntry, RobotEntry, Tags, TeamFile, Unsure
from teamslam.io.bags.unknowns import stated_in

CAMERA = Camera((400.0, 400.0), (399.5, 299.5), "radtan", (), (800, 600))
START = 1_700_000_000_000_000
SIZE, FLOOR, EDGE = 0.2, 0.1, 0.2
PLACE = np.array([0.1, 0.0, 0.2])
MOTION = WayNoise(drift_m=0.002, slip_m=0.02, drift_rad=0.001, slip_rad=0.015, fastest_m_s=20.0, fastest_rad_s=50.0)


@dataclass(frozen=True)
class Drive:
    """How it drives: in the plane or in space, how much its heading swings, how often odometry and images come, how
    long after a message (a share of the time to the next) images are taken, how late they are stamped; noise of
    odometry of steps ('steps'), of each message ('messages') or none (''), and that of corners in what is stated."""

    dim: int = 3
    seconds: float = 30.0
    swing: float = 0.1
    odometry_hz: float = 8.0
    images_hz: float = 8.0
    phase: float = 0.0
    late_s: float = 0.0
    noise: str = "steps"
    corners: float = 1.0
    every_s: float = 0.25


def read(drive, seed, sigma_s=0.3):
    """The log of a drive, whose camera's latency is stated as 0, give or take `sigma_s`."""
    rng = np.random.default_rng([seed, 5])
    tags, at = wall_tags(rng, 16), _way(rng, drive)
    t = np.arange(0.0, drive.seconds + 1.0, 1.0 / drive.odometry_hz)
    track = Track(START + np.round(1e6 * t).astype(np.int64), _odometry(rng, drive, *at(t)))
    taken = np.arange(0.5, drive.seconds + 0.5, 1.0 / drive.images_hz) + drive.phase / drive.odometry_hz
    frame, ids, corners = [], [], []
    for k, (R, T) in enumerate(zip(*at(taken), strict=True)):
        for number, pixels in _seen(rng, drive, tags, R, T):
            frame.append(k)
            ids.append(number)
            corners.append(pixels)
    n = len(ids)
    stamps = START + np.round(1e6 * (taken + drive.late_s)).astype(np.int64)
    seen = TagCorners(stamps, np.array(frame), np.array(ids), np.array(corners), np.zeros(n, int), ("tag36h11",) * n)
    x, y, z, w = Rotation.from_matrix(UPRIGHT).as_quat().tolist()
    camera = CameraEntry(
        name="front", tags="/tags", calibration="", xyz_m=tuple(PLACE.tolist()), quaternion_wxyz=(w, x, y, z),
        floor_px=FLOOR, edge_px=EDGE, sigma=Unsure(delay_s=sigma_s),
    )  # fmt: skip
    entry = RobotEntry(
        name="ann", recording="", odometry="/odom", dim=drive.dim, image_every_s=drive.every_s, camera=[camera],
        motion=MOTION,
    )  # fmt: skip
    file = TeamFile(tags=Tags(size_m=SIZE), robot=[entry])
    told = (Seen(entry, track, None, (View(camera, CAMERA, seen),), ()).with_tags(file, Book()),)
    recordings = Recordings(file, "memory", told, stated_in(file, told), (), ())
    return recordings.log(first_guess(told, recordings.stated, looks_of(told)))


def _way(rng, drive):
    """Where it is at any time: rounds of a room, looking about."""
    a = rng.uniform(0.0, 2.0 * np.pi, 7)

    def at(t):
        turn = 0.5 * t + a[0]
        x, y = 1.2 * np.cos(turn) + 0.2 * np.sin(1.3 * t + a[1]), 1.2 * np.sin(turn) + 0.2 * np.sin(1.1 * t + a[2])
        heading = turn + np.pi / 2 + drive.swing * (0.6 * np.sin(0.9 * t + a[3]) + 0.12 * np.sin(2.6 * t + a[4]))
        space = float(drive.dim == 3)
        tilt = 0.1 * space * np.stack([np.sin(1.7 * t + a[5]), np.sin(2.1 * t + a[6])])
        place = np.stack([x, y, 0.1 * space * np.sin(0.8 * t)], -1)
        return Rotation.from_euler("ZYX", np.stack([heading, *tilt], -1)).as_matrix(), place

    return at


def _odometry(rng, drive, R, T):
    flat = np.array([1.0, 1.0, drive.dim == 3]), np.array([drive.dim == 3, drive.dim == 3, 1.0])
    noise = rng.normal(size=(2, len(T), 3))
    if drive.noise == "messages":
        return Pose(R @ Rotation.from_rotvec(0.004 * noise[1] * flat[1]).as_matrix(), T + 0.005 * noise[0] * flat[0])
    scale, dt = float(drive.noise == "steps"), 1.0 / drive.odometry_hz
    found = [(R[0], T[0])]
    for k in range(1, len(T)):
        turn, step = R[k - 1].T @ R[k], R[k - 1].T @ (T[k] - T[k - 1])
        angle = np.linalg.norm(Rotation.from_matrix(turn).as_rotvec())
        s = np.sqrt(MOTION.drift_m**2 * dt + MOTION.slip_m**2 * np.linalg.norm(step))
        r = np.sqrt(MOTION.drift_rad**2 * dt + MOTION.slip_rad**2 * angle)
        before, place = found[-1]
        error = Rotation.from_rotvec(scale * r * noise[1, k] * flat[1]).as_matrix()
        found.append((before @ turn @ error, place + before @ (step + scale * s * noise[0, k] * flat[0])))
    return Pose(np.array([R for R, _ in found]), np.array([T for _, T in found]))


def _seen(rng, drive, tags, R, T):
    square = 0.5 * SIZE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    eye, place = R @ UPRIGHT, T + R @ PLACE
    for number, (Rt, Tt) in tags.items():
        corners, away = (square @ Rt.T + Tt - place) @ eye, place - Tt
        if corners[:, 2].min() < 0.2 or Rt[:, 2] @ away < 0.3 * np.linalg.norm(away):
            continue
        pixels = CAMERA.project(corners)
        if (pixels > 2).all() and (pixels < np.array(CAMERA.size) - 3).all():
            root = np.linalg.cholesky(corner_covariances(pixels[None], FLOOR, EDGE)[0])
            yield number, pixels + drive.corners * (root @ rng.normal(size=8)).reshape(4, 2)
