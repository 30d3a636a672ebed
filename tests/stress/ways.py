"""WAYS: how a robot moves, by name: from a generator, the number of steps and the degrees of freedom (3 or 6) to the
tangents (n, dof) of its steps, forward, sideways (and up), turns last.
"""

from collections.abc import Callable

import numpy as np

from teamslam.geometry import Array

STEP = 0.7  # [m]


def _steps(n: int, dof: int, forward: Array | float = 0.0, turn: Array | float = 0.0) -> Array:
    out = np.zeros((n, dof))
    out[:, 0], out[:, -1] = forward, turn
    return out


def _circle(rng: np.random.Generator, n: int, dof: int) -> Array:
    steps = _steps(n, dof, STEP, rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.5))
    if dof == 6:
        steps[:, 3:5] = rng.normal(scale=0.05, size=2)
    return steps


def _square(rng: np.random.Generator, n: int, dof: int) -> Array:
    return _steps(n, dof, STEP, np.where(np.arange(n) % 4 == 3, 0.5 * np.pi, 0.0))


def _there_and_back(rng: np.random.Generator, n: int, dof: int) -> Array:
    return _steps(n, dof, np.where(np.arange(n) < n / 2, STEP, -STEP))


def _walk(rng: np.random.Generator, n: int, dof: int) -> Array:
    d = 2 if dof == 3 else 3
    return np.concatenate([rng.normal(scale=STEP, size=(n, d)), rng.normal(scale=0.4, size=(n, dof - d))], -1)


def _jumps(rng: np.random.Generator, n: int, dof: int) -> Array:
    d = 2 if dof == 3 else 3
    turns = rng.uniform(-1.0, 1.0, (n, dof - d)) * np.pi / np.sqrt(dof - d)
    return np.concatenate([rng.normal(scale=10.0, size=(n, d)), turns], -1)


def _stop_and_go(rng: np.random.Generator, n: int, dof: int) -> Array:
    moves = rng.integers(0, 3, n)
    return _steps(n, dof, np.where(moves == 1, STEP, 0.0), np.where(moves == 2, 0.6, 0.0))


WAYS: dict[str, Callable[[np.random.Generator, int, int], Array]] = {
    "circle": _circle,
    "straight": lambda rng, n, dof: _steps(n, dof, STEP),
    "turn": lambda rng, n, dof: _steps(n, dof, 0.0, 0.5),
    "stand": lambda rng, n, dof: _steps(n, dof),
    "half-turns": lambda rng, n, dof: _steps(n, dof, STEP, np.pi),
    "square": _square,
    "there-and-back": _there_and_back,
    "walk": _walk,
    "jumps": _jumps,
    "stop-and-go": _stop_and_go,
}
