"""The rigid motion that takes a map to what was measured in the world, where its rows tell only part: depth, height,
the tilt that an accelerometer knows, fixes of which one coordinate is missing.

    least    sum |W (X p - z)|^2  +  sum |W log(R_z' R_X R_p)|^2     over X, each row by its whitening W, which may be
             singular: what a row does not tell has no say in where the map goes
    starts   the rigid fit of the rows that tell all of a place, and turns in steps of an eighth (in space a quarter)
             about it, since what little is told may lie beyond a ridge

What no row tells is left as it starts; `information` shows which directions these are.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, align, lift_points, rotations
from teamslam.model import Table, Values

MOST = 300  # rows of a table that are looked at, evenly taken
STEPS = 30
LOOKS = 4  # steps before the better half of the starts goes on
TOLD = 1e-9  # of the largest information: what is below that is not told
STANDS = 1e-10
_SIGNS = itertools.product((1.0, -1.0), repeat=3)
_SIGNED = [np.eye(3)[list(axes)] * s for axes, s in itertools.product(itertools.permutations(range(3)), _SIGNS)]
_CUBE = np.array([turn for turn in _SIGNED if np.linalg.det(turn) > 0.0])  # the turns of a cube


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
class _Told:
    """What is to go where: places p, z (n, d), turns (n, d, d) from and to, whitening (n, dof, dof)."""

    places: Array
    goals: Array
    turns: Array
    turned: Array
    whitening: Array

    @property
    def whole(self) -> Array:
        """Which rows tell all of a place (n,)."""
        d = self.places.shape[-1]
        return np.asarray(np.linalg.matrix_rank(self.whitening[:, :, :d]) == d)


def registered(values: Values, absolute: Sequence[Table], dim: int) -> Registration:
    """Where a map goes whose poses and landmarks are among `values`, by rows of the world.

    Law: rows of a map that was moved by X give X in all that they tell, however many numbers of each are missing.
    """
    told = _told(values, absolute, dim)
    middle, spread = told.places.mean(0), float(np.std(told.places)) or 1.0
    found = [_settled(told, start, spread, LOOKS) for start in _starts(told, middle, dim)]
    best = sorted(found, key=lambda one: one.cost)[: max(1, len(found) // 6)]
    return min((_settled(told, one.pose, spread, STEPS) for one in best), key=lambda one: one.cost)


def _told(values: Values, absolute: Sequence[Table], dim: int) -> _Told:
    dof = dim + rotations(dim).DOF
    parts = []
    for table in absolute:
        some = table.select(np.unique(np.linspace(0, len(table) - 1, min(len(table), MOST)).astype(np.int64)))
        here, m = min(dim, some.dim), len(some)
        goals, places = lift_points(some.values[:, :here], dim), values.positions(some.keys[:, 0], dim)
        turns = turned = np.tile(np.eye(dim), (m, 1, 1))
        of = np.arange(here)  # the unknowns that its numbers tell of
        if some.model == "pose" and some.dim <= dim:
            turns = values.poses_of(some.keys[:, 0], dim).rotation
            goal = Pose(some.values[:, some.dim :].reshape(m, some.dim, some.dim), some.values[:, : some.dim]).lift(dim)
            turned, goals = goal.rotation, goal.translation
            of = np.append(of, np.arange(dim, dof) if some.dim == dim else [dof - 1])
        given = np.broadcast_to(some.whitening, (m, *some.whitening.shape[1:]))[:, :, : len(of)]
        whitening = np.zeros((m, dof, dof))
        whitening[:, : given.shape[1], of] = given
        if some.sensor is not None and some.model == "position":  # an antenna on its mast
            arm = some.sensor.lift(dim).translation
            places = places + (values.poses_of(some.keys[:, 0], dim).rotation @ arm)
        parts.append((places, goals, turns, turned, whitening))
    return _Told(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _starts(told: _Told, middle: Array, dim: int) -> Iterator[Pose]:
    """Fits of whole places, and turns about them."""
    whole = told.whole
    first = align(told.places[whole], told.goals[whole]).pose if whole.any() else Pose.identity(dim)
    turns = rotations(2).exp(np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)[:, None]) if dim == 2 else _CUBE
    goal = first.act(middle)
    for turn in sorted(turns, key=lambda turn: -float(np.trace(turn))):  # as it is comes first
        yield Pose(turn @ first.rotation, goal - turn @ first.rotation @ middle)


def _settled(told: _Told, start: Pose, spread: float, steps: int) -> Registration:
    """Damped Gauss-Newton from a start."""
    dim = told.places.shape[-1]
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
            pose, now, damping = tried, then, 0.1 * damping
            if cost - then[0] <= STANDS * cost:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return Registration(pose, now[2], now[0], pose.act(told.places.mean(0)), scale)


def _at(told: _Told, pose: Pose, scale: Array) -> tuple[float, Array, Array]:
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
