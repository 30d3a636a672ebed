"""Strands and start values, against one submap after another."""

import numpy as np
import pytest
import scipy.sparse as sp

from strategies import random_poses
from teamslam.errors import ModelError
from teamslam.geometry import Pose
from teamslam.joining import build, split
from teamslam.joining.join.join import in_order
from teamslam.joining.join.start_values import start_values
from teamslam.joining.place.chains import chains_of
from teamslam.joining.place.stack import Stack
from teamslam.model import Kind, Sources, Submap, Values, landmark_key, pose_key, robot_of
from worlds import WORLDS, team


def chopped(world: str, poses_per_piece: int = 4) -> list[Submap]:
    return in_order(build(piece) for piece in split(team(world), poses_per_piece=poses_per_piece))


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("backwards", [False, True])
def test_a_strand_is_a_robot_s_way_and_its_frames_compose(world: str, backwards: bool) -> None:
    submaps = chopped(world)[:: -1 if backwards else 1]
    chains = chains_of(submaps)
    robots = [{int(robot_of(submaps[m].base)) for m in members} for members, _ in chains]
    assert sorted(robots, key=min) == [{robot} for robot in sorted(set.union(*robots))]
    assert sorted(m for members, _ in chains for m in members) == list(range(len(submaps)))
    for members, frames in chains:
        root = submaps[members[0]]
        known = {root.first_pose: root.all_values.pose(root.first_pose)}
        for member, frame in zip(members, frames, strict=True):
            submap = submaps[member]
            seen = frame @ submap.all_values.pose(submap.first_pose)
            np.testing.assert_allclose(seen.minus(known[submap.first_pose]), 0.0, atol=1e-12)
            for key in submap.trajectory_keys(int(robot_of(submap.base))).tolist():
                known.setdefault(key, frame @ submap.all_values.pose(key))


def test_a_gap_cuts_a_strand() -> None:
    submaps = chopped("planar")
    first = int(robot_of(submaps[0].base))
    whole = [n for n, s in enumerate(submaps) if robot_of(s.base) == first]
    rest = [s for n, s in enumerate(submaps) if n != whole[1]]
    assert len(chains_of(rest)) == len(chains_of(submaps)) + 1


@pytest.mark.parametrize("world", WORLDS)
def test_everything_starts_where_the_first_that_knows_it_puts_it(world: str) -> None:
    submaps = chopped(world)
    rng = np.random.default_rng(0)
    frames = [Pose.from_tangent(rng.normal(size=3 if s.base_dim == 2 else 6), s.base_dim) for s in submaps]
    start = start_values(Stack.of(submaps), frames)
    expected: dict[int, Pose | np.ndarray] = {}
    for submap, frame in zip(submaps, frames, strict=True):
        expected.setdefault(submap.base, frame)
    for submap, frame in zip(submaps, frames, strict=True):
        for _, keys, things in submap.values.parts():
            for key, thing in zip(keys.tolist(), things, strict=True):
                put = frame @ thing if isinstance(thing, Pose) else frame.lift(len(thing)).act(thing)
                expected.setdefault(key, put)
    assert set(start.layout.keys.tolist()) == set(expected)
    for _, keys, things in start.parts():
        for key, thing in zip(keys.tolist(), things, strict=True):
            wanted = expected[key]
            if isinstance(thing, Pose):
                assert isinstance(wanted, Pose)
                np.testing.assert_allclose(thing.minus(wanted), 0.0, atol=1e-12)
            else:
                np.testing.assert_allclose(thing, wanted, atol=1e-12)


def submap_of(base: int, dim: int, values: Values) -> Submap:
    return Submap(f"{base}", 0, base, dim, values, sp.csr_array(np.eye(values.layout.dof)), Sources())


def test_a_robot_on_the_ground_stays_there_whoever_saw_it_fly() -> None:
    rng = np.random.default_rng(1)
    ground, air = int(pose_key(1, 0)), int(pose_key(2, 0))
    marks = Values.of({Kind.POINT2: (landmark_key(np.array([7])), np.ones((1, 2)))})
    seen = Values.of({Kind.POSE3: (np.array([ground]), random_poses(rng, 3, 1))})
    frames = [random_poses(rng, 3), random_poses(rng, 2)]
    start = start_values(Stack.of([submap_of(air, 3, seen), submap_of(ground, 2, marks)]), frames)
    np.testing.assert_allclose(start.pose(ground).minus(frames[1]), 0.0, atol=1e-14)
    np.testing.assert_allclose(start.pose(air).minus(frames[0]), 0.0, atol=1e-14)
    with pytest.raises(ModelError, match="plane"):
        start_values(Stack.of([submap_of(air, 3, marks)]), frames[:1])
