"""How firmly submaps hang together by their own rows, at the optimum of their join near some frames.

What a rigid fit cannot tell for sure (landmarks that are known well to the side and badly along the ray, rows of which
one is worth more than all others) the join can: its unknowns are all that the submaps share, and the covariance at its
optimum, all rows at their full weight, says how well a pose of one is known from a pose of another. Two poses that meet
firmly are enough: far from there both may drift.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.join.interiors import Member
from teamslam.joining.join.optimum import Optimum
from teamslam.joining.place.frameworks import FITS
from teamslam.joining.place.reasons import Held
from teamslam.model import SQUARED, Submap, Values, chi2_quantile, is_pose, robot_of
from teamslam.solver import Covariances, Options, SubmapTerm, System

FEW = 8  # poses of each body, evenly taken, between which the firmest meeting is looked for
ROUGH = 60  # iterations
OPEN = Held(False, np.inf, np.inf, 1.0)


def held(members: Sequence[Member], bodies: Sequence[int], frames: Sequence[Pose], options: Options) -> list[Held]:
    """How the bodies that the members belong to are held, each but the first to that."""
    few = min(options.max_iterations, ROUGH)
    rough = replace(options, max_iterations=few, decrement=max(options.decrement, 0.1), elsewhere=False)
    try:
        optimum = Optimum.of(members, frames, rough, None)
        covariances = _unweighted(optimum)
        groups = [_poses([m.joined for m, b in zip(members, bodies, strict=True) if b == body], optimum)
                  for body in sorted(set(bodies))]  # fmt: skip
        meetings = [
            _firmest(covariances, optimum.shared.values, groups[0], group, optimum.fixed) for group in groups[1:]
        ]
    except SolveError:
        return [OPEN] * (len(set(bodies)) - 1)
    fits = optimum.shared.cost <= chi2_quantile(FITS, max(optimum.shared.dof, 1))
    return [replace(meeting, fits=bool(fits)) for meeting in meetings]


def _unweighted(optimum: Optimum) -> Covariances:
    """The covariances at the optimum, were no row forgiven."""
    submaps = [member.joined for member in optimum.members]
    system = System(
        optimum.shared.values.layout,
        tables=[table.with_loss(SQUARED) for table in optimum.used],
        submaps=[SubmapTerm.of(submap) for submap in submaps],
        fixed=optimum.fixed,
        names=optimum.names,
    )
    return Covariances(system.free, system.linearise(optimum.shared.values).hessian, optimum.names)


def _poses(submaps: Sequence[Submap], optimum: Optimum) -> IntArray:
    """Some of their robots' own poses: those that rows between robots name, and others, evenly taken."""
    robots = [(s, [*s.robots, int(robot_of(s.base))]) for s in submaps]  # an account of what went in may be missing
    own = np.unique(np.concatenate([s.keys[is_pose(s.keys) & np.isin(robot_of(s.keys), who)] for s, who in robots]))
    named = np.intersect1d(own, np.concatenate([own[:1], *(t.keys.ravel() for t in optimum.used)]))
    return np.union1d(*(of[np.unique(np.linspace(0, len(of) - 1, FEW).astype(int))] for of in (own, named)))


def _firmest(covariances: Covariances, values: Values, ours: IntArray, theirs: IntArray, fixed: IntArray) -> Held:
    """How well one of their poses is known from one of ours: the first pair that is firm, of others the firmest."""
    found = []
    for a in ours.tolist():
        for b in theirs.tolist():
            turn, place = _sigmas(covariances, values, a, b, fixed)
            apart = float(np.linalg.norm(np.diff(values.positions(np.array([a, b]), 3), axis=0)))
            found.append(Held(True, turn, place, max(apart, 1.0)))
            if found[-1].firm:
                return found[-1]
    return min(found, key=lambda h: h.looseness)


def _sigmas(covariances: Covariances, values: Values, a: int, b: int, fixed: IntArray) -> tuple[float, float]:
    """The standard deviations [rad], [m] of b's pose seen from a's, in the worst direction."""
    still = np.isin([a, b], fixed)
    of: Array = covariances.of(a if still[1] else b) if still.any() else covariances.relative(values, a, b)
    d = 2 if len(of) == 3 else 3
    return float(np.sqrt(np.linalg.eigvalsh(of[d:, d:])[-1])), float(np.sqrt(np.linalg.eigvalsh(of[:d, :d])[-1]))
