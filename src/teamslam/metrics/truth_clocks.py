"""The clock of a truth beside a robot's: how late its stamps are, and by how much more in a second.

    min over o, d of   e' I e,     e = truth by these clocks (-) map,     I the map's information

of all variables that the truth knows, places and turns as they hang together: a robot that turns tells a millisecond by
its heading long before its place does. Gauss-Newton from where positions alone have it (`retimed`). Of a truth that is
farther from the map than this allows, sigmas are wider by as much. What is not clearly told is not moved.
"""

from collections.abc import Callable, Mapping

import numpy as np

from teamslam.frontend.clock import Clock
from teamslam.geometry import Array, BoolArray
from teamslam.metrics.consistency import Information, in_frame
from teamslam.metrics.frames import align_team
from teamslam.metrics.retimed import Late
from teamslam.model import Submap, Values

CLEARLY = 3.0  # sigmas, from where on a number is told
MOST_DRIFT = 1e-3  # of a clock: what is more is something else
STEP_S = 0.01  # by which truth is moved at an end of the way, to see what that does
ROUNDS, SETTLED = 10, 0.01  # of a sigma


def truth_clocks(
    submap: Submap,
    spans: Mapping[int, tuple[int, float]],
    near: Mapping[int, float],
    truth_by: Callable[[Mapping[int, Clock]], Values | None],
) -> dict[int, Late]:
    """How late the truth of some robots is, of those that a map clearly tells. `spans`: the middle [ticks] and the
    length [s] of each robot's way, `near`: how late its truth is about [s]; `truth_by` gives the truth by other clocks.

    Law: of a map that is as sure as it should be, what was planted is found within its sigmas.
    """  # fmt: skip
    robots = sorted(near)
    if not robots:
        return {}
    ends = np.array([0.5 * spans[robot][1] for robot in robots])
    steps = np.concatenate([np.full(len(robots), STEP_S), STEP_S / np.maximum(ends, STEP_S)])
    free = np.ones(2 * len(robots), bool)

    def clocks(numbers: Array) -> dict[int, Clock]:
        both = zip(robots, numbers[: len(robots)].tolist(), numbers[len(robots) :].tolist(), strict=True)
        return {robot: Clock(spans[robot][0], offset, drift) for robot, offset, drift in both}

    start = np.array([*(near[robot] for robot in robots), *np.zeros(len(robots))])
    while True:
        fitted = _fitted(submap, lambda numbers: truth_by(clocks(numbers)), start, steps, free)
        if fitted is None:
            return {}
        value, sigma = fitted
        drifts = np.arange(len(free)) >= len(robots)
        told = (np.abs(value) > CLEARLY * sigma) & (np.abs(value) < np.where(drifts, MOST_DRIFT, np.inf))
        if (told | ~free | ~drifts).all():
            break
        unclear = np.flatnonzero(free & drifts & ~told)
        free[unclear[np.argmin(np.abs(value / sigma)[unclear])]] = False
    out = {}
    for k, robot in enumerate(robots):
        offset, drift = k, k + len(robots)
        if told[offset] or free[drift]:
            own = float(value[drift]) if free[drift] else 0.0
            out[robot] = Late(float(value[offset]), float(sigma[offset]), own, float(sigma[drift]), spans[robot][0])
    return out


def _fitted(
    submap: Submap, truth_at: Callable[[Array], Values | None], start: Array, steps: Array, free: BoolArray
) -> tuple[Array, Array] | None:
    """The numbers (k,) at their optimum, those that are not free 0, and their standard deviations; None where the truth
    says too little."""
    numbers = np.where(free, start, 0.0)
    for _ in range(ROUNDS):
        around = [numbers, *(numbers + sign * step for step in np.diag(steps) for sign in (1.0, -1.0))]
        errors = _errors(submap, [truth_at(there) for there in around])
        if errors is None:
            return None
        information, (here, *moved), dof = errors
        J = np.stack([(up - down) / (2.0 * s) for up, down, s in zip(moved[::2], moved[1::2], steps, strict=True)], -1)
        weighed = np.stack([information.times(column) for column in J.T], -1)
        normal, slope = J.T @ weighed, weighed.T @ here
        if np.linalg.matrix_rank(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)))) < len(numbers):
            return None
        spread = np.sqrt(max(float(here @ information.times(here)) / max(dof - len(numbers), 1), 1.0))
        step = np.zeros(len(numbers))
        own = np.linalg.inv(normal[np.ix_(free, free)])
        step[free] = -own @ slope[free]
        sigmas = np.sqrt(np.diag(np.linalg.inv(normal)))
        sigmas[free] = np.sqrt(np.diag(own))
        numbers = numbers + step
        if (np.abs(step) < SETTLED * sigmas).all():
            break
    return numbers, spread * sigmas


def _errors(submap: Submap, truths: list[Values | None]) -> tuple[Information, list[Array], int] | None:
    """The information of those variables that all truths know, the error of each truth, and how many numbers count."""
    if any(truth is None for truth in truths):
        return None
    found = []
    for truth in truths:
        assert truth is not None
        aligned = align_team(submap, truth)
        if aligned is None or not aligned.held:
            return None
        found.append(in_frame(submap, truth, aligned))
    keys = found[0].known.layout.keys
    for other in found[1:]:
        keys = keys[other.known.layout.contains(keys)]
    if not len(keys):
        return None
    estimate = submap.values.only(keys)
    parts = [one.known.only(keys) for one in found]
    errors = [part.minus(estimate) for part in parts]
    return Information.of(submap, parts[0]), errors, parts[0].layout.dof - found[0].fitted
