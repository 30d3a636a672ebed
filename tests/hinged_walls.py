"""Three walls with tags, of which each shares one tag with the next, seen by a camera that is carried by hand along
them: what of a map is behind such a tag, hangs on it. A robot beside it may see all walls.

Written from the definitions (directions to corners), not with the code under test.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from tag_walks import corners_of, corners_seen
from teamslam.geometry import Pose, concatenate
from teamslam.model import Dataset, Kind, Table, Values, is_landmark, is_pose, landmark_key, pack, pose_key

AHEAD = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # of a tag that is looked at along x
PARTS = ((0, 1, 2), (3, 4, 5), (6, 7, 8))  # tags on three walls
HINGES = (9, 10)  # between the first and the second wall, and between that and the third


def eye_before(rng, place):
    turn = Rotation.from_rotvec(rng.normal(scale=0.1, size=3)).as_matrix()
    return Pose(turn, place + rng.normal(scale=(0.3, 0.5, 0.4)))


def tag_at(rng, place):
    return Pose(AHEAD @ Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix(), np.array(place))


def three_walls(seed):
    """A camera carried along three walls in a row, of which each shares one tag with the next: the sightings, the
    truth, and which variables are of which wall."""
    rng = np.random.default_rng(seed)
    tags = {n: tag_at(rng, (4.0, 5.0 * wall + rng.uniform(-1, 1), rng.uniform(-1, 1)))
            for wall, own in enumerate(PARTS) for n in own}  # fmt: skip
    tags |= {HINGES[0]: tag_at(rng, (5.0, 2.5, 0.0)), HINGES[1]: tag_at(rng, (5.0, 7.5, 0.0))}
    keys, rays, truth, wall_of, tick = [], [], {}, {}, 0
    for wall, own in enumerate(PARTS):
        beside = [hinge for n, hinge in enumerate(HINGES) if wall in (n, n + 1)]
        for also in [*(((),) * 8), *((hinge,) for hinge in beside for _ in range(3))]:
            tick += 1
            eye = eye_before(rng, np.array([0.0, 5.0 * wall, 0.0]))
            for n in (*own, *also):
                keys.append((int(pose_key(1, tick * 10**6)), int(landmark_key(n))))
                rays.append(corners_seen(rng, eye, tags[n]))
                truth |= {keys[-1][0]: eye, keys[-1][1]: tags[n]}
                wall_of |= {keys[-1][0]: wall} | ({keys[-1][1]: wall} if n in own else {})
    order = np.sort(np.array(list(truth)))
    values = Values.of({Kind.POSE3: (order, concatenate([truth[int(key)][None] for key in order]))})
    return corners_of(keys, rays), values, wall_of


def hardly_tied(truth):
    """Steps between images that say next to nothing, as of a camera that is carried by hand."""
    keys = truth.layout.keys[is_pose(truth.layout.keys)]
    pairs = np.array(list(pairwise(keys.tolist())))
    still, white = Pose.identity(3, (len(pairs),)), np.tile(np.eye(6) / 3.0, (len(pairs), 1, 1))
    return Table(1, "odometry", "relative_pose", 3, pairs, pack(still), white, np.arange(len(pairs)))


def with_a_robot(seed, moved=None):
    """The log of the camera and of a robot in space whose steps are known to 2 cm, which drives along all walls;
    `moved`: a tag that is 0.4 m away for the later half of them."""
    sightings, truth, _ = three_walls(seed)
    rng = np.random.default_rng(100 + seed)
    keys, rays, poses = [], [], {}
    for tick in range(1, 40):
        eye = eye_before(rng, np.array([-1.0, 0.25 * tick, 0.0]))
        poses[int(pose_key(2, tick * 10**6))] = eye
        for mark in truth.layout.keys[is_landmark(truth.layout.keys)].tolist():
            tag = truth.pose(mark)
            if moved is not None and mark == landmark_key(moved) and tick > 20:
                tag = Pose(tag.rotation, tag.translation + np.array([0.0, 0.4, 0.0]))
            ahead, aside, _ = eye.unact(tag.translation)
            if abs(aside) < 0.6 * ahead:
                keys.append((int(pose_key(2, tick * 10**6)), mark))
                rays.append(corners_seen(rng, eye, tag))
    order, way = np.array(list(poses)), concatenate([eye[None] for eye in poses.values()])
    steps = way[:-1].between(way[1:]).retract(rng.normal(scale=0.02, size=(len(order) - 1, 6)))
    pairs, white = np.stack([order[:-1], order[1:]], 1), np.tile(np.eye(6) / 0.02, (len(order) - 1, 1, 1))
    driven = Table(2, "odometry", "relative_pose", 3, pairs, pack(steps), white, np.arange(len(pairs)))
    seen = replace(corners_of(keys, rays), robot=2)
    return Dataset({1: 3, 2: 3}, (hardly_tied(truth), sightings, driven, seen))
