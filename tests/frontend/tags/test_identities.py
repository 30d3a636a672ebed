"""Tags that stand at several places are told apart by what else is seen with them; the others are left alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from teamslam.frontend.tags.identities import places_of_tags
from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose, s2
from teamslam.model import Loss, Table, landmark_key, pose_key

SIGMA = 1e-3
SIZE = 0.15


def corridor(rng, count, step=0.8):
    """Tags along a wall (y = 2), read from y < 2, one every `step` metres."""
    turns = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (count, 3))).as_matrix()
    facing = np.stack([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]], 1)
    places = np.stack([step * np.arange(count), np.full(count, 2.0), rng.uniform(0.5, 1.5, count)], -1)
    return Pose(turns @ facing, places)


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


def drive(rng, tags, visits):
    """Sightings from a walk along the wall, once for each visit (first, last x, start [s]): keys and rays."""
    keys, rays = [], []
    for first, last, start, of in visits:
        for k, x in enumerate(np.linspace(first, last, 40)):
            look = np.stack([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 1)  # x ahead, to the wall
            eye = Pose(look @ Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix(),
                       np.array([x, 0.0, 1.0]) + rng.normal(scale=0.05, size=3))  # fmt: skip
            tick = int((start + 0.5 * k) * 1e6)
            for number, pose in of(tags).items():
                if abs(pose.translation[0] - x) > 1.2:
                    continue
                keys.append((int(pose_key(1, tick)), int(landmark_key(number))))
                rays.append(corners_seen(rng, eye, pose))
    return corners_of(keys, rays)


def as_they_stand(tags):
    return {k: tags[k] for k in range(len(tags))}


def with_moved(number, by):
    def of(tags):
        return as_they_stand(tags) | {number: Pose(tags[number].rotation, tags[number].translation + by)}

    return of


def test_a_tag_that_was_carried_along_is_found_with_its_times():
    rng = np.random.default_rng(0)
    visits = [(0.0, 8.0, 0.0, as_they_stand), (2.0, 8.0, 300.0, with_moved(3, [4.0, 0.0, 0.2]))]
    found = places_of_tags([drive(rng, corridor(rng, 11), visits)])
    assert {(p.tag, p.number) for p in found} == {(3, 1), (3, 2)}
    (first,), (second,) = (p.visits for p in found)
    assert first[1] < 25e6 and second[0] > 300e6


@pytest.mark.parametrize("seed", range(3))
def test_tags_that_stand_still_are_left_alone(seed):
    rng = np.random.default_rng(seed)
    visits = [(0.0, 8.0, 0.0, as_they_stand), (8.0, 2.0, 300.0, as_they_stand), (0.0, 3.0, 600.0, as_they_stand)]
    assert places_of_tags([drive(rng, corridor(rng, 11), visits)]) == []


def test_one_tag_alone_against_another_is_believed_as_nothing_decides():
    """Only tag 3 is seen again: nothing says that it moved."""
    rng = np.random.default_rng(1)

    def alone(tags):
        return {3: Pose(tags[3].rotation, tags[3].translation + np.array([4.0, 0.0, 0.0])), 50: tags[9], 51: tags[10]}

    visits = [(0.0, 4.0, 0.0, as_they_stand), (5.0, 8.0, 300.0, alone)]
    assert places_of_tags([drive(rng, corridor(rng, 11), visits)]) == []


def test_two_tags_with_one_number_in_one_visit_are_not_looked_for():
    assert places_of_tags([]) == []


def ring(rng, count, radius=8.0):
    """Tags on the wall around a round hall, read from within."""
    at = 2.0 * np.pi * np.arange(count) / count
    out, up = np.stack([np.cos(at), np.sin(at), 0.0 * at], -1), np.array([0.0, 0.0, 1.0])
    facing = np.stack([np.cross(up, -out), np.broadcast_to(up, out.shape), -out], -1)
    turns = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, (count, 3))).as_matrix()
    return Pose(facing @ turns, radius * out + up * rng.uniform(0.8, 1.6, (count, 1)))


def walk_round(rng, rings, radius=5.5, seconds=80.0):
    """Sightings of a walk along the wall, once around for each of the rings: of one or two tags in each image."""
    keys, rays = [], []
    for turn, tags in enumerate(rings):
        for angle in np.arange(0.0, 2.0 * np.pi, 0.05):
            out, up = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
            ahead = np.cos(0.5) * out + np.sin(0.5) * np.cross(up, out)  # a tag seen from the front may stand two ways
            look = np.stack([ahead, np.cross(up, ahead), up], 1)
            eye = Pose(look @ Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_matrix(), radius * out + 1.2 * up)
            tick = int((seconds * turn + seconds * angle / (2.0 * np.pi)) * 1e6)
            for number, pose in tags.items():
                if eye.unact(pose.translation) @ [1.0, 0.0, 0.0] < 0.78 * np.linalg.norm(eye.unact(pose.translation)):
                    continue
                keys.append((int(pose_key(1, tick)), int(landmark_key(number))))
                rays.append(corners_seen(rng, eye, pose))
    return corners_of(keys, rays)


@pytest.mark.parametrize("seed", range(2))
def test_a_long_way_that_is_walked_again_is_no_wall_full_of_tags_that_were_moved(seed):
    """Few tags in an image, and each seen from near by only: a map made on the way bends by metres until it closes."""
    rng = np.random.default_rng(seed)
    tags = as_they_stand(ring(rng, 24))
    assert places_of_tags([walk_round(rng, [tags, tags])]) == []
