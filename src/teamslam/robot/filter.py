"""Where the robot is now, and the landmarks about it: one Gaussian, moved and sharpened row by row.

    moved     x_new = x (+) u        F = -D^-1 B', Q = D^-1 from H = [A B; B' D] of the odometry between the two poses
    told      a landmark that the map knows, seen for the first time: from the map, given what is held of it (`ahead`)
    enter     a landmark that nobody knows: as the pose, from the rows that see it
    seen      x (+) P_s (1 + H P_ss)^-1 (g + H d)     P - P_s (1 + H P_ss)^-1 H P_s'

with H and g of the rows (`normal_equations`), s the variables that they speak of, and d how far these have moved since
the start of the update: it is repeated, linearised anew, while the sight of things turns by more than a little.
All in the unknowns of `order`, in which what is new turns with the pose.

What the filter forgets it has marginalised: a landmark that comes back enters as one that nobody knows, which loses
what was known of it and counts nothing twice. So work is bounded by how many landmarks it may hold, whatever the
mission; and as it begins anew from the map wherever a submap closes (`outlook`), its linearisations do not grow old.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.joining.start.targets import measured_poses, sightings
from teamslam.model import Kind, Layout, Table, Values, is_landmark, pack, point_kind, pose_kind, unpack
from teamslam.model.keys import WORLD
from teamslam.robot.ahead import Ahead
from teamslam.robot.order import Order, turning
from teamslam.solver import normal_equations

REPEATED = 3  # linearisations of one update at most
LITTLE = 0.05  # [rad] by which the sight of things may turn before rows are linearised anew: half its square is lost


@dataclass(frozen=True, eq=False)
class Filter:
    """The robot's pose and landmarks about it, written in the frame `frame` (a pose's key, or WORLD).

    `order`, `state` as `Values` has it in that order, `covariance` (n, n) over its unknowns, symmetric to rounding;
    `centre` (d,), about which things turn. `ahead`: what the map knows; `told`: the landmarks that it has told of.
    """

    frame: int
    order: Order
    state: Array
    covariance: Array
    centre: Array
    ahead: Ahead | None = None
    told: frozenset[int] = frozenset()

    @classmethod
    def at(cls, key: int, dim: int) -> "Filter":
        """A robot that knows nothing but itself: its pose is the frame."""
        kind = pose_kind(dim)
        order = Order(np.array([key]), np.array([int(kind)]), np.ones(1, bool))
        return cls(key, order, pack(Pose.identity(dim)), np.zeros((kind.dof, kind.dof)), np.zeros(dim))

    @classmethod
    def begun(cls, ahead: Ahead) -> "Filter":
        """A robot at the pose where it begins, of which a map knows; and that pose."""
        order = Order(ahead.order.keys[[0, 0]], ahead.order.kinds[[0, 0]], np.array([True, False]))
        kind = Kind(int(order.kinds[0]))
        here = ahead.state[: kind.size]
        pose = unpack(here, kind)
        assert isinstance(pose, Pose)
        centre = pose.translation.copy()
        J = np.concatenate([np.linalg.inv(_charted(turning(kind, here[None], centre)[0])), np.eye(kind.dof)])
        return cls(
            ahead.frame, order, np.tile(here, 2), J @ ahead.covariance[: kind.dof, : kind.dof] @ J.T, centre, ahead
        )

    @property
    def key(self) -> int:
        """The pose of now."""
        return int(self.order.keys[0])

    @property
    def kind(self) -> Kind:
        """Of that pose."""
        return Kind(int(self.order.kinds[0]))

    @property
    def pose(self) -> Pose:
        """The robot in the frame."""
        found = unpack(self.state[: self.kind.size], self.kind)
        assert isinstance(found, Pose)
        return found

    @property
    def pose_covariance(self) -> Array:
        """Its covariance in the chart of `geometry.pose`."""
        n = self.kind.dof
        T = _charted(self.turning[:n])
        found = T @ self.covariance[:n, :n] @ T.T
        return np.asarray(0.5 * (found + found.T))

    @cached_property
    def turning(self) -> Array:
        """How all unknowns of the mixed chart move as what turns turns: (unknowns, axes)."""
        return self.order.turning(self.state, self.centre)

    # --- moving ---------------------------------------------------------------------------------------------------

    def moved(self, table: Table) -> "Filter | None":
        """At the next pose, by relative poses between this one and that; None where they leave it open."""
        new = int(table.keys[table.keys != self.key][0])
        start = self._beyond(table)
        keys, kinds = np.array([self.key, new]), np.repeat(self.order.kinds[:1], 2)
        m = self.kind.size
        old = self.state[:m]
        pair = np.concatenate([old, pack(start)])
        _, H, g = normal_equations(table, keys, kinds, pair)
        found = _conditional(H, g, self.kind.dof)
        if found is None:
            return None
        F, Q, shift = found
        there = (start if len(table) == 1 else start.retract(shift)).sharpened()
        order, state = self.order.at(new), np.concatenate([pack(there), self.state[m:]])
        C = self.turning.copy()
        C[: self.kind.dof] = turning(self.kind, state[None, :m], self.centre)[0]
        onward = replace(self, order=order, state=state, covariance=self._carried(F, Q, C))
        onward.__dict__["turning"] = C
        return onward

    def _carried(self, F: Array, Q: Array, C: Array) -> Array:
        """The covariance at a new pose, where things turn by C. What turns is where it was: where the pose has turned,
        it has not turned along."""
        n, d = self.kind.dof, self.kind.dim
        back, axes = np.linalg.inv(_charted(C[:n])), np.eye(n)[d:]
        F, Q = back @ F @ _charted(self.turning[:n]), back @ Q @ back.T
        by_noise, by_old = -C @ axes, C @ (axes - F[d:])
        by_noise[:n], by_old[:n] = np.eye(n), F - np.eye(n)
        out = self.covariance + by_old @ self.covariance[:n]
        out += out[:, :n] @ by_old.T
        out += by_noise @ Q @ by_noise.T
        return np.asarray(out)

    def _beyond(self, table: Table) -> Pose:
        """Where the first relative pose of a table puts the next pose."""
        step = measured_poses(table if len(table) == 1 else table.select(np.zeros(1, np.int64)), self.kind.dim)[0]
        return self.pose @ (step if int(table.keys[0, 0]) == self.key else step.inverse())

    # --- seeing ---------------------------------------------------------------------------------------------------

    def recalled(self, table: Table) -> "Filter":
        """With the landmarks of a table's rows that the map knows, where they were not in it yet."""
        if self.ahead is None or table.row.unary:
            return self
        known, held = self.ahead.order.place, self.order.place
        marks = [k for k in dict.fromkeys(table.keys[:, 1].tolist()) if k in known and k not in held]
        marks = [k for k in marks if k not in self.told]
        if not marks:
            return self
        mine = np.flatnonzero(~self.order.turns)
        theirs = np.array([0, *(known[k] for k in self.order.keys[mine[1:]].tolist())])
        new = np.array([known[k] for k in marks])
        found = self.ahead.conditional(theirs, new)
        if found is None:
            return self
        G, left = found
        across = G @ self.covariance[self.order.columns(mine)]
        own = across[:, self.order.columns(mine)] @ G.T + left
        there = self.ahead.moved(theirs, self.state[self.order.rows(mine)], new, G)
        return replace(
            self, order=self.order.plus(self.ahead.order.only(new)), state=np.concatenate([self.state, there]),
            covariance=_grown(self.covariance, across, own),
            told=self.told | frozenset(marks),
        )  # fmt: skip

    def entered(self, table: Table) -> "Filter":
        """With the landmarks that a table's rows see whole from this pose and that were not in it yet; each by its
        first row."""
        targets = table.keys[:, 1]
        new = np.fromiter((int(k) not in self.order.place for k in targets), bool, len(targets))
        new[new] &= is_landmark(targets[new])
        if not new.any():
            return self
        fresh = table.select(new) if not new.all() else table
        found = self._first_seen(fresh)
        if not found:
            return self
        placed = {int(key): n for n, key in enumerate(found[0].tolist())}
        first: dict[int, int] = {}
        for row, key in enumerate(fresh.keys[:, 1].tolist()):
            if key in placed:
                first.setdefault(key, row)
        rows = np.array([first[key] for key in found[0].tolist()])
        return self._with(fresh.select(rows), *found)

    def _first_seen(self, table: Table) -> tuple[IntArray, IntArray, Array] | None:
        """Keys, kinds and states of the targets of rows that fix them whole."""
        here = Values.of({self.kind: (np.array([self.key]), self.pose[None])})
        whole = table.row.targets_pose
        marks = np.unique(table.keys[:, 1])
        kind = pose_kind(table.dim) if whole else point_kind(table.dim)
        seen = sightings(table, here, Layout.of(marks, np.full(len(marks), int(kind))), whole)
        if seen is None:
            return None
        keys, data = seen[kind]
        return keys, np.full(len(keys), int(kind)), pack(data)

    def _with(self, table: Table, keys: IntArray, kinds: IntArray, states: Array) -> "Filter":
        """With new variables, one row of the table for each."""
        n = self.kind.dof
        _, H, g = normal_equations(
            table, np.concatenate([[self.key], keys]), np.concatenate([self.order.kinds[:1], kinds]),
            np.concatenate([self.state[: self.kind.size], states.ravel()]),
        )  # fmt: skip
        found = _conditional(H, g, n)
        if found is None:
            return self
        F, Q, _ = found
        F = F @ _charted(self.turning[:n])
        F[:, self.kind.dim :] -= turning(Kind(int(kinds[0])), states, self.centre).reshape(len(F), -1)
        across = F @ self.covariance[:n]
        own = across[:, :n] @ F.T + Q
        covariance = _grown(self.covariance, across, own)
        order = self.order.plus(Order(keys, kinds, np.ones(len(keys), bool)))
        return replace(self, order=order, state=np.concatenate([self.state, states.ravel()]), covariance=covariance)

    def seen(self, table: Table) -> "Filter":
        """Sharpened by the rows of a table that see what it holds from this pose."""
        targets = table.keys[:, -1]
        if table.row.unary:
            known: BoolArray = np.full(len(targets), self.frame == WORLD) & (targets == self.key)
            places = np.zeros(1, np.int64)
        else:
            at = [self.order.place.get(key, 0) for key in targets.tolist()]
            known, places = np.array(at, bool), np.array(sorted({0, *at}))
        if not known.any():
            return self
        return self._updated(table if known.all() else table.select(known), places)

    def _updated(self, table: Table, places: IntArray) -> "Filter":
        keys, kinds = self.order.keys[places], self.order.kinds[places]
        rows, columns = self.order.rows(places), self.order.columns(places)
        P_s = self.covariance[:, columns]
        P_ss = P_s[columns]
        eye, axes = np.eye(len(columns)), slice(self.kind.dim, self.kind.dof)
        state, moved, turned = self.state, np.zeros(len(columns)), self.turning
        for _ in range(REPEATED):
            try:
                _, H, g = normal_equations(table, keys, kinds, state[rows])
            except ModelError:  # kinds that the model does not relate: the submap's business
                return self
            if not (np.isfinite(g).all() and np.isfinite(H).all()):
                return self
            T = np.eye(len(columns))
            T[:, axes] = turned[columns]
            H, g = T.T @ H @ T, T.T @ g
            gain = np.linalg.solve(eye + H @ P_ss, np.concatenate([H, (g + H @ moved)[:, None]], 1))
            shift = P_s @ gain[:, -1]
            state = self.order.retract(self.state, shift, self.centre)
            ahead, moved = shift[columns] - moved, shift[columns]
            if not self._turned(ahead, places):
                break
            turned = self.order.turning(state, self.centre)
        inner = gain[:, :-1]
        covariance = P_s @ (0.5 * (inner + inner.T)) @ P_s.T
        np.subtract(self.covariance, covariance, out=covariance)  # in place: what is made of n^2 numbers takes its time
        return replace(self, state=state, covariance=covariance)

    def _turned(self, ahead: Array, places: IntArray) -> bool:
        """Whether a movement turns the sight of some variables by more than a little."""
        d, n = self.kind.dim, self.kind.dof
        if np.abs(ahead[d:n]).max() > LITTLE:
            return True
        if len(places) == 1:
            return False
        there = self.state[self.order.numbers[places[1:], None] + np.arange(2)]
        away = np.abs(there - self.state[:2]).sum(-1).min()
        return bool(np.abs(ahead[:d]).max() + np.abs(ahead[n:]).max() > LITTLE * away)

    # --- forgetting -----------------------------------------------------------------------------------------------

    def near(self, most: int) -> "Filter":
        """With at most so many landmarks: those nearest to the robot over the ground."""
        first = self.order.first
        if len(self.order) - first <= most:
            return self
        places = self.state[self.order.numbers[first:-1, None] + np.arange(2)]
        away = np.sum((places - self.state[:2]) ** 2, -1)
        kept = np.concatenate([np.arange(first), first + np.sort(np.argsort(away, kind="stable")[:most])])
        columns = self.order.columns(kept)
        return replace(
            self, order=self.order.only(kept), state=self.state[self.order.rows(kept)],
            covariance=self.covariance[np.ix_(columns, columns)],
        )  # fmt: skip


def _charted(turned: Array) -> Array:
    """How a pose that turns by so much moves in the mixed chart with its unknowns in the filter."""
    n, axes = turned.shape
    out = np.eye(n)
    out[:, n - axes :] = turned
    return out


def _grown(covariance: Array, across: Array, own: Array) -> Array:
    """With more unknowns at the end."""
    n, m = len(covariance), len(covariance) + len(own)
    out = np.empty((m, m))
    out[:n, :n], out[n:, :n], out[:n, n:], out[n:, n:] = covariance, across, across.T, 0.5 * (own + own.T)
    return out


def _conditional(H: Array, g: Array, n: int) -> tuple[Array, Array, Array] | None:
    """Of the unknowns from n on, given those before: F, Q and the shift to their best place; None where H leaves one of
    them open."""
    D = H[n:, n:]
    scale = np.sqrt(np.maximum(np.diagonal(D), 0.0))
    if not (np.isfinite(H).all() and np.isfinite(g).all()) or scale.min() <= 0.0:
        return None
    correlation = D / np.outer(scale, scale)
    try:
        root = np.linalg.inv(np.linalg.cholesky(correlation)) / scale
    except np.linalg.LinAlgError:
        return None
    Q = root.T @ root
    return -Q @ H[n:, :n], Q, Q @ g[n:]
