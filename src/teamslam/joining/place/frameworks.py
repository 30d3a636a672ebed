"""Trusses: bodies that no pair of them holds, but that are rigid together by all rows between them.

Three planar maps with one common landmark for each pair are a triangle of bars and pins; two robots that heard how far
they were from each other are bodies with rods between them; two that saw at what angle the other stood, bodies with
sights. Their frames minimise the rows' losses (see `ties`) from many starts, since a truss may also lie mirrored:
locally unique, two-fold in all. An assembly counts where it fits, and where no body can turn: twists xi_b (of the first
body 0) that change no row must vanish. Their information matrix, with lengths in units of the truss's extent and
without robust weights, must hold every direction by HINGE at least; how many it leaves open is the nullity. What need
not be held is the world and landmarks that are bodies: they are eliminated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, so3
from teamslam.joining.place.robust_fit import HINGE, PLACE_SIGMA
from teamslam.joining.place.ties import Tied, turned_about
from teamslam.model import chi2_quantile

STARTS = 32  # at least: a triangle falls into one of its two assemblies from nearly all of them
EACH = 8  # for each unknown: ranges in space have dozens of minima that fit
GENERIC = 2  # frames at which it is asked what is open: one of them might be special by chance
SHARE = 288  # of bodies in all starts: large trusses, which are seldom, have fewer
STEPS = 60
TRIAL = 8  # steps after which the better half goes on
MOST_ASSEMBLIES, FEW_THAT_DO_NOT = 16, 3  # looked at, and of those that do not fit
FAR = 1e4  # times the reach
STUCK = 1e9  # of the damping
NEAR = 1e-6  # [m], [rad]: steps that are shorter lead nowhere else
FITS = 0.9999  # the share of right assemblies that pass the test of fit
NOTHING = 1e-7  # of the largest singular value: what differences of rows show of a direction that changes none


@dataclass(frozen=True, eq=False)
class Assembly:
    """Frames (n,) of a truss's bodies, in space, with the first one's the identity: what its rows cost there, whether
    they fit, and how many directions it leaves open."""

    frames: Pose
    cost: float
    fits: bool
    nullity: int


@dataclass(frozen=True, eq=False)
class Truss:
    """Bodies and all that holds them together."""

    tied: Tied

    def assemblies(self) -> list[Assembly]:
        """Where the rows' cost has a minimum, by cost; mirror images and other ways to put the bodies together."""
        if not self._columns.size or not self.tied.ties:
            return []
        count = min(max(STARTS, EACH * len(self._columns)), SHARE // self.tied.given)
        starts = self._starts(count, self.tied.reach)
        limit = chi2_quantile(FITS, max(self._rows_that_count(starts) - len(self._columns), 1))
        frames, costs = self._solved(starts, limit)
        found: list[Assembly] = []
        for s in np.argsort(costs)[np.isfinite(np.sort(costs))]:
            frame, fits = frames[s], bool(costs[s] <= limit)
            if len(found) == MOST_ASSEMBLIES or not (fits or len(found) < FEW_THAT_DO_NOT):
                break
            if all(_apart(frame[: self.tied.given], f.frames) for f in found):
                found.append(Assembly(frame[: self.tied.given], float(costs[s]), fits, self._nullity(frame)))
        return found

    def may_be_rigid(self) -> bool:
        """Whether there are rows enough, and of enough kinds, to hold all bodies."""
        return not self.freedoms()[0].any()

    def freedoms(self) -> IntArray:
        """In how many directions each two of the given bodies (n, n) can move against each other though no row
        changes, wherever they may be.

        It is asked where nothing is special: of the rank of the rows at a few frames taken at random. Law: a rank is
        nowhere larger than there (but for a set of measure zero), so what is open there is open everywhere; at special
        frames more may be.
        """
        if not self.tied.ties:
            return self._untied()
        starts = self._starts(GENERIC, self.tied.extent)
        return np.asarray(np.stack([self._freedoms(starts[n : n + 1]) for n in range(GENERIC)]).min(0))

    def _untied(self) -> IntArray:
        each = self.tied.moves[: self.tied.given].sum(1)
        return np.where(np.eye(len(each), dtype=bool), 0, np.maximum(each[:, None], each))

    def _freedoms(self, frames: Pose) -> IntArray:
        rows = self._rows(frames, whitened=False)[0]
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
        _, sizes, directions = np.linalg.svd(np.linalg.qr(rows, mode="r"), full_matrices=True)
        open_ = np.zeros((len(directions) - int((sizes > NOTHING * sizes[0]).sum()), self.tied.moves.size))
        open_[:, self._columns] = directions[len(directions) - len(open_) :]
        twists = np.swapaxes(open_.reshape(len(open_), len(self.tied.moves), 6), 0, 1)[: self.tied.given]
        return np.array([[np.linalg.matrix_rank(a - b, tol=1e-5) if a.size else 0 for b in twists] for a in twists])

    # --- the search -------------------------------------------------------------------------------------------

    @property
    def _columns(self) -> IntArray:
        """The unknowns among all bodies' twists: what the first body does, is not one."""
        moves = self.tied.moves.copy()
        moves[0] = False
        return np.flatnonzero(moves.ravel())

    def _starts(self, s: int, reach: float) -> Pose:
        """Frames turned every way, (s, bodies), always the same, anywhere within some reach [m]."""
        rng, n = np.random.default_rng(0), len(self.tied.moves)
        axes = rng.standard_normal((s, n, 3)) * self.tied.moves[:, 3:]
        axes *= np.pi * rng.random((s, n, 1)) / np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-9)
        places = reach * rng.standard_normal((s, n, 3)) * self.tied.moves[:, :3]
        axes[:, 0], places[:, 0] = 0.0, 0.0
        return Pose(so3.exp(axes), places)

    def _solved(self, frames: Pose, fits: float) -> tuple[Pose, Array]:
        """Levenberg-Marquardt from all starts at once: frames (s, bodies) and their costs (s,). The worse half ends now
        and then, but for those that cost no more than what `fits`: each may be another assembly."""
        rotation, translation = frames.rotation.copy(), frames.translation.copy()
        damping, going = np.full(len(frames), 1e-3), np.arange(len(frames))
        costs, kept = np.full(len(frames), np.inf), np.ones(len(frames), bool)
        for n in range(STEPS):
            if n and n % TRIAL == 0:
                order = going[np.argsort(costs[going], kind="stable")]
                worse = order[(len(order) + 1) // 2 :]
                kept[worse[costs[worse] > fits]] = False
                going = going[kept[going]]
            here = Pose(rotation[going], translation[going])
            hessian, gradient, cost, whiteners = self._normal(here)
            scale = np.einsum("sii->si", hessian) + 1e-9
            damped = hessian + damping[going, None, None] * scale[:, :, None] * np.eye(hessian.shape[-1])
            step = np.zeros((len(here), self.tied.moves.size))
            step[:, self._columns] = -np.linalg.solve(damped, gradient[..., None])[..., 0]
            costs[going] = cost
            tried = _moved(here, step.reshape(len(here), -1, 6))
            better = self._cost(tried, whiteners) < cost
            damping[going] = np.clip(np.where(better, damping[going] / 5.0, damping[going] * 4.0), 1e-9, STUCK)
            rotation[going[better]], translation[going[better]] = tried.rotation[better], tried.translation[better]
            gone = np.abs(translation[going]).max((1, 2)) > FAR * self.tied.reach
            arrived = (np.abs(step).max(1) < NEAR) | (damping[going] >= STUCK) | gone
            going = going[~arrived]
            if not len(going):
                break
        frames = Pose(rotation[kept], translation[kept])
        return frames, self._normal(frames)[2]

    def _cost(self, frames: Pose, whiteners: Sequence[Array]) -> Array:
        """The rows' losses (s,), whitened as said."""
        total = np.zeros(len(frames))
        for tie, white in zip(self.tied.ties, whiteners, strict=True):
            squared = np.sum((white @ tie.residual(*tie.at(frames))[..., None]) ** 2, (-1, -2))
            total += tie.table.loss.cost(squared).sum(-1)
        return total

    def _normal(self, frames: Pose) -> tuple[Array, Array, Array, list[Array]]:
        """H (s, u, u), gradient (s, u), cost (s,) and the whiteners of the ties."""
        u = len(self._columns)
        hessian, gradient, cost = np.zeros((len(frames), u, u)), np.zeros((len(frames), u)), np.zeros(len(frames))
        whiteners = []
        for tie in self.tied.ties:
            observer, target = tie.at(frames)
            slopes = tie.slopes(observer, target)
            whiteners.append(tie.whiteners(observer, target, slopes))
            error = (whiteners[-1] @ tie.residual(observer, target)[..., None])[..., 0]
            squared = np.sum(error**2, -1)
            weight = np.repeat(np.sqrt(tie.table.loss.weight(squared)), error.shape[-1], -1)
            jacobian = self._by_twists(tie.ends, target, whiteners[-1] @ slopes, frames.translation, 1.0)
            jacobian *= weight[..., None]
            transposed = np.swapaxes(jacobian, -1, -2)
            hessian += transposed @ jacobian
            gradient += (transposed @ (weight * error.reshape(len(frames), -1))[..., None])[..., 0]
            cost += tie.table.loss.cost(squared).sum(-1)
        return hessian, gradient, cost, whiteners

    def _by_twists(self, ends: IntArray, target: Pose, slopes: Array, centres: Array, unit: float) -> Array:
        """Slopes by place and turn (s, m, k, 6) as those by the bodies' twists about `centres` (s, n, 3): (s, m k, u);
        lengths in `unit`."""
        s, m, k, _ = slopes.shape
        out = np.zeros((s, m, k, len(self.tied.moves), 6))
        for bodies, sign in ((ends[0], -1.0), (ends[1], 1.0)):
            arms = target.translation - centres[:, bodies]
            swung = sign * turned_about(slopes, arms, unit)
            out[:, np.arange(m), :, bodies] += np.moveaxis(swung, 1, 0)
        return out.reshape(s, m * k, -1)[..., self._columns]

    # --- what is held -----------------------------------------------------------------------------------------

    def _rows(self, frames: Pose, *, whitened: bool) -> Array:
        """All rows by twists about the middle of all ends (s, rows, u), lengths in units of their extent; `whitened` by
        all that is known, or by the measurements' own information."""
        ends = [tie.at(frames) for tie in self.tied.ties]
        places = np.concatenate([end.translation for both in ends for end in both], 1)
        centre = places.mean(1, keepdims=True)
        extent = float(np.sqrt(np.mean(np.sum((places - centre)[..., self.tied.ways] ** 2, -1))))
        unit = extent if extent > PLACE_SIGMA else 1.0
        centres = np.broadcast_to(centre, (len(frames), len(self.tied.moves), 3))
        parts = []
        for tie, (observer, target) in zip(self.tied.ties, ends, strict=True):
            slopes = tie.slopes(observer, target)
            white = tie.whiteners(observer, target, slopes) @ slopes if whitened else slopes
            # All that know one thing turn about one place, though each has its own view of it.
            parts.append(self._by_twists(tie.ends, target if tie.measured else observer, white, centres, unit))
        return np.concatenate(parts, 1)

    def _nullity(self, frames: Pose) -> int:
        """How many directions of the given bodies an assembly (bodies) leaves open, the others eliminated."""
        rows = self._rows(frames[None], whitened=True)
        hessian = rows[0].T @ rows[0]
        mine = self._columns < 6 * self.tied.given
        across = hessian[np.ix_(mine, ~mine)]
        left = hessian[np.ix_(mine, mine)] - across @ np.linalg.pinv(hessian[np.ix_(~mine, ~mine)]) @ across.T
        return int((np.linalg.eigvalsh(left) < HINGE).sum())

    def _rows_that_count(self, frames: Pose) -> int:
        """Numbers that hold the bodies together."""
        rows = self._rows(frames[:1], whitened=True)
        return int((np.abs(rows[0]).max(1, initial=0.0) > 1e-9).sum())


def in_their_dimension(frames: Pose, flat: Sequence[bool]) -> list[Pose]:
    """Frames (n,) in space as poses, of bodies in the plane as planar ones."""
    dims = [2 if planar else 3 for planar in flat]
    return [Pose(frames.rotation[n, :d, :d], frames.translation[n, :d]) for n, d in enumerate(dims)]


def _moved(frames: Pose, twists: Array) -> Pose:
    return Pose(so3.exp(twists[..., 3:]) @ frames.rotation, frames.translation + twists[..., :3])


def _apart(one: Pose, other: Pose) -> bool:
    return bool(np.abs(one.minus(other)).max() > 1e-2)
