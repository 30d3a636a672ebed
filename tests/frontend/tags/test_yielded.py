"""A tag that stands the wrong way round is turned back though what saw it has given way to it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hinged_walls import eye_before, hardly_tied, tag_at
from tag_walks import corners_of, corners_seen
from teamslam.frontend.tags.mirrored import cost_of, turned
from teamslam.frontend.tags.whole_poses import hypotheses
from teamslam.frontend.tags.yielded import turned_with_its_eyes
from teamslam.geometry import Pose, concatenate
from teamslam.joining.build.build import build_with_solution
from teamslam.model import Dataset, Kind, Values, is_landmark, landmark_key, pose_key
from teamslam.solver import System, optimise
from thinned import thinned

LEANT = 7  # the tag


def walked(seed, beside=8, alone=20):
    """A camera carried by hand before three tags and one that leans, and past that by itself: the sightings, and the
    truth."""
    rng = np.random.default_rng(seed)
    tags = {n: tag_at(rng, (4.0, rng.uniform(-1, 1), rng.uniform(-1, 1))) for n in (0, 1, 2)}
    lean = tag_at(rng, (7.0, 1.0, 0.3))
    tags[LEANT] = Pose(Rotation.from_euler("z", 0.5).as_matrix() @ lean.rotation, lean.translation)
    keys, rays, truth = [], [], {}
    for tick, seen in enumerate([(0, 1, 2)] * 6 + [(0, 1, 2, LEANT)] * beside + [(LEANT,)] * alone, 1):
        eye = eye_before(rng, np.zeros(3))
        for n in seen:
            keys.append((int(pose_key(1, tick * 10**6)), int(landmark_key(n))))
            rays.append(corners_seen(rng, eye, tags[n]))
            truth |= {keys[-1][0]: eye, keys[-1][1]: tags[n]}
    order = np.sort(np.array(list(truth)))
    values = Values.of({Kind.POSE3: (order, concatenate([truth[int(key)][None] for key in order]))})
    return corners_of(keys, rays), values


def optima(seed):
    """The tables, the optimum beside the truth, and that from where the tag stands as its mirror image."""
    sightings, truth = walked(seed)
    tables = [hardly_tied(truth), sightings]
    system = System(truth.layout, tables=tables, fixed=sightings.keys[:1, 0])
    best, key = optimise(system, truth), np.array([int(landmark_key(LEANT))])
    rows = sightings.select(sightings.keys[:, 1] == key)
    both = truth.poses_of(rows.keys[:1, 0], 3) @ hypotheses(rows)[0][0]
    known = truth.poses_of(key, 3)
    other = both[[int(np.argmax(np.linalg.norm(known.rotation - both.rotation, axis=(1, 2))))]]
    return tables, best, optimise(system, best.values.update(Values.of({Kind.POSE3: (key, other)})))


SEEDS = (0, 2, 3, 4, 7)  # where the mirror image costs 10 more at its optimum


@pytest.mark.parametrize("seed", thinned(3, SEEDS))
def test_a_submap_costs_no_more_than_beside_the_truth(seed):
    tables, best, worst = optima(seed)
    _, found = build_with_solution(Dataset({1: 3}, tuple(tables)), near=worst.values)
    assert found.cost < best.cost + 0.1


def test_with_all_else_held_it_does_not_turn_back():
    """In most of these rooms that costs more, or nothing that is turned is found."""
    found = [(tables, worst) for tables, best, worst in map(optima, SEEDS) if worst.cost > best.cost + 10.0]
    assert len(found) == len(SEEDS)
    assert sum(turned(worst.values, tables) is None for tables, worst in found) > 0.5 * len(found)


@pytest.mark.parametrize("seed", thinned(3, SEEDS))
def test_what_is_turned_costs_less_and_what_stands_right_is_not(seed):
    tables, best, worst = optima(seed)
    base = int(tables[1].keys[0, 0])
    assert turned_with_its_eyes(best.values, tables, base) is None
    other = turned_with_its_eyes(worst.values, tables, base)
    assert other is not None and cost_of(other, tables) < cost_of(worst.values, tables)
    keys = other.layout.keys
    still = keys[(is_landmark(keys) & (keys != landmark_key(LEANT))) | (keys == base)]
    np.testing.assert_array_equal(other.only(still).minus(worst.values.only(still)), 0.0)
