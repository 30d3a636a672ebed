"""Small teams with known truth, for tests of the solver and of joining: exact measurements plus Gaussian noise."""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, compose_along, concatenate, rotations
from teamslam.model import (
    MODELS,
    Dataset,
    Kind,
    Names,
    Table,
    Values,
    is_landmark,
    is_pose,
    landmark_key,
    pack,
    point_kind,
    pose_key,
    pose_kind,
    robot_of,
    unpack,
)

WORLDS = ("2d", "planar", "3d")  # planar: robots of the plane, landmarks in space


def team(
    world: str = "planar",
    *,
    robots: int = 3,
    poses: int = 12,
    landmarks: int = 6,
    sigma_odometry: float = 0.02,
    sigma: float = 0.02,
    model: str = "point",
    robot_model: str = "relative_pose",
    sees: float = 0.4,
    every: int = 3,
    seed: int = 0,
) -> Dataset:
    """A team driving circles among landmarks, each robot seeing the next one at every `every`-th pose."""
    rng = np.random.default_rng(seed)
    dim, of_points = (3 if world == "3d" else 2), (2 if world == "2d" else 3)
    marks = landmark_key(np.arange(landmarks))
    keys = [pose_key(r, np.arange(poses)) for r in range(1, robots + 1)]
    step = [0.7, 0, 0, 0.02, 0.03, 0.2] if dim == 3 else [0.7, 0, 0.2]
    ways = []
    for _ in keys:
        turn = rng.uniform(-2.0, 2.0, 3 if dim == 3 else 1)
        first = Pose.from_tangent(np.concatenate([rng.uniform(-3.0, 3.0, dim), turn]), dim)
        ways.append(first @ compose_along(Pose.from_tangent(np.tile(step, (poses - 1, 1)), dim)))
    truth = Values.of(
        {
            pose_kind(dim): (np.concatenate(keys), concatenate(ways)),
            point_kind(of_points): (marks, rng.uniform(-5.0, 5.0, (landmarks, of_points))),
        }
    )
    mast = Pose(np.eye(3), np.array([0.1, 0.0, 1.0])) if world == "planar" else None
    tables = []
    for number, own in enumerate(keys):
        other = keys[(number + 1) % robots]
        pairs = np.stack([np.repeat(own, landmarks), np.tile(marks, poses)], -1)
        pairs = pairs[rng.random(len(pairs)) < sees]
        robot = number + 1
        tables += [
            measure(robot, "odometry", "relative_pose", dim, chain(own), sigma_odometry, truth, rng),
            measure(robot, "landmarks", model, of_points, pairs, sigma, truth, rng, mast),
        ]
        if robots > 1:
            meetings = np.stack([own[::every], other[::every]], -1)
            tables.append(measure(robot, "robots", robot_model, dim, meetings, sigma, truth, rng))
    return Dataset(dict.fromkeys(range(1, robots + 1), dim), tuple(tables), Names(tick_s=1.0), truth)


def mixed_team(sigma: float = 0.01) -> Dataset:
    """A planar robot and one in space among the same landmarks, the second seeing the first."""
    ground, air = team("planar", robots=1, poses=15), team("3d", robots=1, poses=15)
    assert ground.truth is not None and air.truth is not None
    rng = np.random.default_rng(0)
    flyer = pose_key(2, np.arange(15))
    way = air.truth.of_kind(Kind.POSE3)
    assert isinstance(way, Pose)
    truth = ground.truth.update(Values.of({Kind.POSE3: (flyer, way)}))
    marks = landmark_key(np.arange(6))
    pairs = np.stack([np.repeat(flyer, 6), np.tile(marks, 15)], -1)[::3]
    meetings = np.stack([flyer[::4], ground.pose_keys[1][::4]], -1)
    tables = [
        *[t for t in ground.tables if t.source != "robots"],
        measure(2, "odometry", "relative_pose", 3, chain(flyer), sigma, truth, rng),
        measure(2, "landmarks", "point", 3, pairs, sigma, truth, rng),
        measure(2, "robots", "relative_pose", 3, meetings, sigma, truth, rng),
    ]
    return Dataset({1: 2, 2: 3}, tuple(tables), ground.names, truth)


def chain(keys: IntArray) -> IntArray:
    """Consecutive pairs."""
    return np.stack([keys[:-1], keys[1:]], -1)


def measure(
    robot: int,
    source: str,
    model: str,
    dim: int,
    keys: IntArray,
    sigma: float,
    truth: Values,
    rng: np.random.Generator,
    sensor: Pose | None = None,
) -> Table:
    """What a robot measures: h (+) n with n exactly Gaussian in the residual's own coordinates."""
    rows = MODELS[model].residual_rows(dim)
    blank = np.zeros((len(keys), MODELS[model].z_size(dim)))
    table = Table(robot, source, model, dim, keys, blank, np.eye(rows)[None] / sigma, np.arange(len(keys)), sensor)
    noise = sigma * rng.standard_normal((len(keys), rows))
    return replace(table, values=_add(model, table.predict(truth), noise, dim))


def _add(model: str, h: Array, noise: Array, dim: int) -> Array:
    if model in ("relative_pose", "pose"):
        pose = unpack(h, pose_kind(dim))
        assert isinstance(pose, Pose)
        turned = pose.rotation @ rotations(dim).exp(noise[:, dim:])
        return pack(Pose(turned, pose.translation + noise[:, :dim]))
    if h.shape != noise.shape:
        raise ValueError(f"{model} in space needs noise on the sphere; use the simulator")
    return h + noise


def apart() -> Dataset:
    """Robots 1 and 2 share landmarks; robot 3 has landmarks of its own, and no robot sees it or is seen by it."""
    whole = team("2d", robots=3, poses=12, landmarks=10, sees=1.0)

    def wanted(table: Table) -> np.ndarray:
        target = table.keys[:, 1]
        meets = is_pose(target) & (robot_of(target) != table.robot)
        other = is_landmark(target) & ((target >= 5) != (table.robot == 3))
        return ~meets & ~other

    return whole.with_tables(t.select(wanted(t)) for t in whole.tables)
