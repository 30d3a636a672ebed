"""Trusses: bodies that no pair of them holds, but that are rigid together.

Three planar maps with one common landmark for each pair are a triangle of bars and pins. Their frames minimise

    sum_k sum_b w_bk |X_b q_bk - p_k|^2        (p_k, the place of pin k, is eliminated: the weighted mean)

from many starts, since a triangle may also lie mirrored: locally unique, two-fold in all. An assembly counts where it
fits, and where no body can turn: twists xi_b (of the first body 0) that move all bodies' views of every pin alike must
vanish. Their information matrix, with lengths in units of the pins' extent, must hold every direction by HINGE at
least; how many it leaves open is the nullity.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.joining.link import HINGE, PLACE_SIGMA
from teamslam.joining.sketch import Sketch

STARTS = 32  # for each body but the first; a triangle falls into one of its two assemblies from nearly all of them
STEPS = 60
FITS = 0.9999  # the share of right assemblies that pass the test of fit


@dataclass(frozen=True, eq=False)
class _Pins:
    """Who shares what: for each of n sightings of a pin its body, the pin's place in it and its weight; `differences`
    (n, n) takes places to weighted differences from the pins' means."""

    bodies: int
    dim: int
    body: IntArray
    pin: IntArray
    places: Array
    differences: Array

    @property
    def rows(self) -> int:
        """Numbers that hold the bodies together."""
        return (len(self.body) - len(np.unique(self.pin))) * self.dim

    @property
    def unknowns(self) -> int:
        """Numbers that say where the bodies but the first are."""
        return (self.bodies - 1) * (3 if self.dim == 2 else 6)

    def put(self, frames: Pose) -> Array:
        """Where the bodies see their pins: frames (s, bodies) -> (s, n, d)."""
        return (frames.rotation[:, self.body] @ self.places[..., None])[..., 0] + frames.translation[:, self.body]

    def residual(self, frames: Pose) -> Array:
        """(s, n, d), whitened."""
        return np.asarray(self.differences @ self.put(frames))

    def jacobian(self, arms: Array, length: float = 1.0) -> Array:
        """Of the residuals by the twists [v, w] of all bodies but the first, (s, n d, unknowns).

        `arms` (s, n, d) from each twist's centre; v in units of `length`."""
        group, d, n = rotations(self.dim), self.dim, len(self.body)
        dof = d + group.DOF
        moved = np.zeros((len(arms), n, d, dof))
        moved[..., :d] = length * np.eye(d)
        for k, axis in enumerate(np.eye(group.DOF)):
            moved[..., d + k] = arms @ group.hat(axis).T
        by_body = np.zeros((len(arms), n, d, self.bodies, dof))
        by_body[:, np.arange(n), :, self.body] = np.moveaxis(moved, 1, 0)
        flat = by_body[..., 1:, :].reshape(len(arms), n, -1)
        return (self.differences @ flat).reshape(len(arms), n * d, -1)


def assemblies(sketches: Sequence[Sketch], dim: int) -> list[list[Pose]]:
    """The bodies' frames in every assembly that fits and is rigid, best fit first; the first frame is the identity.

    Empty where there is none: the bodies can move against each other, or do not fit.
    """
    pins = _pins(sketches, dim)
    if pins is None or pins.rows < pins.unknowns:
        return []
    frames, costs = _solved(pins, _starts(pins))
    limit = float(chi2.ppf(FITS, max(pins.rows - pins.unknowns, 1)))
    found: list[Pose] = []
    for s in np.argsort(costs):
        candidate = frames[s]
        if costs[s] > limit:
            break
        if all(np.abs(candidate.minus(other)).max() > 1e-2 for other in found) and not _nullity(pins, candidate):
            found.append(candidate)
    return [[assembly[b] for b in range(pins.bodies)] for assembly in found]


def freedom(shared: Sketch, dim: int) -> int:
    """In how many directions a body that is pinned at these places can still move (its nullity): in the plane 1 at one
    landmark; in space 3 at one, 1 at several in line."""
    if shared.oriented.any():
        return 0
    pins = _pins([shared, shared], dim)
    return 3 * (dim - 1) if pins is None else _nullity(pins, Pose.identity(dim, (2,)))


def _pins(sketches: Sequence[Sketch], dim: int) -> _Pins | None:
    """What at least two of the bodies know."""
    keys = np.concatenate([s.keys for s in sketches])
    body = np.repeat(np.arange(len(sketches)), [len(s.keys) for s in sketches])
    _, pin, times = np.unique(keys, return_inverse=True, return_counts=True)
    rows = np.flatnonzero(times[pin] > 1)
    if not len(rows):
        return None
    body, pin = body[rows], np.unique(pin[rows], return_inverse=True)[1]
    places = np.concatenate([s.places for s in sketches])[rows, :dim]
    weights = 1.0 / (np.concatenate([s.variances for s in sketches])[rows] + 0.5 * PLACE_SIGMA**2)
    same = (pin[:, None] == pin[None]) * weights
    mean = same / same.sum(1, keepdims=True)
    return _Pins(len(sketches), dim, body, pin, places, np.sqrt(weights)[:, None] * (np.eye(len(pin)) - mean))


def _starts(pins: _Pins) -> Pose:
    """Frames turned every way, (s, bodies), always the same."""
    rng = np.random.default_rng(0)
    s = STARTS * (pins.bodies - 1)
    group = rotations(pins.dim)
    axes = rng.standard_normal((s, pins.bodies, group.DOF))
    axes *= np.pi * rng.random((s, pins.bodies, 1)) / np.linalg.norm(axes, axis=-1, keepdims=True)
    axes[:, 0] = 0.0
    return Pose(group.exp(axes), np.zeros((s, pins.bodies, pins.dim)))


def _solved(pins: _Pins, frames: Pose) -> tuple[Pose, Array]:
    """Levenberg-Marquardt from all starts at once: frames (s, bodies) and their costs (s,)."""
    d, dof = pins.dim, pins.unknowns // (pins.bodies - 1)
    damping = np.full(len(frames), 1e-3)
    residual = pins.residual(frames)
    cost = np.sum(residual**2, (1, 2))
    for _ in range(STEPS):
        arms = pins.put(frames) - frames.translation[:, pins.body]
        jacobian = pins.jacobian(arms)
        hessian = np.swapaxes(jacobian, -1, -2) @ jacobian
        gradient = (np.swapaxes(jacobian, -1, -2) @ residual.reshape(len(cost), -1, 1))[..., 0]
        scale = np.einsum("sii->si", hessian) + 1e-9
        damped = hessian + damping[:, None, None] * scale[:, :, None] * np.eye(pins.unknowns)
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0].reshape(len(cost), -1, dof)
        step = np.concatenate([np.zeros((len(cost), 1, dof)), step], 1)
        turned = rotations(d).exp(step[..., d:]) @ frames.rotation
        tried = Pose(turned, frames.translation + step[..., :d])
        residual_tried = pins.residual(tried)
        cost_tried = np.sum(residual_tried**2, (1, 2))
        better = cost_tried < cost
        damping = np.clip(np.where(better, damping / 5.0, damping * 4.0), 1e-9, 1e9)
        frames = Pose(
            np.where(better[:, None, None, None], tried.rotation, frames.rotation),
            np.where(better[:, None, None], tried.translation, frames.translation),
        )
        residual = np.where(better[:, None, None], residual_tried, residual)
        cost = np.where(better, cost_tried, cost)
    return frames, cost


def _nullity(pins: _Pins, frames: Pose) -> int:
    """How many directions an assembly (bodies) leaves open."""
    places = pins.put(frames[None])
    arms = places - places.mean((0, 1))
    extent = float(np.sqrt(np.mean(np.sum(arms**2, -1))))
    jacobian = pins.jacobian(arms, extent if extent > PLACE_SIGMA else 1.0)[0]
    return int((np.linalg.eigvalsh(jacobian.T @ jacobian) < HINGE).sum())
