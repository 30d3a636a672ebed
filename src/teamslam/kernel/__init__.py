"""The native kernel: arrays in, arrays out. Only the solver speaks to it; everything above speaks of keys and values.

Conventions. Variables have kinds 0 pose2 (3 unknowns, 6 numbers), 1 pose3 (6, 12), 2 point2 (2, 2), 3 point3 (3, 3).
A state is one flat vector, variable after variable, a pose as T and then R row by row (body to world). Retraction:
T + dT, R Exp(dw). A residual is e = z (-) h, whitened by W (inverse covariance W'W); J = -de/dx; the step solves
H d = g with H = sum J'W'WJ and g = sum J'W'We; the cost is sum rho(|We|^2), without a factor 1/2.

    problem = Problem(kinds, fixed)
    problem.add_table("point", 3, index, z, whitening)
    cost, gradient, values = problem.linearise(state)
    factor = Factor(problem.pattern)
    factor.factor(values)
    state = problem.retract(state, factor.solve(gradient))
"""

from teamslam.kernel.analysis import POSITIONS_HELP_FROM, Analysis
from teamslam.kernel.condensation import Condensation
from teamslam.kernel.factor import Factor, NotPositiveDefinite, Statistics
from teamslam.kernel.filter import Gaussian, Rows, UserRows, moved, seen, told
from teamslam.kernel.library import set_threads, threads
from teamslam.kernel.normal_equations import normal_equations
from teamslam.kernel.pattern import BlockPattern
from teamslam.kernel.problem import CURVATURES, LOSSES, MODELS, MOST_DOF, Problem, table_arguments

__all__ = [
    "CURVATURES",
    "LOSSES",
    "MODELS",
    "MOST_DOF",
    "POSITIONS_HELP_FROM",
    "Analysis",
    "BlockPattern",
    "Condensation",
    "Factor",
    "Gaussian",
    "NotPositiveDefinite",
    "Problem",
    "Rows",
    "Statistics",
    "UserRows",
    "moved",
    "normal_equations",
    "seen",
    "set_threads",
    "table_arguments",
    "threads",
    "told",
]
