"""Whether any direction stands out, by a few steps of Lanczos, beside the spectrum that was planted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import random_poses
from teamslam.geometry import Array, IntArray
from teamslam.model import Kind, Names, Values, pose_key
from teamslam.trust.weak.directions import Conditioned
from teamslam.trust.weak.knowledge import Knowledge, worst_variances
from teamslam.trust.weak.motions import Motions
from teamslam.trust.weak.weakest import STANDS_OUT

POSES = 110  # of the plane: too many to be decomposed whole
DOF = 3 * POSES


class Planted:
    """The covariance C of a map in the world: M^-1/2 U diag(variances) U' M^-1/2."""

    def __init__(self, ways: Array, variances: Array) -> None:
        self.C = (ways * variances) @ ways.T

    def solve(self, right: Array) -> Array:
        return np.asarray(self.C @ right)

    def marginals_by_size(self) -> list[tuple[IntArray, Array]]:
        at = np.arange(DOF).reshape(POSES, 3)
        return [(np.arange(POSES), self.C[at[:, :, None], at[:, None, :]])]


def planted(variances: Array, seed: int) -> Conditioned:
    rng = np.random.default_rng([seed, 1])
    poses = random_poses(rng, 2, POSES)
    values = Values.of({Kind(0): (pose_key(1, np.arange(POSES)), poses)})
    motions = Motions(values, 2.0)
    ways = np.linalg.qr(rng.standard_normal((DOF, DOF)))[0] / np.sqrt(motions.weight)[:, None]
    nothing = np.zeros((DOF, 0))
    return Conditioned(Knowledge(values, Names(), motions, nothing, nothing, Planted(ways, variances)), nothing)


@settings(max_examples=25, deadline=None)
@given(
    first=st.floats(0.02, 0.9),
    alike=st.integers(0, 3),
    fall=st.floats(0.0, 4.0),
    left=st.integers(1, DOF - 5),
    seed=st.integers(0, 10**6),
)
def test_what_stands_out_is_never_missed(first: float, alike: int, fall: float, left: int, seed: int) -> None:
    """Whatever the others: as large as the first, many alike, or falling away slowly or fast."""
    others = (1.0 + np.arange(left)) ** -fall
    variances = np.zeros(DOF)
    variances[: 1 + alike] = first / (1 + alike)
    variances[1 + alike : 1 + alike + left] = (1.0 - first) * others / others.sum()
    left_over = planted(variances, seed)
    largest = variances.max()
    assert left_over.total == pytest.approx(1.0, rel=1e-9)
    assert left_over._sketch[1] <= largest * (1.0 + 1e-9)
    if largest >= STANDS_OUT:
        assert left_over.may_carry(STANDS_OUT)
        assert left_over.weakest()[1] == pytest.approx(largest, rel=1e-5)
    if largest < 0.5 * STANDS_OUT:
        assert not left_over.may_carry(STANDS_OUT)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_known_least_is_found_without_looking_at_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    left = planted(rng.exponential(size=DOF) ** 3, seed)
    some = np.zeros((DOF, 2))
    some[rng.choice(DOF, 2, replace=False), [0, 1]] = 1.0
    left = Conditioned(left.knowledge, some)
    layout = left.knowledge.values.layout
    places, headings = worst_variances(layout, left.few(np.arange(POSES)))
    assert left.least.place == layout.keys[np.argmax(places)]
    assert left.least.heading == layout.keys[np.argmax(headings)]
    assert left.least.place_m == pytest.approx(np.sqrt(places.max()), rel=1e-9)
    assert left.least.heading_rad == pytest.approx(np.sqrt(headings.max()), rel=1e-9)
