"""Ceres from PyPI (pyceres): Gauss-Newton steps with its sparse Cholesky, cost functions in Python.

The wheel has no factors for this problem, so nearly all of the time goes into Python calls, one a measurement and
evaluation; they take one thread. A pose is a block of d coordinates and one of its heading, or of a quaternion x y z w.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyceres

from problems import Estimate, Problem

from . import residuals


@dataclass
class Model:
    """The problem as Ceres sees it, and the blocks that it writes its estimate into."""

    problem: Any
    places: list[np.ndarray]
    turns: list[np.ndarray]
    points: list[np.ndarray]


def version() -> str:
    return f"{pyceres.__version__} (Ceres {pyceres.__ceres_version__})"


def warm(problem: Problem) -> None:
    """Nothing to prepare."""


def build(problem: Problem, variant: str) -> Model:
    options = pyceres.ProblemOptions()
    options.disable_all_safety_checks = True
    ceres = pyceres.Problem(options)
    places, points = list(problem.start_T.copy()), list(problem.start_P.copy())
    turns = list(residuals.turns(problem.start_R))
    for place, turn in zip(places, turns, strict=True):
        ceres.add_parameter_block(place, len(place))
        ceres.add_parameter_block(turn, len(turn))
        if problem.dim == 3:
            ceres.set_manifold(turn, pyceres.EigenQuaternionManifold())
    for a, T, R in zip(problem.odometry_from.tolist(), problem.odometry_T, problem.odometry_R, strict=True):
        ceres.add_residual_block(Step(T, R), None, [places[a], turns[a], places[a + 1], turns[a + 1]])
    for a, mark, z in zip(problem.seen_from.tolist(), problem.seen.tolist(), problem.sightings, strict=True):
        ceres.add_residual_block(Sighting(z), None, [places[a], turns[a], points[mark]])
    ceres.set_parameter_block_constant(places[0])
    ceres.set_parameter_block_constant(turns[0])
    return Model(ceres, places, turns, points)


def solve(model: Model) -> tuple[Model, int]:
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.SPARSE_NORMAL_CHOLESKY
    options.sparse_linear_algebra_library_type = pyceres.SparseLinearAlgebraLibraryType.SUITE_SPARSE
    options.max_num_iterations = 50
    options.function_tolerance = 1e-8
    options.gradient_tolerance = options.parameter_tolerance = 0.0
    options.initial_trust_region_radius = 1e16  # Gauss-Newton steps
    options.max_trust_region_radius = 1e20
    options.logging_type = pyceres.LoggingType.SILENT
    summary = pyceres.SolverSummary()
    pyceres.solve(options, model.problem, summary)
    return model, summary.num_linear_solves


def read(model: Model) -> Estimate:
    R = np.array([residuals.rotation(turn) for turn in model.turns])
    return Estimate(np.array(model.places), R, np.array(model.points))


def marginals(model: Model) -> float:
    options = pyceres.CovarianceOptions()
    options.algorithm_type = pyceres.CovarianceAlgorithmType.SPARSE_QR
    options.sparse_linear_algebra_library_type = pyceres.SparseLinearAlgebraLibraryType.SUITE_SPARSE
    found = pyceres.Covariance(options)
    found.compute([(point, point) for point in model.points], model.problem)
    return float(sum(np.trace(found.get_covariance_block(point, point)) for point in model.points))


class Step(pyceres.CostFunction):
    """Odometry between two poses."""

    def __init__(self, T: np.ndarray, R: np.ndarray) -> None:
        super().__init__()
        self.z, self.d = (T, R), len(T)
        turn = 1 if self.d == 2 else 4
        self.set_num_residuals(3 * (self.d - 1))
        self.set_parameter_block_sizes([self.d, turn] * 2)

    def Evaluate(self, x: Any, e: np.ndarray, jacobians: Any) -> bool:
        first, second = (x[0], residuals.rotation(x[1])), (x[2], residuals.rotation(x[3]))
        e[:], A, B = residuals.step(self.z, first, second)
        if jacobians is not None:
            d = self.d
            blocks = (A[:, :d], residuals.by_numbers(A[:, d:], x[1]), B[:, :d], residuals.by_numbers(B[:, d:], x[3]))
            _fill(jacobians, blocks)
        return True


class Sighting(pyceres.CostFunction):
    """A landmark seen from a pose."""

    def __init__(self, z: np.ndarray) -> None:
        super().__init__()
        self.z, self.d = z, len(z)
        self.set_num_residuals(self.d)
        self.set_parameter_block_sizes([self.d, 1 if self.d == 2 else 4, self.d])

    def Evaluate(self, x: Any, e: np.ndarray, jacobians: Any) -> bool:
        e[:], A, B = residuals.sighting(self.z, (x[0], residuals.rotation(x[1])), x[2])
        if jacobians is not None:
            _fill(jacobians, (A[:, : self.d], residuals.by_numbers(A[:, self.d :], x[1]), B))
        return True


def _fill(jacobians: Any, blocks: tuple[np.ndarray, ...]) -> None:
    for wanted, block in zip(jacobians, blocks, strict=True):
        if wanted is not None and wanted.size:
            wanted[:] = block.ravel()
