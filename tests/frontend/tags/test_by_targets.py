"""Where tags lead a robot without odometry: near enough to the truth that least squares ends where it does from it."""

import numpy as np
import pytest

from tag_walks import as_they_stand, eyes_round, ring, walked_round
from teamslam.frontend.tags.by_targets import by_targets
from teamslam.geometry import Pose, compose_along, concatenate
from teamslam.model import Kind, Table, Values, index_of, is_pose, pack, pose_key
from teamslam.solver import Options, System, optimise
from thinned import thinned

TURNS = 2
SIGMA = 0.02  # [m] and [rad], of odometry


def assert_leads(system, truth, led):
    """Least squares ends no higher than from the truth."""
    best = optimise(system, truth, Options(max_iterations=300))
    found = optimise(
        system,
        led.transform(truth.pose(int(truth.layout.keys[is_pose(truth.layout.keys)][0]))),
        Options(max_iterations=300),
    )
    assert best.converged and found.cost <= best.cost * (1.0 + 1e-6)


@pytest.mark.parametrize("seed", thinned(3, range(8)))
def test_a_long_way_that_closes_leads_to_the_optimum_beside_the_truth(seed):
    """Few tags in an image, most of which fit two poses: what each step may be off adds up around the hall, and a map
    that is folded where the way closes stays so."""
    rng = np.random.default_rng(seed)
    tags = as_they_stand(ring(rng, 60, radius=15.0))
    sightings, truth = walked_round(rng, [tags] * TURNS, radius=12.5)
    keys = truth.layout.keys[is_pose(truth.layout.keys)]
    still = Values.of({Kind.POSE3: (keys, Pose.identity(3, (len(keys),)))})
    led = by_targets([sightings], still, (np.diff(index_of(keys)) * 1e-6) ** 2)
    system = System(truth.layout, tables=[sightings], fixed=keys[:1])
    assert_leads(system, truth, led)


@pytest.mark.parametrize("seed", range(2))
def test_what_no_tag_leads_to_hangs_on_odometry(seed):
    """Tags in two corners of a hall: what lies between them is odometry alone, and ties both in one least squares."""
    rng = np.random.default_rng(seed)
    tags = {n: tag for n, tag in as_they_stand(ring(rng, 60, radius=15.0)).items() if n % 30 < 8}
    sightings, truth = walked_round(rng, [tags], radius=12.5)
    eyes = {int(pose_key(1, tick)): pose for _, tick, pose in eyes_round(np.random.default_rng(seed), 1, 12.5)}
    truth = Values.of({Kind.POSE3: (np.array(list(eyes)), concatenate([eye[None] for eye in eyes.values()]))}).update(
        truth
    )
    keys = truth.layout.keys[is_pose(truth.layout.keys)]
    poses = truth.poses_of(keys, 3)
    steps = poses[:-1].between(poses[1:]).retract(rng.normal(scale=SIGMA, size=(len(keys) - 1, 6)))
    pairs, white = np.stack([keys[:-1], keys[1:]], 1), np.tile(np.eye(6) / SIGMA, (len(keys) - 1, 1, 1))
    odometry = Table(1, "odometry", "relative_pose", 3, pairs, pack(steps), white, np.arange(len(pairs)))
    way = Values.of({Kind.POSE3: (keys, compose_along(steps))})
    tables = [odometry, sightings]
    led = by_targets(tables, way, np.full(len(pairs), SIGMA**2))
    system = System(truth.layout, tables=tables, fixed=keys[:1])
    assert_leads(system, truth, led)
