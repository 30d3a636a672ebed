"""The largest clique is the largest, and a clique."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teamslam.trust.outliers.clique import largest_clique


def graph(n: int, density: float, seed: int) -> np.ndarray:
    upper = np.triu(np.random.default_rng(seed).random((n, n)) < density, 1)
    return upper | upper.T


def agrees(of: np.ndarray, members: tuple[int, ...]) -> bool:
    return all(of[a, b] for a, b in itertools.combinations(members, 2))


@given(n=st.integers(1, 9), density=st.floats(0.0, 1.0), seed=st.integers(0, 1000))
def test_no_set_is_larger(n: int, density: float, seed: int) -> None:
    of = graph(n, density, seed)
    found = largest_clique(of)
    assert found.proven and agrees(of, tuple(np.flatnonzero(found.members)))
    larger = itertools.combinations(range(n), found.size + 1)
    assert not any(agrees(of, members) for members in larger)


@given(seed=st.integers(0, 100))
def test_out_of_steps_it_is_still_a_clique_that_nobody_can_join(seed: int) -> None:
    of = graph(60, 0.8, seed)
    found = largest_clique(of, steps=3)
    assert not found.proven and agrees(of, tuple(np.flatnonzero(found.members)))
    outside = np.flatnonzero(~found.members)
    assert not of[np.ix_(outside, np.flatnonzero(found.members))].all(1).any()
    assert found.size <= largest_clique(of).size


def test_a_planted_clique_is_found() -> None:
    of = graph(150, 0.3, 1)
    planted = np.random.default_rng(2).choice(150, 25, replace=False)
    of[np.ix_(planted, planted)] = True
    found = largest_clique(of)
    assert found.proven and set(planted.tolist()) == set(np.flatnonzero(found.members).tolist())


def test_nobody_is_nobody() -> None:
    assert largest_clique(np.zeros((0, 0), bool)).size == 0 and largest_clique(np.zeros((3, 3), bool)).size == 1
