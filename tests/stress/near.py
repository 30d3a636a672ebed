"""A map of a real log lies where the published truth says, or tells why it may not."""

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from teamslam.geometry import Array, align
from teamslam.joining import Component
from teamslam.model import WORLD, Values, is_landmark
from teamslam.results.report import report_of
from teamslam.solver import Covariances

WRONG = 0.5  # [m]: a map that is folded or mirrored errs by metres; what is surveyed and seen is good to centimetres
SIGMAS = (
    10.0  # real noise is not what it says: maps of published logs believe two or three times too much of themselves
)
FEWEST = 3  # places that a rigid fit leaves errors of
WHY = ("strained", "misfit")  # verdicts on the fit by which a map says itself that it is not to be trusted


def check_near(outcome: Outcome, findings: Findings) -> None:
    """Landmarks (without any: poses) after one alignment of each component."""
    for component in outcome.components:
        errors, sigma = _errors(component, outcome.log.truth)
        if not len(errors):
            continue
        near = bool(errors.max() < WRONG + SIGMAS * sigma)
        what = "a map is near the truth" if near else "a map far from the truth says why"
        findings.check(
            what, near or _says_why(component, outcome), f"{errors.max():.3g} m, its own sigma {sigma:.3g} m"
        )


def _errors(component: Component, truth: Values | None) -> tuple[Array, float]:
    """How far each place is from the truth [m], and the largest standard deviation of any."""
    keys = component.map.values.layout.keys
    keys = keys[keys != WORLD]
    known = keys[truth.layout.contains(keys)] if truth is not None else keys[:0]
    known = known[is_landmark(known)] if is_landmark(known).any() else known
    if truth is None or len(known) < FEWEST:
        return np.zeros(0), 0.0
    dim = 2 if not (component.map.values.layout.kinds % 2).any() else 3
    mine, theirs = component.map.values.positions(known, dim), truth.positions(known, dim)
    fit = align(mine, theirs)
    found = Covariances.of_map(component.map)
    sigma = max(float(np.sqrt(np.linalg.eigvalsh(found.of(int(key))[:dim, :dim])[-1])) for key in known)
    return np.linalg.norm(fit.pose.act(mine) - theirs, axis=-1), sigma


def _says_why(component: Component, outcome: Outcome) -> bool:
    """Another way to put it together is named, or the fit is none."""
    if component.ambiguities or (component.solution is not None and not component.solution.converged):
        return True
    return outcome.result is not None and report_of(outcome.result)["fit"]["verdict"] in WHY
