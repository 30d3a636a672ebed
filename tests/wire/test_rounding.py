"""The bounds hold: on the estimate, on the information in every direction, and on the map that is joined."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from strategies import random_values, seeds
from teamslam.errors import InputError
from teamslam.joining import build, join, separators, split
from teamslam.model import Kind, Values
from teamslam.wire import COMPACT, Precision, receive, send, shift_bound
from teamslam.wire.rounding import (
    FORMS,
    coupled_pairs,
    restore_estimate,
    restore_information,
    round_estimate,
    round_information,
    within,
)
from worlds import WORLDS, team


def spread_information(values: Values, rng: np.random.Generator, decades: float) -> sp.csr_array:
    """Positive definite, with eigenvalues over so many decades."""
    n = values.layout.dof
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    matrix = (q * 10.0 ** rng.uniform(0.0, decades, n)) @ q.T
    return sp.csr_array(0.5 * (matrix + matrix.T))


def relative_change(exact: sp.csr_array, rounded: sp.csr_array) -> float:
    lower = np.linalg.cholesky(exact.toarray())
    change = np.linalg.solve(lower, np.linalg.solve(lower, (rounded - exact).toarray()).T)
    return float(np.abs(np.linalg.eigvalsh(change)).max())


@given(seeds, st.sampled_from([0.3, 0.03, 1e-4]), st.floats(0.0, 6.0))
def test_the_estimate_moves_by_no_more_than_said(seed: int, limit: float, decades: float) -> None:
    rng = np.random.default_rng(seed)
    values = random_values(rng, {kind: 2 for kind in Kind})
    information = spread_information(values, rng, decades)
    integers, exponents, shift = round_estimate(values, information, limit)
    error = restore_estimate(values.layout, integers, exponents).minus(values)
    assert np.sqrt(error @ (information @ error)) <= limit
    assert_allclose(np.sqrt(error @ (information @ error)), shift, rtol=1e-9)


@given(seeds, st.sampled_from([0.1, 0.01, 1e-4]), st.floats(0.0, 6.0))
def test_the_information_changes_by_no_more_than_said_in_any_direction(seed: int, eta: float, decades: float) -> None:
    rng = np.random.default_rng(seed)
    values = random_values(rng, {kind: 2 for kind in Kind})
    information = spread_information(values, rng, decades)
    pairs = coupled_pairs(values.layout, information)
    forms = round_information(values.layout, pairs, information, eta)
    assert {rounded.form for rounded in forms} == set(FORMS)
    for rounded in forms:
        restored = restore_information(values.layout, pairs, rounded)
        assert relative_change(information, restored) <= eta * (1.0 + 1e-6)
        assert abs(restored - restored.T).max() == 0.0


def test_a_bound_that_is_broken_is_seen() -> None:
    rng = np.random.default_rng(0)
    values = random_values(rng, {Kind.POINT2: 3})
    information = spread_information(values, rng, 3.0)
    assert within(values.layout, information, sp.csr_array(1.009 * information), 0.01)
    assert not within(values.layout, information, sp.csr_array(1.011 * information), 0.01)
    assert not within(values.layout, information, sp.csr_array(0.989 * information), 0.01)


def test_error_feedback_does_not_mind_a_direction_that_is_hardly_known() -> None:
    rng = np.random.default_rng(1)
    values = random_values(rng, {Kind.POINT2: 8})
    sizes = []
    for decades in (1.0, 8.0):
        information = spread_information(values, rng, decades)
        pairs = coupled_pairs(values.layout, information)
        forms = round_information(values.layout, pairs, information, 0.01)
        sizes.append({r.form: np.log2(1.0 + np.abs(r.integers)).sum() for r in forms})
    assert sizes[1]["entries"] > 2.0 * sizes[0]["entries"]
    assert sizes[1]["root"] < 0.7 * sizes[1]["entries"]


@pytest.mark.parametrize("precision", [COMPACT, Precision(0.1, 0.05), Precision(1e-3, 1e-4)])
@pytest.mark.parametrize("world", WORLDS)
def test_the_joined_map_moves_by_no_more_than_the_bound(world: str, precision: Precision) -> None:
    submaps = [build(piece) for piece in split(team(world, poses=10, landmarks=4, sees=0.6), poses_per_piece=100)]
    needed = separators(submaps)
    messages = [send("condensed", s, needed[s.id], precision) for s in submaps]
    for message in messages:
        assert message.rounding.shift_sigma <= precision.shift_sigma
        assert message.rounding.information <= precision.information
    received = [receive(message.data) for message in messages]
    exact = join([receive(send("condensed", s, needed[s.id]).data).submap() for s in submaps]).map
    rounded = join([r.submap() for r in received]).map
    shift = rounded.values.minus(exact.values)
    moved = np.sqrt(shift @ (exact.information @ shift))
    bound = shift_bound(rounded, [(r.submap(), r.rounding) for r in received])
    assert moved <= bound
    assert bound < 20.0 * precision.shift_sigma  # a bound worth having


def test_precisions_that_no_rounding_can_keep_are_refused() -> None:
    with pytest.raises(InputError, match="shift_sigma is 0"):
        Precision(shift_sigma=-1.0)
    with pytest.raises(InputError, match="information is 0"):
        Precision(information=0.9)
