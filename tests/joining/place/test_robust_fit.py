"""The frame that shared things give: what is known to no finite sigma counts for nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from strategies import generators
from teamslam.geometry import Pose
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
