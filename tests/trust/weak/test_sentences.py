"""Sentences are true: what is said to be free can be moved without any measurement noticing; what is said to be known
is known so well, and what turns turns about what is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hung import tied_by_heading, two_halves
from teamslam.geometry import Pose, rotations
from teamslam.model import Kind, Values, robot_of
from teamslam.trust.weak import knowledge_from, weakest_of
from worlds import WORLDS

worlds = st.sampled_from(WORLDS)
seeds = st.integers(0, 10_000)


def turned(values: Values, part: np.ndarray, at: np.ndarray, w: np.ndarray) -> Values:
    """The values with a part turned about a place, by as much as one likes; where robots live in the plane and
    landmarks in space, about the vertical."""
    R = rotations(len(at)).exp(w)
    frame = Pose(R, at - R @ at)
    if len(at) == 3 and (values.layout.kinds == Kind.POSE2).any():
        frame = Pose.from_xytheta(frame.xytheta())
    return values.update(values.select(part).transform(frame))


@settings(max_examples=30)
@given(world=worlds, seed=seeds)
def test_one_common_landmark_is_a_hinge(world: str, seed: int) -> None:
    log = two_halves(world, 1, seed=seed)
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    freedom, said = weak.open[0], weak.open_sentences[0]
    assert len(weak.open) == 1
    assert "landmark 0 against" in said
    keys = log.truth.layout.keys[freedom.part]
    assert {int(r) for r in robot_of(keys) if r} in ({1}, {2})
    assert 0 not in keys.tolist()
    axis = np.random.default_rng(seed).standard_normal(3)
    w = np.array([0.7]) if world == "2d" else np.array([0.0, 0.0, 0.7]) if world == "planar" else axis
    at = log.truth.positions(np.array([0]), 2 if world == "2d" else 3)[0]
    moved = turned(log.truth, freedom.part, at, w)
    for table in log.tables:
        np.testing.assert_allclose(table.predict(moved), table.predict(log.truth), atol=1e-9)


@settings(max_examples=20)
@given(seed=seeds)
def test_two_common_landmarks_in_space_leave_the_turn_about_their_line(seed: int) -> None:
    log = two_halves("3d", 2, seed=seed)
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    (freedom,), (said,) = weak.open, weak.open_sentences
    assert "about the line through landmark 0 and landmark 1 against" in said
    one, other = log.truth.positions(np.array([0, 1]), 3)
    moved = turned(log.truth, freedom.part, one, 0.7 * (other - one) / np.linalg.norm(other - one))
    for table in log.tables:
        np.testing.assert_allclose(table.predict(moved), table.predict(log.truth), atol=1e-9)


@settings(max_examples=20)
@given(world=worlds, seed=seeds)
def test_nothing_in_common_ties_nothing(world: str, seed: int) -> None:
    log = two_halves(world, 0, seed=seed)
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    (freedom,), (said,) = weak.open, weak.open_sentences
    assert freedom.ways == freedom.all_ways == (6 if world == "3d" else 3)
    assert "not tied to" in said


@settings(max_examples=30)
@given(world=worlds, seed=seeds, sigma=st.sampled_from([0.1, 0.21, 0.5]))
def test_a_heading_known_badly_is_found_with_its_hinge_and_its_sigma(world: str, seed: int, sigma: float) -> None:
    """The sigma that was planted; a hair less, as the place that came with it says a little too."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), sigma)
    known = knowledge_from(log.tables, log.truth, log.names)
    weak = weakest_of(known)
    assert not weak.open
    first = weak.directions[0]
    assert first.hinge.pivot == (0,)
    assert first.hinge.kind == "turn"
    assert first.sigma == pytest.approx(sigma, rel=0.05)
    assert "about landmark 0" in first.sentence and "against the rest" in first.sentence
    assert first.explained > 0.95
    assert {int(r) for r in robot_of(log.truth.layout.keys[first.part]) if r} in ({1}, {2})
    assert weak.least.heading_rad < 0.2 * sigma


@settings(max_examples=20)
@given(world=worlds, seed=seeds)
def test_the_function_of_a_hinge_measures_its_turn(world: str, seed: int) -> None:
    """Turning the part by a little about its pivot is a turn by so much, and moving the whole map is none."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), 0.2)
    known = knowledge_from(log.tables, log.truth, log.names)
    hinge, part = weakest_of(known).directions[0].hinge, weakest_of(known).directions[0].part
    moved = turned(log.truth, part, hinge.at, 1e-5 * hinge.axis)
    assert hinge.function @ moved.minus(log.truth) == pytest.approx(1e-5, rel=1e-3)
    np.testing.assert_allclose(hinge.function @ known.frame, 0.0, atol=1e-9)


@settings(max_examples=20)
@given(world=worlds, seed=seeds)
def test_the_part_of_a_direction_moves_as_its_hinge_turns(world: str, seed: int) -> None:
    """To first order: places of the part, turned by a little, are where `moved` says."""
    log = tied_by_heading(two_halves(world, 1, seed=seed), 0.2)
    weak = weakest_of(knowledge_from(log.tables, log.truth, log.names))
    direction, before = weak.directions[0], weak.known.motions.places[weak.directions[0].part]
    keys = log.truth.layout.keys[direction.part]
    after = turned(log.truth, direction.part, direction.hinge.at, 1e-6 * direction.hinge.axis)
    apart = (after.positions(keys, before.shape[1]) - log.truth.positions(keys, before.shape[1])) / 1e-6
    np.testing.assert_allclose(direction.moved(before) / direction.sigma, apart, atol=1e-4)


@pytest.mark.parametrize("world", WORLDS)
def test_with_what_was_said_known_nothing_is_known_less_well(world: str) -> None:
    """The closing figure, against the dense covariance."""
    log = tied_by_heading(two_halves(world, 1), 0.2)
    known = knowledge_from(log.tables, log.truth, log.names)
    weak = weakest_of(known)
    P = known.spread(np.eye(log.truth.layout.dof))
    F = np.stack([d.hinge.function for d in weak.directions], 1)
    left = P - P @ F @ np.linalg.solve(F.T @ P @ F, F.T @ P)
    layout = log.truth.layout
    places = []
    for start, kind in zip(layout.dof_start, layout.kinds, strict=False):
        d = 2 + kind % 2
        places.append(np.sqrt(np.linalg.eigvalsh(left[start : start + d, start : start + d])[-1]))
    assert weak.least.place_m == pytest.approx(max(places), rel=1e-6)
    assert weak.least.place == layout.keys[int(np.argmax(places))]
    assert weak.sentences[-1].startswith("With these known, every place is known to ")
    assert ("in the map as a whole" in weak.sentences[-1]) == (known.frame.shape[1] > 0)  # the frame's own place too
