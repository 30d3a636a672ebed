"""The rigid motion of things to where they are said to be, where each is told only in part.

    least    sum |W (X p - z)|^2  +  sum |W log(R_z' R_X R_p)|^2     over X, each row by its whitening W, which may be
             singular: what a row does not tell has no say in where things go

Damped Gauss-Newton from a start; what no row tells is left as it starts, and `information` shows which directions these
are. The fit in closed form, of points that are told whole, is `geometry.align`.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from teamslam.geometry.arrays import Array, BoolArray
from teamslam.geometry.pose import Pose, rotations

STEPS = 50
TOLD = 1e-9  # of the largest information: what is below that is not told
STANDS = 1e-15  # of a cost
LEAST = 1e-12  # of the damping: what nothing tells is held by it, above rounding


@dataclass(frozen=True, eq=False)
class Registration:
    """`pose` takes the map to the world; `information` (dof, dof) of an error of it, of a shift [m] and a turn about
    the `middle` (d,) of what was measured [in units of which `scale` (dof,) is one]; `cost` of the rows looked at."""

    pose: Pose
    information: Array
    cost: float
    middle: Array
    scale: Array

    @property
    def rank(self) -> int:
        """How many directions are told."""
        sizes = np.linalg.eigvalsh(self.information)
        return int((sizes > TOLD * max(float(sizes[-1]), 1e-300)).sum())

    def free_at(self, pose: Pose) -> Array:
        """How a pose of the map moves in the world where nothing is told: directions (k, dof) in the chart of
        `geometry.pose`, at right angles (of a turn a radian counts like a metre)."""
        dim = len(self.middle)
        group, there = rotations(dim), self.pose @ pose
        axes = np.linalg.eigh(self.information)[1][:, : len(self.information) - self.rank] * self.scale[:, None]
        arm = there.translation - self.middle
        turned = np.stack([group.hat(axis) @ arm for axis in np.eye(group.DOF)], -1) @ axes[dim:]
        body = there.rotation.T @ axes[dim:] if group.DOF > 1 else axes[dim:]
        return np.linalg.qr(np.concatenate([axes[:dim] + turned, body]))[0].T


@dataclass(frozen=True, eq=False)
class Told:
    """What is to go where: places p, z (n, d), turns (n, d, d) from and to, whitening (n, dof, dof)."""

    places: Array
    goals: Array
    turns: Array
    turned: Array
    whitening: Array

    @classmethod
    def of_points(cls, places: Array, goals: Array, known: BoolArray) -> "Told":
        """Points (n, d) of whose goals some numbers are `known` (n, d)."""
        n, d = places.shape
        whitening = np.zeros((n, d + rotations(d).DOF, d + rotations(d).DOF))
        whitening[:, :d, :d] = known[:, :, None] * np.eye(d)
        turns = np.broadcast_to(np.eye(d), (n, d, d))
        return cls(places, goals, turns, turns, whitening)

    @property
    def whole(self) -> Array:
        """Which rows tell all of a place (n,)."""
        d = self.places.shape[-1]
        return np.asarray(np.linalg.matrix_rank(self.whitening[:, :, :d]) == d)


def register(told: Told, start: Pose, steps: int = STEPS) -> Registration:
    """Where things go from a start.

    Law: if they are told where X takes them, then X, from near enough, where what is told determines it.
    """
    dim, spread = told.places.shape[-1], float(np.std(told.places)) or 1.0
    group, pose, damping = rotations(dim), start, 1e-6
    scale = np.append(np.ones(dim), np.full(group.DOF, 1.0 / spread))
    now = _at(told, pose, scale)
    for _ in range(steps):
        cost, gradient, information = now
        ridge = damping * max(float(np.trace(information)), 1e-300) * np.eye(len(gradient))
        step = scale * np.linalg.solve(information + ridge, -gradient)
        centre = pose.act(told.places.mean(0))
        turn = group.exp(step[dim:])
        tried = Pose(turn @ pose.rotation, centre + step[:dim] + turn @ (pose.translation - centre))
        then = _at(told, tried, scale)
        if then[0] <= cost:
            pose, now, damping = tried, then, max(0.1 * damping, LEAST)
            if cost - then[0] <= STANDS * cost:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return Registration(pose, now[2], now[0], pose.act(told.places.mean(0)), scale)


def _at(told: Told, pose: Pose, scale: Array) -> tuple[float, Array, Array]:
    """The cost, the gradient and the information of a shift and a turn about the middle, in units of `scale`."""
    dim = told.places.shape[-1]
    group = rotations(dim)
    moved = pose.act(told.places)
    arms = moved - pose.act(told.places.mean(0))
    now = pose.rotation @ told.turns
    off = np.concatenate([moved - told.goals, group.log(np.swapaxes(told.turned, -1, -2) @ now)], -1)
    J = np.zeros((len(moved), off.shape[-1], off.shape[-1]))
    J[:, :dim, :dim] = np.eye(dim)
    for k, axis in enumerate(np.eye(group.DOF)):
        J[:, :dim, dim + k] = arms @ group.hat(axis).T
    J[:, dim:, dim:] = np.swapaxes(now, -1, -2) if group.DOF > 1 else np.ones((1, 1))
    white, weighed = (told.whitening @ off[..., None])[..., 0], told.whitening @ J * scale
    gradient = np.einsum("nij,ni->j", weighed, white)
    return 0.5 * float(np.sum(white**2)), gradient, np.einsum("nij,nik->jk", weighed, weighed)


def turns_apart(dim: int) -> Array:
    """Rotations (k, d, d) spread over all there are, the unit first: eight in the plane, those of a cube in space."""
    if dim == 2:
        return np.asarray(rotations(2).exp(np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)[:, None]))
    axes, signs = itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)
    signed = np.array([np.eye(3)[list(p)] * s for p, s in itertools.product(axes, signs)])
    turns = signed[np.linalg.det(signed) > 0.0]
    return np.asarray(turns[np.argsort(-np.trace(turns, axis1=1, axis2=2), kind="stable")])
