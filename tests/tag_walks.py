"""Tags on the wall of a round hall, seen on walks along it by a camera that is carried: sightings and the truth.

Written from the definitions (directions to corners), not with the code under test.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose, concatenate, s2
from teamslam.model import Kind, Loss, Table, Values, landmark_key, pose_key

SIGMA = 1e-3  # [rad] of a corner
SIZE = 0.15  # [m] of a tag


def corners_seen(rng, eye, tag):
    """The rays to the corners of a tag, with noise."""
    seen = s2.of(eye.unact(tag.act(SIZE * SQUARE)))
    return s2.of(seen + (s2.direction_basis(seen) @ rng.normal(scale=SIGMA, size=(4, 2, 1)))[..., 0])


def corners_of(keys, rays):
    """Sightings by their keys and rays."""
    m = len(keys)
    values = np.concatenate([np.reshape(rays, (m, 12)), np.tile((SIZE * SQUARE).ravel(), (m, 1))], 1)
    white = np.eye(8)[None] / SIGMA
    return Table(1, "landmarks", "corners", 3, np.array(keys), values, white, np.arange(m), None, Loss("cauchy", 4.0))


def as_they_stand(tags):
    return {k: tags[k] for k in range(len(tags))}


def ring(rng, count, radius=8.0):
    """Tags on the wall around a round hall, read from within."""
    at = 2.0 * np.pi * np.arange(count) / count
    out, up = np.stack([np.cos(at), np.sin(at), 0.0 * at], -1), np.array([0.0, 0.0, 1.0])
    facing = np.stack([np.cross(up, -out), np.broadcast_to(up, out.shape), -out], -1)
    turns = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, (count, 3))).as_matrix()
    return Pose(facing @ turns, radius * out + up * rng.uniform(0.8, 1.6, (count, 1)))


def eyes_round(rng, turns=1, radius=5.5, seconds=80.0):
    """Where the camera is along the wall, in pose and tick: (turn, tick, pose)."""
    for turn in range(turns):
        for angle in np.arange(0.0, 2.0 * np.pi, 0.05):
            out, up = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
            ahead = np.cos(0.5) * out + np.sin(0.5) * np.cross(up, out)  # a tag seen from the front may stand two ways
            look = np.stack([ahead, np.cross(up, ahead), up], 1)
            eye = Pose(look @ Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix(), radius * out + 1.2 * up)
            yield turn, int((seconds * turn + seconds * angle / (2.0 * np.pi)) * 1e6), eye


def walked_round(rng, rings, radius=5.5):
    """A walk along the wall, once around for each of the rings, of one or two tags in each image: its sightings, and
    the truth of all poses that saw one and, where they stand still, of the tags."""
    keys, rays, truth = [], [], {}
    for turn, tick, eye in eyes_round(rng, len(rings), radius):
        for number, pose in rings[turn].items():
            if eye.unact(pose.translation) @ [1.0, 0.0, 0.0] < 0.78 * np.linalg.norm(eye.unact(pose.translation)):
                continue
            keys.append((int(pose_key(1, tick)), int(landmark_key(number))))
            rays.append(corners_seen(rng, eye, pose))
            truth |= {keys[-1][0]: eye, keys[-1][1]: pose}
    order = np.sort(np.array(list(truth)))
    poses = concatenate([truth[int(key)][None] for key in order])
    return corners_of(keys, rays), Values.of({Kind.POSE3: (order, poses)})
