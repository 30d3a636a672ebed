"""SymForce from PyPI: its Optimizer in C++ with Gauss-Newton steps, linearised numerically by functions in Python.

Nearly all of the time goes into these calls, one a measurement and evaluation. (SymForce's own way to speed is to
generate a program in C++ from symbols, beforehand; the wheel by itself has no compiler.)
"""

from dataclasses import dataclass
from importlib.metadata import version as of
from typing import Any

import numpy as np
import sym
from symforce.opt.numeric_factor import NumericFactor
from symforce.opt.optimizer import Optimizer
from symforce.values import Values

from problems import Estimate, Problem

from . import residuals

Linearised = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # e, J, J'J, J'e


@dataclass
class Model:
    """The problem as SymForce sees it: pose k is called xk, landmark k pk."""

    problem: Problem
    optimiser: Any
    values: Any


def version() -> str:
    return of("symforce")


def warm(problem: Problem) -> None:
    """Nothing to prepare."""


def build(problem: Problem, variant: str) -> Model:
    factors = []
    for a, T, R in zip(problem.odometry_from.tolist(), problem.odometry_T, problem.odometry_R, strict=True):
        factors.append(_factor(f"x{a}", f"x{a + 1}", _step(T, R)))
    for a, mark, z in zip(problem.seen_from.tolist(), problem.seen.tolist(), problem.sightings, strict=True):
        factors.append(_factor(f"x{a}", f"p{mark}", _sighting(z)))
    poses = {f"x{k}": pose for k, pose in enumerate(_poses(problem.start_T, problem.start_R))}
    points = {f"p{k}": point for k, point in enumerate(problem.start_P)}
    params = Optimizer.Params(initial_lambda=1e-12, early_exit_min_reduction=1e-8, iterations=50)
    return Model(problem, Optimizer(factors, params=params), Values(**poses, **points))


def solve(model: Model) -> tuple[Model, int]:
    result = model.optimiser.optimize(model.values)
    model.values = result.optimized_values
    return model, len(result.iterations) - 1


def read(model: Model) -> Estimate:
    n, m = len(model.problem.robots), len(model.problem.start_P)
    poses = [_arrays(model.values[f"x{k}"]) for k in range(n)]
    T, R = (np.array(part) for part in zip(*poses, strict=True))
    return Estimate(T, R, np.array([np.ravel(model.values[f"p{k}"]) for k in range(m)]))


def marginals(model: Model) -> float:
    found = model.optimiser.compute_all_covariances(model.values)
    return float(sum(np.trace(found[f"p{k}"]) for k in range(len(model.problem.start_P))))


def _factor(first: str, second: str, evaluate: Any) -> Any:
    """A factor between two variables, of which the problem's first pose stays where it is."""
    free = [name for name in (first, second) if name != "x0"]

    def linearise(one: Any, other: Any) -> Linearised:
        e, A, B = evaluate(one, other)
        J = np.concatenate([A, B], 1) if len(free) == 2 else B
        return e, J, J.T @ J, J.T @ e

    return NumericFactor([first, second], free, linearise)


def _step(T: np.ndarray, R: np.ndarray) -> Any:
    def evaluate(one: Any, other: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        e, A, B = residuals.step((T, R), _arrays(one), _arrays(other))
        return e, _turn_first(A, len(T)), _turn_first(B, len(T))

    return evaluate


def _sighting(z: np.ndarray) -> Any:
    def evaluate(one: Any, other: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        e, A, B = residuals.sighting(z, _arrays(one), np.ravel(other))
        return e, _turn_first(A, len(z)), B

    return evaluate


def _turn_first(by_pose: np.ndarray, d: int) -> np.ndarray:
    """Derivatives by [w, dT], as SymForce has them, of those by [dT, w]."""
    return np.concatenate([by_pose[:, d:], by_pose[:, :d]], 1)


def _poses(T: np.ndarray, R: np.ndarray) -> list[Any]:
    planar = T.shape[1] == 2
    turns = R[:, :, 0] if planar else residuals.turns(R)
    pose = sym.Pose2 if planar else sym.Pose3
    return [pose.from_storage(row) for row in np.concatenate([turns, T], 1).tolist()]


def _arrays(pose: Any) -> residuals.Pose:
    """T and R of one of SymForce's poses: its numbers are those of the rotation, then the place."""
    numbers = np.array(pose.data)
    if len(numbers) == 4:
        c, s = pose.data[:2]
        return numbers[2:], np.array([[c, -s], [s, c]])
    return numbers[4:], residuals.rotation(numbers[:4])
