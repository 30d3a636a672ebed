"""Rows between bodies: whatever ties rigid bodies together, of any model.

Both ends of a row are known, each in its own body: the observer at P in body a, the target at Q in body b. Under frames
X the row misses by e = z (-) h(X_a P, X_b Q), whitened by

    S = Sigma + J V J' ,    V: how well the ends are known in their bodies, J: by the target's place and turn, or the
                            observer's

A measurement knows no frame, so to move its observer by a twist is to move its target by the opposite one: what the
target's twist does is all there is to differentiate. Besides the bodies that are given there may be

    the world        it is the observer of what was measured in it
    a landmark       that none of the bodies knows, but several have sighted: a body that does not turn

What two bodies both know ties them too: a measured difference of nothing.
"""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose, lift_points, so3
from teamslam.joining.place.alike import kind_of, together
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.robust_fit import PLACE_SIGMA, TURN_SIGMA
from teamslam.joining.start.triangulate import kinds_of
from teamslam.model import MODELS, WORLD, Kind, Layout, Table, is_landmark, pack

MOST = 120  # rows of one truss at most, evenly taken: more would not tell more of its frames
FEWEST = 8  # of one table, should there be very many tables
COMMON = "common"  # the source of rows that no measurement is: two views of one thing
MOST_POINTS = 30  # landmarks that no body knows, those with most sightings
SAME = 1e-3  # [m], [rad]: sigma of two views of one thing, before what each is known to
STEP = 1e-5  # [m], [rad] of a difference
ALL = np.ones(6, bool)
FLAT = np.array([1, 1, 0, 0, 0, 1], bool)
STILL = np.array([1, 1, 1, 0, 0, 0], bool)
_STEPS = np.kron(np.eye(6), np.array([[STEP], [-STEP]]))  # forward and back along each place and turn
BOTH_WAYS = so3.exp(_STEPS[:, 3:]), _STEPS[:, :3]


@dataclass(frozen=True, eq=False)
class Ties:
    """Rows of one `table` between bodies: for both `ends` (2, m) of each row its body, the pose there (m,), in space,
    and the variances (2, m) of its place and of its turn in it."""

    table: Table
    ends: IntArray
    seen_from: Pose
    there: Pose
    place_variances: Array
    turn_variances: Array

    def __len__(self) -> int:
        return len(self.table)

    @property
    def measured(self) -> bool:
        """Whether the rows were measured; else they are two views of one thing."""
        return self.table.source != COMMON

    @property
    def turns(self) -> bool:
        """Whether it matters how the target is turned."""
        return self.table.sees_turns

    def select(self, index: AnyArray) -> "Ties":
        """The rows at a mask or index."""
        return Ties(
            self.table.select(index), self.ends[:, index], self.seen_from[index], self.there[index],
            self.place_variances[:, index], self.turn_variances[:, index],
        )  # fmt: skip

    @classmethod
    def together(cls, ties: Sequence["Ties"]) -> "Ties":
        """Rows of several tables of one kind (see `kind_of`)."""
        if len(ties) == 1:
            return ties[0]
        parts = [(t.ends, t.place_variances, t.turn_variances) for t in ties]
        ends, places, turns = (np.concatenate(each, 1) for each in zip(*parts, strict=True))
        seen_from, there = (
            Pose(np.concatenate([p.rotation for p in poses]), np.concatenate([p.translation for p in poses]))
            for poses in ([t.seen_from for t in ties], [t.there for t in ties])
        )
        return cls(together([t.table for t in ties]), ends, seen_from, there, places, turns)

    def spread(self, count: int) -> "Ties":
        """So many rows at most, evenly taken."""
        return self.select(np.unique(np.linspace(0, len(self) - 1, min(count, len(self))).astype(int)))

    def at(self, frames: Pose) -> tuple[Pose, Pose]:
        """Observers and targets (s, m) under frames (s, bodies)."""
        return frames[:, self.ends[0]] @ self.seen_from[None], frames[:, self.ends[1]] @ self.there[None]

    def residual(self, observer: Pose, target: Pose) -> Array:
        """W e (s, m, rows)."""
        table, (s, m) = self.table, observer.batch
        eye, seen = (Pose(p.rotation.reshape(-1, 3, 3), p.translation.reshape(-1, 3)) for p in (observer, target))
        if table.row.unary:
            eye, seen = Pose.identity(3, (len(eye),)), eye.between(seen)
        if table.row.targets_pose and table.dim == 2:
            eye, seen = (Pose(p.rotation[:, :2, :2], p.translation[:, :2]) for p in (eye, seen))
        with np.errstate(divide="ignore", invalid="ignore"):  # a target where its observer is has no bearing
            predicted = table.predict_from(None if table.row.unary else eye, seen if self.turns else seen.translation)
            error = table.row.minus(np.tile(table.values, (s, 1)), predicted, table.dim).reshape(s, m, -1)
        return np.asarray((table.whitening @ np.nan_to_num(error)[..., None])[..., 0])

    def slopes(self, observer: Pose, target: Pose) -> Array:
        """Of W e by the target's place and turn (s, m, rows, 6), in the frame of the bodies' frames."""
        count = 6 if self.turns else 3
        s, (turns, shifts) = len(target), BOTH_WAYS
        moved = Pose(
            turns[: 2 * count, None, None] @ target.rotation, target.translation + shifts[: 2 * count, None, None]
        )
        eyes = Pose(*(np.broadcast_to(of, (2 * count, *of.shape)) for of in (observer.rotation, observer.translation)))
        ends = (Pose(p.rotation.reshape(-1, *p.batch[2:], 3, 3), p.translation.reshape(-1, *p.batch[2:], 3))
                for p in (eyes, moved))  # fmt: skip
        error = self.residual(*ends).reshape(count, 2, s, len(self), -1)
        out = np.zeros((s, len(self), error.shape[-1], 6))
        out[..., :count] = np.moveaxis(error[:, 0] - error[:, 1], 0, -1) / (2.0 * STEP)
        return out

    def whiteners(self, observer: Pose, target: Pose, slopes: Array) -> Array:
        """What takes W e to sigmas (s, m, rows, rows), with what the ends are known to."""
        known = (
            (self.place_variances.sum(0) + PLACE_SIGMA**2, slopes[..., :3]),
            (self.turn_variances[0] + TURN_SIGMA**2, self._swung(observer, target, slopes)),
            (self.turn_variances[1], slopes[..., 3:]),
        )
        noise = np.eye(slopes.shape[-2]) + np.sum(
            [variance[:, None, None] * (part @ np.swapaxes(part, -1, -2)) for variance, part in known], 0
        )
        # Measurements' own noise is 1, what is added may be very much more: not by Cholesky.
        sizes, axes = np.linalg.eigh(noise)
        return np.asarray(np.swapaxes(axes, -1, -2) / np.sqrt(np.maximum(sizes, 1.0))[..., None])

    def _swung(self, observer: Pose, target: Pose, slopes: Array) -> Array:
        """Slopes (s, m, rows, 3) by the observer's turn, but for the sign."""
        return turned_about(slopes, target.translation - observer.translation)[..., 3:]


def _few(ties: Iterable[Ties]) -> list[Ties]:
    """The same rows in as few tables as can hold them, those that nothing measured apart."""
    alike: dict[Hashable, list[Ties]] = {}
    for tie in ties:
        alike.setdefault((tie.measured, kind_of(tie.table)), []).append(tie)
    return [Ties.together(same) for same in alike.values()]


def turned_about(slopes: Array, arms: Array, unit: float = 1.0) -> Array:
    """Slopes by place and turn as those by a twist [v, w] about a centre, the target at `arms` (s, m, 3) from it; v in
    units of `unit`."""
    swung = np.cross(arms[..., None, :], slopes[..., :3])  # s'(w x a) = w'(a x s)
    return np.concatenate([unit * slopes[..., :3], slopes[..., 3:] + swung], -1)


@dataclass(frozen=True, eq=False)
class Tied:
    """Bodies and all rows between them. The `given` ones come first, then the world and landmarks that are bodies;
    `moves` (n, 6) says which parts of a twist each can take."""

    given: int
    moves: BoolArray
    ties: Sequence[Ties]
    index: "_Index"

    @classmethod
    def of(cls, outlines: Sequence[Outline], flat: Sequence[bool], raw: Iterable[Table] = ()) -> "Tied":
        """`outlines` of bodies, each in its own frame, which of them stay in the plane, and raw measurements."""
        tables = _about_the_middle([t for t in raw if len(t)])
        marks = _open_marks(tables, Outline.beside(outlines)[0].keys)
        bodies, moves = list(outlines), [FLAT if planar else ALL for planar in flat]
        if any(t.row.unary for t in tables):
            bodies.append(_alone(WORLD, True))
            moves.append(FLAT if all(flat) else ALL)
        for key, kind in zip(marks.keys.tolist(), map(Kind, marks.kinds.tolist()), strict=True):
            bodies.append(_alone(key, False))
            moves.append((FLAT if kind.dim == 2 else ALL) & (ALL if kind.is_pose else STILL))
        index = _Index.of(bodies)
        ties = [*(index.ties(table) for table in tables), *index.common()]
        return cls(len(outlines), np.array(moves), [t for t in ties if len(t)], index)

    def among(self, places: Sequence[int], most: int = MOST) -> "Tied":
        """Some of the bodies with what ties them, directly or by the world or landmarks: about `most` rows of it."""
        kept = set(places) | set(range(self.given, len(self.moves)))
        while True:
            meets: dict[int, set[int]] = {n: set() for n in kept}
            for tie in self.ties:
                for a, b in set(map(tuple, tie.ends.T.tolist())):
                    if a in kept and b in kept:
                        meets[a].add(b)
                        meets[b].add(a)
            idle = {n for n in kept if n >= self.given and len(meets[n]) < 2}
            if not idle:
                break
            kept -= idle
        order = [*places, *sorted(kept - set(places))]
        new = np.full(len(self.moves), -1)
        new[order] = np.arange(len(order))
        measured = [replace(t, ends=new[t.ends]) for t in self.ties if t.measured]
        measured = [t.select(np.asarray((t.ends >= 0).all(0))) for t in measured]
        index = self.index.renumbered(new)
        ties = [t for t in (*measured, *index.common()) if len(t)]
        ties = [t.spread(max(most // len(ties), FEWEST)) for t in ties]
        return Tied(len(places), self.moves[order], _few(ties), index)

    def meetings(self) -> Array:
        """How many rows, and things that both know, tie each two of all bodies: (n, n), symmetric."""
        counts = np.zeros((len(self.moves),) * 2)
        for tie in (t for t in self.ties if t.measured):
            np.add.at(counts, tuple(tie.ends), 1.0)
        _, thing = np.unique(self.index.known.keys, return_inverse=True)
        knows = np.zeros((len(self.moves), int(thing.max(initial=0)) + 1))
        knows[self.index.body, thing] = 1.0
        common = knows @ knows.T
        np.fill_diagonal(common, 0.0)
        return np.asarray(counts + counts.T + common)

    @property
    def reach(self) -> float:
        """How far apart bodies may be [m], roughly: as far as their ways and what was measured between them go."""
        return float(max(self._lengths.max(initial=0.0), PLACE_SIGMA))

    @property
    def extent(self) -> float:
        """What is a usual length among them [m]; of things known wildly it takes no notice."""
        lengths = self._lengths[self._lengths > PLACE_SIGMA]
        return float(np.median(lengths)) if len(lengths) else PLACE_SIGMA

    @property
    def ways(self) -> BoolArray:
        """Along which axes (3,) any of the given bodies can move: what is known of others, is no length."""
        return np.asarray(self.moves[: self.given, :3].any(0))

    @property
    def _lengths(self) -> Array:
        """Of the ways, in the directions in which bodies can move, and of measurements."""
        ends = [
            np.linalg.norm(e.translation[..., self.ways], axis=-1) for t in self.ties for e in (t.seen_from, t.there)
        ]
        seen = [np.linalg.norm(t.table.values[:, : _LENGTHS.get(t.table.model, t.table.dim)], axis=-1)
                for t in self.ties]  # fmt: skip
        return np.concatenate([*ends, *seen, np.zeros(0)])


_LENGTHS = {
    "range": 1,
    "range_bearing": 1,
    "bearing": 0,
    "corners": 0,
}  # numbers of a measurement that are lengths, where not `dim`


@dataclass(frozen=True, eq=False)
class _Index:
    """All that bodies know, sorted by key: own poses first, then what is known best."""

    known: Outline
    body: IntArray

    @classmethod
    def of(cls, bodies: Sequence[Outline]) -> "_Index":
        known, body = Outline.beside(bodies)
        order = np.lexsort([known.variances, ~known.own, known.keys])
        return cls(known.at(order), body[order])

    def renumbered(self, new: IntArray) -> "_Index":
        """What bodies of new numbers know; those with a number below 0 are not there."""
        there = new[self.body] >= 0
        return _Index(self.known.at(there), new[self.body][there])

    def ties(self, table: Table) -> Ties:
        """The rows of a table whose ends two different bodies know."""
        keys = table.keys if not table.row.unary else np.insert(table.keys, 0, WORLD, 1)
        at = np.minimum(np.searchsorted(self.known.keys, keys), len(self.known.keys) - 1)
        there = (self.known.keys[at] == keys).all(1) & self.known.own[at[:, 0]] & (table.ranks > 0)
        there &= self.body[at[:, 0]] != self.body[at[:, 1]]
        there &= self.known.oriented[at[:, 1]] | (not table.sees_turns)
        return self._between(table.select(there), at[there].T)

    def common(self) -> list[Ties]:
        """What several bodies know is one thing: its place, and its turn where both know that, differ by nothing."""
        first = np.searchsorted(self.known.keys, self.known.keys)
        others = np.flatnonzero((first < np.arange(len(first))) & (self.body != self.body[first]))
        turned = self.known.oriented[others] & self.known.oriented[first[others]]
        found = []
        for model, rows in (("relative_pose", others[turned]), ("point", others[~turned])):
            keys = np.stack([self.known.keys[rows]] * 2, -1)
            still = pack(Pose.identity(3, (len(rows),))) if model == "relative_pose" else np.zeros((len(rows), 3))
            sure = np.eye(MODELS[model].residual_rows(3))[None] / SAME
            table = Table(0, COMMON, model, 3, keys, still, sure, np.arange(len(rows)))
            found.append(self._between(table, np.stack([first[rows], rows])))
        return found

    def _between(self, table: Table, at: IntArray) -> Ties:
        seen_from, there = (Pose(self.known.turns[rows], self.known.places[rows]) for rows in at)
        return Ties(table, self.body[at], seen_from, there, self.known.variances[at], self.known.turn_variances[at])


def _about_the_middle(tables: Sequence[Table]) -> list[Table]:
    """The tables with the world's origin in the middle of what was measured in it: turns about it have short arms."""
    absolute = [lift_points(t.values[:, : t.dim], 3) for t in tables if t.row.unary]
    middle = np.concatenate(absolute).mean(0) if absolute else np.zeros(3)
    return [replace(t, values=_shifted(t.values, middle[: t.dim])) if t.row.unary else t for t in tables]


def _shifted(values: Array, by: Array) -> Array:
    return np.concatenate([values[:, : len(by)] - by, values[:, len(by) :]], 1)


def _open_marks(tables: Sequence[Table], known: IntArray) -> Layout:
    """Landmarks that no body knows but that were seen, those with most sightings."""
    seen = [t.select(is_landmark(t.keys[:, -1]) & ~np.isin(t.keys[:, -1], known)) for t in tables]
    seen = [t for t in seen if len(t)]
    if not seen:
        return Layout.of(np.zeros(0, np.int64), np.zeros(0, np.int64))
    keys, times = np.unique(np.concatenate([t.keys[:, -1] for t in seen]), return_counts=True)
    most = keys[np.sort(np.argsort(-times, kind="stable")[:MOST_POINTS])]
    kinds = kinds_of(seen)
    return kinds.select(np.isin(kinds.keys, most))


def _alone(key: int, known: bool) -> Outline:
    """A body that is one thing, at its own origin."""
    one, no = np.ones(1, bool), np.zeros(1)
    return Outline(np.array([key]), np.zeros((1, 3)), np.eye(3)[None], one, no, no, one if known else ~one)
