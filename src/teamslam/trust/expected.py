"""What a measurement costs on average when the model is right: the yardstick of the verdict on the fit.

A row of r numbers is whitened, so at the truth its residual u is white noise and s = |u|^2 is chi-square distributed
with r degrees of freedom. Under a loss rho the row costs rho(s), of which mean and variance are integrals over that
distribution; for the squared loss they are r and 2r.

At the optimum all rows together cost less, because p unknowns gave way. With u -> u - A d, the cost to second order is

    sum rho(s)  -  2 d' sum A'(w u)  +  d' M d,       w = rho'(s),   M = sum kappa A'A,   kappa = E[w s] / r

(half the second derivative of rho(|u|^2), in the mean, by Stein's lemma), lowest at d = M^-1 sum A'(w u). There it is
lower by

    sum_i (beta / kappa) h_i,         beta = E[w^2 s] / r,   h_i = kappa tr(A_i M^-1 A_i'),   sum h_i = p

`given_way` is beta / kappa: by how much the cost falls for each unknown; 1 for the squared loss. For one number a row
it is in Huber, Ronchetti, "Robust Statistics" (2009), ch. 7.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from teamslam.geometry import Array
from teamslam.model import Loss

FARTHEST = 12.0  # [sigmas] beyond the mean length of a residual: what lies farther has no weight in double precision
NODES = 64


@dataclass(frozen=True)
class Expected:
    """Of a row at the truth: `mean` and `variance` of its cost; `given_way`: how much of it an unknown takes away."""

    mean: float
    variance: float
    given_way: float


@lru_cache
def expected_cost(loss: Loss, rows: int) -> Expected:
    """What a row of `rows` numbers costs under a loss when the model is right."""
    length, share = _lengths(loss.scale, rows)
    s = length**2
    cost, weight = loss.cost(s), loss.weight(s)
    mean = float(share @ cost)
    return Expected(
        mean=mean,
        variance=float(share @ (cost - mean) ** 2),
        given_way=float(share @ (weight**2 * s)) / float(share @ (weight * s)),
    )


def _lengths(knee: float, rows: int) -> tuple[Array, Array]:
    """Lengths |u| of residuals of `rows` numbers and the probability that each stands for: Gauss and Legendre's nodes
    on both sides of the `knee`, where a loss may bend (Huber's does)."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    end = np.sqrt(rows) + FARTHEST
    edges = [0.0, knee, end] if knee < end else [0.0, end]
    nodes, shares = [], []
    for low, high in pairwise(edges):
        at = low + 0.5 * (high - low) * (x + 1.0)
        nodes.append(at)
        shares.append(0.5 * (high - low) * w * _density(at, rows))
    return np.concatenate(nodes), np.concatenate(shares)


def _density(length: Array, rows: int) -> Array:
    """Of the chi distribution: how likely white noise of `rows` numbers is so long."""
    from scipy.special import gammaln

    log = (rows - 1) * np.log(length) - 0.5 * length**2 - (0.5 * rows - 1.0) * np.log(2.0) - gammaln(0.5 * rows)
    return np.asarray(np.exp(log))
