"""Whether a map is as sure as it should be.

    NEES   e' I e  with e = truth (-) estimate: chi-square with as many degrees of freedom as e has numbers, if the
           information is honest and the errors are small. Divided by these it is near 1: above, overconfident.

It is taken over all variables at once, since their errors hang together. Two things are put right for it:

- What the truth does not know is no part of e: it is marginalised out of I (a Schur complement).
- The map's frame is its base pose. Where the truth knows that pose, the truth is written in its frame. Where it does
  not, the frame is fitted, such that e' I e is least, and the 3 (or 6) degrees of freedom of the fit are subtracted.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), 5.4.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from teamslam.geometry import AnyArray, Array, Pose
from teamslam.metrics.frames import Aligned, as_kinds, in_another_world, truth_at_base
from teamslam.model import Submap, Values, chi2_quantile, is_pose
from teamslam.model.sparse import sp

CONFIDENCE = 0.95
FORGIVEN = 1e-6  # of the squared residuals: less is rounding
_STEP = 1e-6


class Marginals(Protocol):
    """Who knows marginal covariances, such as `teamslam.solver.Covariances`."""

    def blocks(self, keys: AnyArray) -> Sequence[Array]:
        """The marginal covariances of variables, in the order of `keys`."""

    def joint(self, asked: AnyArray) -> Array:
        """The joint covariance of several variables, dense, in the order asked."""


@dataclass(frozen=True)
class ChiSquare:
    """A sum of squares that should be chi-square with `dof` degrees of freedom."""

    value: float
    dof: int

    @property
    def per_dof(self) -> float | None:
        """Near 1 if all is honest; None without degrees of freedom."""
        return self.value / self.dof if self.dof > 0 else None

    @property
    def band(self) -> tuple[float, float] | None:
        """Where 95 % of honest ones lie, divided by dof."""
        if self.dof <= 0:
            return None
        tail = 0.5 - 0.5 * CONFIDENCE
        return chi2_quantile(tail, self.dof) / self.dof, chi2_quantile(1.0 - tail, self.dof) / self.dof

    @property
    def inside(self) -> bool | None:
        """Whether it lies in its band."""
        return None if self.band is None or self.per_dof is None else self.band[0] <= self.per_dof <= self.band[1]


@dataclass(frozen=True)
class MarginalNees:
    """NEES of variables one by one: its mean, divided by dof, and the share of variables within their 95 % region.

    They are not independent of each other, so there is no band for the mean.
    """

    per_dof: float
    share_inside: float


@dataclass(frozen=True)
class Consistency:
    """`nees` of all variables that the truth knows, `of_poses` and `of_landmarks` one by one; None where unknown.

    `frame` says where the truth was brought into the map: 'base' (truth of the base pose), 'fitted', or 'world'.
    """

    nees: ChiSquare
    of_poses: MarginalNees | None
    of_landmarks: MarginalNees | None
    frame: str


def consistency(submap: Submap, truth: Values, aligned: Aligned, covariances: Marginals | None) -> Consistency | None:
    """NEES of a map. None where the truth knows no variable but the frame."""
    there = in_frame(submap, truth, aligned)
    known = there.known
    if not len(known):
        return None
    estimate = submap.values.only(known.layout.keys)
    error = known.minus(estimate)
    value = float(error @ Information.of(submap, known).times(error))
    return Consistency(
        ChiSquare(value, known.layout.dof - there.fitted),
        _one_by_one(known, estimate, covariances, robots=True),
        _one_by_one(known, estimate, covariances, robots=False),
        there.frame,
    )


@dataclass(frozen=True, eq=False)
class InFrame:
    """What a truth knows of a map's variables, in the map's `frame` ('base', 'fitted' or 'world') and kinds, and how
    many numbers were `fitted` for that."""

    known: Values
    frame: str
    fitted: int


def in_frame(submap: Submap, truth: Values, aligned: Aligned) -> InFrame:
    """A truth in the frame of a map that is `aligned` with it."""
    known = truth_at_base(submap, truth)
    if known is not None and not in_another_world(submap, aligned):
        return InFrame(known, "world" if submap.base < 0 else "base", 0)
    fitted = _fit_frame(submap, as_kinds(truth, submap.values.layout), aligned)
    return InFrame(fitted, "fitted", aligned.pose.dof)


def fit_of(submap: Submap) -> ChiSquare | None:
    """How well the measurements fit the map: squared whitened residuals against rows - unknowns; None where losses
    forgave some of them, since these sums are of no chi-square."""
    forgave = submap.cost < submap.chi2 * (1.0 - FORGIVEN)
    return None if forgave else ChiSquare(submap.chi2, submap.rows - submap.dof)


@dataclass(frozen=True, eq=False)
class Information:
    """The information of the variables that the truth knows, the others marginalised out: I_kk - I_ku I_uu^-1 I_uk."""

    known: sp.csr_array
    across: sp.csr_array
    unknown: object | None

    @classmethod
    def of(cls, submap: Submap, known: Values) -> "Information":
        """That of a map over the variables of `known`."""
        layout, none = submap.values.layout, sp.csr_array((known.layout.dof, 0))
        if np.array_equal(layout.keys, known.layout.keys):
            return cls(submap.information, none, None)
        from scipy.sparse.linalg import splu  # takes longer to import than to score a small map

        mine = layout.unknowns(known.layout.keys)
        rest = np.setdiff1d(np.arange(layout.dof), mine)
        rows, others = submap.information[mine], sp.csc_matrix(submap.information[rest][:, rest])
        factor = splu(others, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return cls(rows[:, mine], rows[:, rest], factor)

    def times(self, error: Array) -> Array:
        """I e."""
        out = self.known @ error
        if self.unknown is not None:
            out = out - self.across @ self.unknown.solve(self.across.T @ error)  # type: ignore[attr-defined]
        return np.asarray(out)


def _fit_frame(submap: Submap, truth: Values, aligned: Aligned) -> Values:
    """The truth in the frame that makes e' I e least: Gauss-Newton from the alignment by positions."""
    if not len(truth):
        return truth
    information = Information.of(submap, truth)
    estimate = submap.values.only(truth.layout.keys)
    moved = truth.transform(aligned.pose.inverse())
    dim = aligned.pose.dim
    for _ in range(20):
        error = moved.minus(estimate)
        steps = np.eye(aligned.pose.dof) * _STEP
        columns = [(moved.transform(Pose.from_tangent(s, dim)).minus(estimate) - error) / _STEP for s in steps]
        slope = np.stack(columns, -1)
        weighed = np.stack([information.times(c) for c in columns], -1)
        normal = slope.T @ weighed
        step = np.asarray(-np.linalg.lstsq(normal, weighed.T @ error, rcond=None)[0], np.float64)
        moved = moved.transform(Pose.from_tangent(step, dim))
        if float(step @ normal @ step) < 1e-12:
            break
    return moved


def _one_by_one(known: Values, estimate: Values, covariances: Marginals | None, *, robots: bool) -> MarginalNees | None:
    layout = known.layout
    chosen = is_pose(layout.keys) == robots
    if covariances is None or not chosen.any():
        return None
    error, keys, dofs = known.minus(estimate), layout.keys[chosen], layout.dofs[chosen]
    starts, blocks = layout.dof_start[:-1][chosen], covariances.blocks(keys)
    total, inside = 0.0, 0
    for dof in np.unique(dofs).tolist():
        at = np.flatnonzero(dofs == dof)
        e, covariance = error[starts[at, None] + np.arange(dof)], np.array([blocks[k] for k in at.tolist()])
        nees = np.sum(e * np.linalg.solve(covariance, e[..., None])[..., 0], -1)
        total, inside = total + float(nees.sum()), inside + int(np.sum(nees <= chi2_quantile(CONFIDENCE, dof)))
    return MarginalNees(total / int(dofs.sum()), inside / len(keys))
