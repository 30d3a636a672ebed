"""Trusses: bodies that no pair of them holds, but that are rigid together.

Three planar maps with one common landmark for each pair are a triangle of bars and pins; two robots that heard how far
they were from each other are bodies with rods between them. Their frames minimise

    sum_k sum_b w_bk |X_b q_bk - p_k|^2  +  sum of the rods' misses^2

(p_k, the place of pin k, is eliminated: the weighted mean) from many starts, since a truss may also lie mirrored:
locally unique, two-fold in all. An assembly counts where it fits, and where no body can turn: twists xi_b (of the first
body 0) that move all bodies' views of every pin alike and change no rod must vanish. Their information matrix, with
lengths in units of the truss's extent, must hold every direction by HINGE at least; how many it leaves open is the
nullity.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.joining.place.motions import by_body, put, swept
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.ranges import Ranges, Rods
from teamslam.joining.place.robust_fit import HINGE, PLACE_SIGMA
from teamslam.model import chi2_quantile

STARTS = 32  # for each body but the first; a triangle falls into one of its two assemblies from nearly all of them
STEPS = 60
FITS = 0.9999  # the share of right assemblies that pass the test of fit


@dataclass(frozen=True, eq=False)
class _Pins:
    """Who shares what: for each of n sightings of a pin its body, the pin's place in it and its weight; `differences`
    (n, n) takes places to weighted differences from the pins' means."""

    bodies: int
    body: IntArray
    pin: IntArray
    places: Array
    differences: Array

    @classmethod
    def of(cls, outlines: Sequence[Outline], dim: int) -> "_Pins":
        """What at least two of the bodies know."""
        known, body = Outline.beside(outlines)
        _, pin, times = np.unique(known.keys, return_inverse=True, return_counts=True)
        rows = np.flatnonzero(times[pin] > 1)
        body, pin = body[rows], np.unique(pin[rows], return_inverse=True)[1]
        places = known.places[rows, :dim]
        weights = 1.0 / (known.variances[rows] + 0.5 * PLACE_SIGMA**2)
        same = (pin[:, None] == pin[None]) * weights
        mean = same / same.sum(1, keepdims=True)
        return cls(len(outlines), body, pin, places, np.sqrt(weights)[:, None] * (np.eye(len(pin)) - mean))

    @property
    def rows(self) -> int:
        """Numbers that hold the bodies together."""
        return int((len(self.body) - len(np.unique(self.pin))) * self.places.shape[-1])

    def residual(self, frames: Pose) -> Array:
        """(s, n d), whitened, of frames (s, bodies)."""
        return (self.differences @ put(frames, self.body, self.places)).reshape(len(frames), -1)

    def jacobian(self, frames: Pose, centres: Array, unit: float = 1.0) -> Array:
        """Of the residuals by the bodies' twists about `centres` (s, bodies, d), lengths in `unit`."""
        arms = put(frames, self.body, self.places) - centres[:, self.body]
        moved = by_body(swept(arms, unit), self.body, self.bodies)
        s, n, d, unknowns = moved.shape
        return (self.differences @ moved.reshape(s, n, d * unknowns)).reshape(s, n * d, unknowns)


@dataclass(frozen=True, eq=False)
class _Truss:
    """Bodies and all that holds them together."""

    bodies: int
    dim: int
    pins: _Pins
    rods: Rods

    @property
    def rows(self) -> int:
        """Numbers that hold the bodies together."""
        return self.pins.rows + self.rods.rows

    @property
    def unknowns(self) -> int:
        """Numbers that say where the bodies but the first are."""
        return (self.bodies - 1) * (3 if self.dim == 2 else 6)

    def residual(self, frames: Pose) -> Array:
        """(s, rows), whitened."""
        return np.concatenate([self.pins.residual(frames), self.rods.residual(frames)], 1)

    def jacobian(self, frames: Pose, centres: Array, unit: float = 1.0) -> Array:
        """(s, rows, unknowns)."""
        parts = [part.jacobian(frames, centres, unit) for part in (self.pins, self.rods)]
        return np.concatenate(parts, 1)

    def places(self, frames: Pose) -> Array:
        """Where one assembly (bodies) puts pins and ends of rods: (n, d)."""
        rods = [put(frames[None], *end)[0] for end in zip(self.rods.body, self.rods.places, strict=True)]
        return np.concatenate([put(frames[None], self.pins.body, self.pins.places)[0], *rods])


def assemblies(outlines: Sequence[Outline], dim: int, ranges: Ranges | None = None) -> list[list[Pose]]:
    """The bodies' frames in every assembly that fits and is rigid, best fit first; the first frame is the identity.

    `ranges`: those between things of the bodies are rods. Empty where there is none: the bodies can move against each
    other, or do not fit.
    """
    truss = _truss(outlines, dim, ranges)
    if truss.rows < truss.unknowns:
        return []
    frames, costs = _solved(truss, _starts(truss))
    limit = chi2_quantile(FITS, max(truss.rows - truss.unknowns, 1))
    found: list[Pose] = []
    for s in np.argsort(costs):
        candidate = frames[s]
        if costs[s] > limit:
            break
        if all(np.abs(candidate.minus(other)).max() > 1e-2 for other in found) and not _nullity(truss, candidate):
            found.append(candidate)
    return [[assembly[b] for b in range(truss.bodies)] for assembly in found]


def freedom(shared: Outline, dim: int) -> int:
    """In how many directions a body that is pinned at these places can still move (its nullity): in the plane 1 at one
    landmark; in space 3 at one, 1 at several in line."""
    if shared.oriented.any():
        return 0
    truss = _truss([shared, shared], dim, None)
    return _nullity(truss, Pose.identity(dim, (2,))) if truss.rows else 3 * (dim - 1)


def left_open(outlines: Sequence[Outline], dim: int, ranges: Ranges) -> int:
    """In how many directions bodies can still move against each other in the assembly that fits best."""
    truss = _truss(outlines, dim, ranges)
    frames, costs = _solved(truss, _starts(truss))
    return _nullity(truss, frames[int(np.argmin(costs))])


def _truss(outlines: Sequence[Outline], dim: int, ranges: Ranges | None) -> _Truss:
    rods = Rods.of(Ranges.of(()) if ranges is None else ranges, outlines, dim)
    return _Truss(len(outlines), dim, _Pins.of(outlines, dim), rods)


def _starts(truss: _Truss) -> Pose:
    """Frames turned every way, (s, bodies), always the same; bodies with rods lie anywhere within reach too."""
    rng = np.random.default_rng(0)
    s = STARTS * (truss.bodies - 1)
    group = rotations(truss.dim)
    axes = rng.standard_normal((s, truss.bodies, group.DOF))
    axes *= np.pi * rng.random((s, truss.bodies, 1)) / np.linalg.norm(axes, axis=-1, keepdims=True)
    reach = float(truss.rods.lengths.max(initial=0.0))
    places = reach * rng.standard_normal((s, truss.bodies, truss.dim))
    axes[:, 0], places[:, 0] = 0.0, 0.0
    return Pose(group.exp(axes), places)


def _solved(truss: _Truss, frames: Pose) -> tuple[Pose, Array]:
    """Levenberg-Marquardt from all starts at once: frames (s, bodies) and their costs (s,)."""
    d, dof = truss.dim, truss.unknowns // (truss.bodies - 1)
    damping = np.full(len(frames), 1e-3)
    residual = truss.residual(frames)
    cost = np.sum(residual**2, 1)
    for _ in range(STEPS):
        jacobian = truss.jacobian(frames, frames.translation)
        hessian = np.swapaxes(jacobian, -1, -2) @ jacobian
        gradient = (np.swapaxes(jacobian, -1, -2) @ residual[..., None])[..., 0]
        scale = np.einsum("sii->si", hessian) + 1e-9
        damped = hessian + damping[:, None, None] * scale[:, :, None] * np.eye(truss.unknowns)
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0].reshape(len(cost), -1, dof)
        step = np.concatenate([np.zeros((len(cost), 1, dof)), step], 1)
        turned = rotations(d).exp(step[..., d:]) @ frames.rotation
        tried = Pose(turned, frames.translation + step[..., :d])
        residual_tried = truss.residual(tried)
        cost_tried = np.sum(residual_tried**2, 1)
        better = cost_tried < cost
        damping = np.clip(np.where(better, damping / 5.0, damping * 4.0), 1e-9, 1e9)
        frames = Pose(
            np.where(better[:, None, None, None], tried.rotation, frames.rotation),
            np.where(better[:, None, None], tried.translation, frames.translation),
        )
        residual = np.where(better[:, None], residual_tried, residual)
        cost = np.where(better, cost_tried, cost)
    return frames, cost


def _nullity(truss: _Truss, frames: Pose) -> int:
    """How many directions an assembly (bodies) leaves open."""
    places = truss.places(frames)
    centre = places.mean(0)
    extent = float(np.sqrt(np.mean(np.sum((places - centre) ** 2, -1))))
    unit = extent if extent > PLACE_SIGMA else 1.0
    jacobian = truss.jacobian(frames[None], np.broadcast_to(centre, (1, truss.bodies, truss.dim)), unit)[0]
    return int((np.linalg.eigvalsh(jacobian.T @ jacobian) < HINGE).sum())
