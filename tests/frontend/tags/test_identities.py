"""Tags that stand at several places are told apart by what else is seen with them; the others are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tag_walks import as_they_stand, corners_of, corners_seen, ring, walked_round
from teamslam.frontend.tags.identities import places_of_tags
from teamslam.geometry import Pose
from teamslam.model import landmark_key, pose_key


def corridor(rng, count, step=0.8):
    """Tags along a wall (y = 2), read from y < 2, one every `step` metres."""
    turns = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (count, 3))).as_matrix()
    facing = np.stack([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]], 1)
    places = np.stack([step * np.arange(count), np.full(count, 2.0), rng.uniform(0.5, 1.5, count)], -1)
    return Pose(turns @ facing, places)


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


@pytest.mark.parametrize("seed", range(2))
def test_a_long_way_that_is_walked_again_is_no_wall_full_of_tags_that_were_moved(seed):
    """Few tags in an image, and each seen from near by only: a map made on the way bends by metres until it closes."""
    rng = np.random.default_rng(seed)
    tags = as_they_stand(ring(rng, 24))
    assert places_of_tags([walked_round(rng, [tags, tags])[0]]) == []


def test_a_misread_long_before_a_tag_is_seen_makes_no_place_of_it():
    """Once in one image a tag is taken for one that stands metres off, and is first seen itself minutes later."""
    rng = np.random.default_rng(0)
    tags = corridor(rng, 11)
    without = {k: tag for k, tag in as_they_stand(tags).items() if k != 3}
    visits = [(3.5, 8.0, 0.0, lambda _: without), (0.0, 8.0, 300.0, as_they_stand)]
    seen = drive(rng, tags, visits)
    keys = seen.keys.copy()
    assert keys[0, 1] != landmark_key(3)
    far = np.flatnonzero(keys[:, 1] == landmark_key(9))[0]
    keys[far, 1] = landmark_key(3)
    assert places_of_tags([replace(seen, keys=keys)]) == []
