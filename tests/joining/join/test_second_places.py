"""A landmark that fits at two places is in the map at one of them, and the map says so."""

import re

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.joining import accounted, build, full, join, split
from teamslam.model import WORLD, Dataset, Table, landmark_key, pack, pose_key

SIGMA = 0.05


def drive(way: Pose, marks: np.ndarray, rng: np.random.Generator) -> Dataset:
    """A robot that knows its way and ranges some landmarks from every pose."""
    n, dim = len(way), marks.shape[1]
    own = np.stack([pose_key(1, np.arange(n - 1)), pose_key(1, np.arange(1, n))], 1)
    steps = pack(way[:-1].between(way[1:]))
    tables = [Table(1, "odometry", "relative_pose", 2, own, steps, 1e3 * np.eye(3)[None], np.arange(n - 1))]
    eyes = np.pad(way.translation, ((0, 0), (0, dim - 2)))
    for number, place in enumerate(marks):
        lengths = np.linalg.norm(place - eyes, axis=1) + SIGMA * rng.normal(size=n)
        keys = np.stack([pose_key(1, np.arange(n)), np.full(n, int(landmark_key(number)))], 1)
        ids = np.arange(n) + n * number
        tables.append(Table(1, "landmarks", "range", dim, keys, lengths[:, None], np.eye(1)[None] / SIGMA, ids))
    return Dataset({1: 2}, tuple(tables))


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_straight_drive_leaves_the_side_open(method: str) -> None:
    """Both places are named, with what the other costs more; of many landmarks the cheapest, and the others' names."""
    way = Pose.from_xytheta(np.stack([np.linspace(0.0, 6.0, 9), np.zeros(9), np.zeros(9)], 1))
    places = np.array([[1.0, 3.0], [2.0, -4.0], [3.0, 5.0], [4.0, -3.0], [5.0, 6.0]])
    log = drive(way, places, np.random.default_rng(3))
    joined = accounted(log, join([build(piece) for piece in split(log)])) if method == "join" else full(log)
    assert joined.converged and not joined.left_out
    *named, last = [sentence for sentence in joined.remarks if "ambiguous" in sentence]
    assert len(named) == 3 and re.fullmatch(r"ambiguous in the same way: landmark \d, landmark \d", last)
    for sentence in named:
        mark, *numbers = re.findall(r"-?\d+\.?\d*", sentence)[:5]
        here, there = np.array(numbers[:2], float), np.array(numbers[2:], float)
        for place in (here, there):
            np.testing.assert_allclose(np.abs(place), np.abs(places[int(mark)]), atol=8.0 * SIGMA)
        assert here[1] * there[1] < 0.0
    (component,) = joined.components
    assert {key for key, _ in component.second_places} == set(component.map.landmark_keys.tolist())
    for key, place in component.second_places:
        here = component.map.values.positions(np.array([key]), 2)[0]
        np.testing.assert_allclose(place * [1.0, -1.0], here, atol=8.0 * SIGMA)


def test_what_is_above_a_plane_or_below_it_is_said_once() -> None:
    """By ranges alone nobody of the plane can tell."""
    angles = np.linspace(0.0, 5.0, 12)
    way = Pose.from_xytheta(np.stack([4.0 * np.cos(angles), 4.0 * np.sin(angles), angles + np.pi / 2], 1))
    marks = np.array([[1.0, -0.5, 3.0], [-1.0, 0.5, 2.0]])
    log = drive(way, marks, np.random.default_rng(3))
    joined = accounted(log, join([build(piece) for piece in split(log)]))
    (sentence,) = joined.remarks
    assert joined.components[0].second_places == ()
    assert sentence.startswith("landmark 0, landmark 1: ranges from robots of a plane leave open")
    assert (
        sentence.endswith("the map says above")
        and (joined.map.values.positions(landmark_key(np.arange(2)), 3)[:, 2] > 0).all()
    )


def test_a_drive_round_what_it_sees_says_nothing() -> None:
    """No alarm."""
    angles = np.linspace(0.0, 5.0, 12)
    way = Pose.from_xytheta(np.stack([4.0 * np.cos(angles), 4.0 * np.sin(angles), angles + np.pi / 2], 1))
    log = drive(way, np.array([[1.0, -0.5], [-1.0, 0.5]]), np.random.default_rng(3))
    assert not accounted(log, join([build(piece) for piece in split(log)])).remarks


@pytest.mark.parametrize(("sigma", "told"), [(0.1, 0), (2.0, 1), (100.0, 1)])
def test_a_landmark_that_was_surveyed_fits_elsewhere_for_what_the_survey_lets_it(sigma: float, told: int) -> None:
    """A straight drive in the world: its mirror six metres off is sixty, three or no sigmas of the survey away."""
    way = Pose.from_xytheta(np.stack([np.linspace(0.0, 6.0, 9), np.zeros(9), np.zeros(9)], 1))
    log = drive(way, np.array([[1.0, 3.0]]), np.random.default_rng(3))
    keys = [pose_key(1, np.arange(9)), landmark_key(np.arange(1))]
    rows = [
        Table(1, source, "position", 2, key[:, None], place, np.eye(2)[None] / by, np.arange(len(key)))
        for source, key, place, by in (
            ("fixes", keys[0], way.translation, SIGMA),
            ("survey", keys[1], np.array([[1.0, 3.0]]), sigma),
        )
    ]
    log = log.with_tables([*log.tables, *rows])
    joined = accounted(log, join([build(piece) for piece in split(log)]))
    assert joined.map.base == WORLD
    found = joined.components[0].second_places
    assert len(found) == len(joined.remarks) == told
    for sentence in joined.remarks:
        more = float(re.search(r"at most (\S+) more", sentence + " at most 0 more")[1])
        assert more == pytest.approx((6.0 / sigma) ** 2, abs=1.5)
