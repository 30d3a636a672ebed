"""Finished maps made up for tests of the files that hold them."""

import numpy as np

from strategies import random_poses
from teamslam.geometry import Pose
from teamslam.io import MapEstimate
from teamslam.model import WORLD, Names, Values, landmark_key, point_kind, pose_key, pose_kind


def estimate(
    rng: np.random.Generator, dim: int, *, world: bool = False, robots: int = 2, mixed: bool = False, ticks: bool = True
) -> MapEstimate:
    """A map of some robots and landmarks; the base is the first pose, at the identity."""
    indices = np.sort(rng.choice(10**9 if ticks else 1000, 3, replace=False)) + 1
    keys = np.concatenate([pose_key(robot, indices) for robot in range(1, robots + 1)])
    marks = np.sort(rng.choice(10**6, 3, replace=False))
    poses, depth = random_poses(rng, dim, len(keys)), 3 if mixed else dim
    if not world:
        start = poses[0]
        poses = start.inverse() @ poses
        poses = Pose(np.concatenate([np.eye(dim)[None], poses.rotation[1:]]), np.vstack([0 * poses.translation[:1],
                     poses.translation[1:]]))  # fmt: skip
    values = Values.of(
        {pose_kind(dim): (keys, poses), point_kind(depth): (landmark_key(marks), rng.normal(size=(3, depth)))}
    )
    base = WORLD if world else int(keys[0])
    blocks = []
    for key, dof in zip(values.layout.keys.tolist(), values.layout.dofs.tolist(), strict=True):
        root = rng.normal(size=(dof, dof)) + 3 * np.eye(dof)
        blocks.append(0.01 * root @ root.T * (key != base))
    names = Names({1: "Ada, the 1st", 2: "b"}, {int(marks[0]): "door"}, 1e-6 if ticks else 1.0)
    return MapEstimate(values, tuple(blocks), base, names)
