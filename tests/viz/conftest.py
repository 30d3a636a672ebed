"""A team drawn by hand: three planar robots on arcs, landmarks in space, a truth that is a little elsewhere."""

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.geometry import Pose
from teamslam.model import Kind, Names, Sources, Submap, Values, landmark_key, pose_key
from teamslam.viz import Scene

RNG = np.random.default_rng(7)


def spatial_poses(count: int, robot: int) -> Pose:
    """A climbing spiral."""
    turn = np.linspace(0.0, 3.0, count)[:, None]
    places = np.concatenate([np.cos(turn + robot), np.sin(turn + robot), 0.2 * turn], -1) * 3.0
    return Pose.from_tangent(np.concatenate([places, 0.0 * places[:, :2], turn], -1), 3)


def planar_poses(count: int, robot: int) -> Pose:
    """An arc."""
    turn = np.linspace(0.0, 2.0, count) + 2.0 * robot
    return Pose.from_xytheta(np.stack([4.0 * np.cos(turn), 3.0 * np.sin(turn), turn + np.pi / 2], -1))


def team_values(dim: int, count: int, shake: float) -> Values:
    """Three robots and five landmarks, seen from the first robot's start."""
    make = planar_poses if dim == 2 else spatial_poses
    kind = Kind.POSE2 if dim == 2 else Kind.POSE3
    keys = np.concatenate([pose_key(r, np.arange(count)) for r in (1, 2, 3)])
    parts = [make(count, r) for r in (1, 2, 3)]
    poses = Pose(np.concatenate([p.rotation for p in parts]), np.concatenate([p.translation for p in parts]))
    marks = landmark_key(np.arange(5))
    places = np.array([[0, 0, 2.0], [3, 1, 2], [-2, 2, 2], [1, -3, 2], [-3, -1, 2]])
    base = poses[0].inverse()
    values = Values.of({kind: (keys, poses), Kind.POINT3: (marks, places)}).transform(base)
    noise = shake * np.random.default_rng(3).standard_normal(values.layout.dof)
    noise[values.layout.unknowns(keys[:1])] = 0.0
    return values.retract(noise)


def scene_of(dim: int, count: int = 30, sd: float = 0.12, truth: bool = True) -> Scene:
    """A scene with covariances of the size that the truth differs by."""
    values = team_values(dim, count, 0.0)
    base = int(pose_key(1, 0))
    inner = values.select(values.layout.keys != base)
    submap = Submap(
        "team", 1, base, dim, inner, sp.csr_array(sp.eye_array(inner.layout.dof) / sd**2), Sources(),
        Names({2: "b"}, {3: "door"}, tick_s=0.1),
    )  # fmt: skip
    covariances = {}
    for key, dof in zip(inner.layout.keys.tolist(), inner.layout.dofs.tolist(), strict=True):
        root = np.tril(np.random.default_rng(key % 97).uniform(-0.5, 0.5, (dof, dof)), -1) + np.eye(dof)
        covariances[key] = sd**2 * root @ root.T
    pairs = np.stack([pose_key(1, np.arange(0, count, 3)), pose_key(2, np.arange(0, count, 3))], -1)
    return Scene(
        submap, covariances, team_values(dim, count, sd) if truth else None, pairs, "join",
        caption="position RMSE 0.12 m",
    )  # fmt: skip


@pytest.fixture(params=[2, 3], ids=["plane", "space"])
def scene(request: pytest.FixtureRequest) -> Scene:
    """The team in the plane and in space."""
    return scene_of(request.param)


@pytest.fixture(name="scene_of")
def make_scene():
    """The maker of scenes itself."""
    return scene_of
