"""Leaving a part of a least-squares problem out, by the factor of the whole.

    H, C = H^-1 on the part's unknowns, C = L L'       of the whole, at its optimum
    P = L' H_k L                                       how far the part was followed: eigenvalues in [0, 1]
    y = -L (I - P)^+ L' g_k                            where its unknowns go without it
    d = H^-1 E (H_k y - g_k)                           where all unknowns go
    f_k + g_k' L (I - P)^+ L' g_k                      by how much the whole then costs less

With eigenvalue 1 go directions that nobody but the part determines: they cost nothing and check nothing, and d leaves
them where they are. The others, `dof` of them, are what the rest has to say of the part; if the model is right, the
cost falls by chi-square of so many degrees of freedom. To second order around the optimum all of this is exact.

Source: Cook, Weisberg, "Residuals and Influence in Regression" (1982), sec. 3.2 and appendix A.2, for groups of rows.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.solver import Factor
from teamslam.trust.influence.parts import Part

UNCHECKED = 1e-6  # of 1 - P: what the rest knows a thousand times worse than the part itself


@dataclass(frozen=True, eq=False)
class Downdate:
    """A problem without one of its parts: `decrease` of the cost, the `dof` of the part that the rest checks, and the
    `shift` of all unknowns (n,)."""

    decrease: float
    dof: int
    shift: Array


def left_out(part: Part, factor: Factor) -> Downdate:
    """The whole problem, of which `factor` is the factor of H, without a part.

    Law: with quadratic costs, what the rest alone would cost, and where it would be.
    """
    columns = np.zeros((factor.layout.dof, len(part.at)))
    columns[part.at, np.arange(len(part.at))] = 1.0
    columns = factor.solve(columns)
    covariance = columns[part.at]
    root = np.linalg.cholesky(0.5 * (covariance + covariance.T))
    followed, ways = np.linalg.eigh(root.T @ part.information @ root)
    open_ = 1.0 - followed
    checked = open_ > UNCHECKED
    pull = ways[:, checked].T @ (root.T @ part.gradient)
    moved = -root @ (ways[:, checked] @ (pull / open_[checked]))
    decrease = part.cost + float(pull @ (pull / open_[checked]))
    # Each unknown takes one number; those that the part alone determines take as many of its own.
    dof = part.rows - int(np.count_nonzero(~checked))
    return Downdate(max(decrease, 0.0), dof, np.asarray(columns @ (part.information @ moved - part.gradient)))
