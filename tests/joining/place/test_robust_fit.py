"""The frame that shared things give: what is known to no finite sigma counts for nothing."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from strategies import generators
from teamslam.geometry import Pose, so3
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.robust_fit import link
from teamslam.model import landmark_key


def seen(places: np.ndarray, variances: np.ndarray) -> Outline:
    """Points that one map knows."""
    n = len(places)
    return Outline(
        landmark_key(np.arange(n)),
        places,
        np.tile(np.eye(3), (n, 1, 1)),
        np.zeros(n, bool),
        variances,
        np.ones(n),
        np.zeros(n, bool),
    )


@given(generators, st.integers(1, 3), st.sampled_from([np.inf, np.nan]))
def test_what_is_not_known_ties_nothing(rng: np.random.Generator, lost: int, unknown: float) -> None:
    """The link is that of the others; where there are no others it holds nothing."""
    places = np.pad(rng.uniform(-9.0, 9.0, (4, 2)), ((0, 0), (0, 1)))
    frame = Pose.from_xytheta(rng.uniform(-3.0, 3.0, 3))
    moved = np.pad(frame.act(places[:, :2]), ((0, 0), (0, 1)))
    variances = np.full(4, 1e-4)
    whole = link(seen(moved[lost:], variances[lost:]), seen(places[lost:], variances[lost:]), True)
    variances[:lost] = unknown
    found = link(seen(moved, variances), seen(places, variances), True)
    np.testing.assert_allclose(found.frame.minus(whole.frame), 0.0, atol=1e-9)
    nothing = link(seen(moved, np.full(4, unknown)), seen(places, variances), True)
    assert not nothing.holds and not len(nothing.shared)


@given(generators, st.integers(1, 3))
def test_things_that_are_tilted_tell_a_frame_of_the_ground(rng: np.random.Generator, count: int) -> None:
    """Tags on walls and ceilings, which planar robots know as poses in space: one alone tells the frame."""
    tags = Pose(so3.exp(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)))
    frame = Pose.from_xytheta(rng.uniform(-3.0, 3.0, 3))
    there = frame.lift(3) @ tags
    theirs, mine = (
        replace(seen(p.translation, np.full(count, 1e-4)), turns=p.rotation, oriented=np.ones(count, bool))
        for p in (tags, there)
    )
    found = link(mine, theirs, True)
    assert found.holds
    np.testing.assert_allclose(found.frame.minus(frame), 0.0, atol=1e-9)
