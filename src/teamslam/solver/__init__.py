"""Nonlinear weighted least squares over poses and points. It cannot know what a submap is for."""

from teamslam.kernel import Gaussian
from teamslam.solver.condensed import Condensed
from teamslam.solver.covariance import Covariances
from teamslam.solver.dense import moved, normal_equations, seen, told
from teamslam.solver.graduated import Graduated, optimise_graduated
from teamslam.solver.linear import Factor, Matrix, block_matrix
from teamslam.solver.numeric import linearise_numerically
from teamslam.solver.optimise import Options, optimise
from teamslam.solver.parallel import each_side_by_side, meanwhile, side_by_side
from teamslam.solver.reach import convex_start, firm, reach, refuse_rounding
from teamslam.solver.rules import RULES
from teamslam.solver.settled import settled
from teamslam.solver.solution import SAME, Solution, Status, Step
from teamslam.solver.system import Linearised, SubmapTerm, System

__all__ = [
    "RULES",
    "SAME",
    "Condensed",
    "Covariances",
    "Factor",
    "Gaussian",
    "Graduated",
    "Linearised",
    "Matrix",
    "Options",
    "Solution",
    "Status",
    "Step",
    "SubmapTerm",
    "System",
    "block_matrix",
    "convex_start",
    "each_side_by_side",
    "firm",
    "linearise_numerically",
    "meanwhile",
    "moved",
    "normal_equations",
    "optimise",
    "optimise_graduated",
    "reach",
    "refuse_rounding",
    "seen",
    "settled",
    "side_by_side",
    "told",
]
