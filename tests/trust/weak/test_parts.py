"""What an open direction moves falls into rigid bodies, each variable into one."""

import numpy as np
from hypothesis import given, settings

from strategies import seeds
from teamslam.geometry import Pose
from teamslam.model import Values, landmark_key, point_kind, pose_key, pose_kind
from teamslam.trust.weak.motions import Motions
from teamslam.trust.weak.parts import bodies


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_bodies_of_a_mixed_team_are_a_partition(seed: int) -> None:
    """A robot on the ground moves as no robot in the air may, and yet every pose follows its own motion."""
    rng = np.random.default_rng(seed)
    values = Values.of(
        {
            pose_kind(2): (pose_key(1, np.arange(3)), Pose.from_tangent(rng.normal(size=(3, 3)), 2)),
            pose_kind(3): (pose_key(2, np.arange(3)), Pose.from_tangent(rng.normal(size=(3, 6)), 3)),
            point_kind(3): (landmark_key(np.arange(2)), rng.normal(size=(2, 3))),
        }
    )
    motions = Motions(values, 3.0)
    found = bodies(motions, rng.normal(size=(values.layout.dof, 2)))
    assert np.array_equal(np.sum(found, 0), np.ones(len(values.layout)))
