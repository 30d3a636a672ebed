"""Where the robot is now, and the landmarks about it: one Gaussian, moved and sharpened row by row.

    moved     x_new = x (+) u        F = -D^-1 B', Q = D^-1 from H = [A B; B' D] of the odometry between the two poses
    enter     a landmark seen for the first time: the same, from the rows that see it
    seen      x (+) P_s (1 + H P_ss)^-1 (g + H d)     P - P_s (1 + H P_ss)^-1 H P_s'

with H and g of the rows (`normal_equations`), s the variables that they speak of, and d how far these have moved since
the start of the update: it is repeated, linearised anew, while the sight of things turns by more than a little.
What the filter forgets it has marginalised: a landmark that comes back enters as one that nobody knows, which loses
what was known of it and counts nothing twice. So work is bounded by how many landmarks it may hold, whatever the
mission; and as it begins anew from the map wherever a submap closes (`outlook`), its linearisations do not grow old.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.joining.start.targets import measured_poses, sightings
from teamslam.model import Kind, Layout, Table, Values, is_landmark, pack, point_kind, pose_kind, unpack
from teamslam.model.keys import WORLD
from teamslam.model.layout import KIND_DOF, KIND_SIZE, rows_of
from teamslam.solver import normal_equations

REPEATED = 3  # linearisations of one update at most
LITTLE = 0.05  # [rad] by which the sight of things may turn before rows are linearised anew: half its square is lost


@dataclass(frozen=True, eq=False)
class Order:
    """The variables of a filter: its pose first, then landmarks as they came."""

    keys: IntArray
    kinds: IntArray

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def unknowns(self) -> IntArray:
        """First unknown of each, and the total."""
        return np.concatenate([[0], np.cumsum(KIND_DOF[self.kinds])])

    @cached_property
    def numbers(self) -> IntArray:
        """First number in the state of each, and the total."""
        return np.concatenate([[0], np.cumsum(KIND_SIZE[self.kinds])])

    @cached_property
    def place(self) -> dict[int, int]:
        """The place of each landmark."""
        return {key: n for n, key in enumerate(self.keys.tolist()) if n}

    @cached_property
    def parts(self) -> list[tuple[Kind, IntArray, IntArray]]:
        """Of each kind that there is: its numbers in the state (n, size) and its unknowns (n, dof)."""
        out = []
        for kind in map(Kind, np.unique(self.kinds).tolist()):
            at = np.flatnonzero(self.kinds == kind)
            out.append(
                (kind, self.numbers[at, None] + np.arange(kind.size), self.unknowns[at, None] + np.arange(kind.dof))
            )
        return out

    def columns(self, places: IntArray) -> IntArray:
        """The unknowns of the variables at some places."""
        return rows_of(self.unknowns[places], KIND_DOF[self.kinds[places]])

    def rows(self, places: IntArray) -> IntArray:
        """The numbers in the state of the variables at some places."""
        return rows_of(self.numbers[places], KIND_SIZE[self.kinds[places]])

    def retract(self, state: Array, delta: Array) -> Array:
        """x (+) delta."""
        out = state.copy()
        for kind, numbers, unknowns in self.parts:
            if kind.is_pose:
                moved = unpack(state[numbers], kind)
                assert isinstance(moved, Pose)
                out[numbers] = pack(moved.retract(delta[unknowns]))
            else:
                out[numbers] += delta[unknowns]
        return out


@dataclass(frozen=True, eq=False)
class Filter:
    """The robot's pose and landmarks about it, written in the frame `frame` (a pose's key, or WORLD).

    `order`, `state` as `Values` has it in that order, `covariance` (n, n) over its unknowns, symmetric to rounding.
    """

    frame: int
    order: Order
    state: Array
    covariance: Array

    @classmethod
    def at(cls, key: int, dim: int) -> "Filter":
        """A robot that knows nothing but itself: its pose is the frame."""
        kind = pose_kind(dim)
        order = Order(np.array([key]), np.array([int(kind)]))
        return cls(key, order, pack(Pose.identity(dim)), np.zeros((kind.dof, kind.dof)))

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
        found = self.covariance[:n, :n]
        return np.asarray(0.5 * (found + found.T))

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
        n, covariance = self.kind.dof, self.covariance.copy()
        covariance[:n] = F @ self.covariance[:n]
        covariance[:, :n] = covariance[:, :n] @ F.T
        covariance[:n, n:] = covariance[n:, :n].T
        covariance[:n, :n] += Q
        keys = self.order.keys.copy()
        keys[0] = new
        order = Order(keys, self.order.kinds)
        for name in ("unknowns", "numbers", "place", "parts"):  # they do not depend on what the pose is called
            if name in self.order.__dict__:
                order.__dict__[name] = self.order.__dict__[name]
        return Filter(self.frame, order, np.concatenate([pack(there), self.state[m:]]), covariance)

    def _beyond(self, table: Table) -> Pose:
        """Where the first relative pose of a table puts the next pose."""
        step = measured_poses(table if len(table) == 1 else table.select(np.zeros(1, np.int64)), self.kind.dim)[0]
        return self.pose @ (step if int(table.keys[0, 0]) == self.key else step.inverse())

    # --- seeing ---------------------------------------------------------------------------------------------------

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
        across = F @ self.covariance[:n]
        own = across[:, :n] @ F.T + Q
        covariance = np.block([[self.covariance, across.T], [across, 0.5 * (own + own.T)]])
        order = Order(np.concatenate([self.order.keys, keys]), np.concatenate([self.order.kinds, kinds]))
        return Filter(self.frame, order, np.concatenate([self.state, states.ravel()]), covariance)

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
        eye = np.eye(len(columns))
        state, moved = self.state, np.zeros(len(columns))
        for _ in range(REPEATED):
            try:
                _, H, g = normal_equations(table, keys, kinds, state[rows])
            except ModelError:  # kinds that the model does not relate: the submap's business
                return self
            if not (np.isfinite(g).all() and np.isfinite(H).all()):
                return self
            gain = np.linalg.solve(eye + H @ P_ss, np.concatenate([H, (g + H @ moved)[:, None]], 1))
            shift = P_s @ gain[:, -1]
            state = self.order.retract(self.state, shift)
            ahead, moved = shift[columns] - moved, shift[columns]
            if not self._turned(ahead, places):
                break
        inner = gain[:, :-1]
        covariance = P_s @ (0.5 * (inner + inner.T)) @ P_s.T
        np.subtract(self.covariance, covariance, out=covariance)  # in place: what is made of n^2 numbers takes its time
        return Filter(self.frame, self.order, state, covariance)

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
        if len(self.order) - 1 <= most:
            return self
        places = self.state[self.order.numbers[1:-1, None] + np.arange(2)]
        away = np.sum((places - self.state[:2]) ** 2, -1)
        kept = np.concatenate([[0], 1 + np.sort(np.argsort(away, kind="stable")[:most])])
        columns = self.order.columns(kept)
        return Filter(
            self.frame, Order(self.order.keys[kept], self.order.kinds[kept]), self.state[self.order.rows(kept)],
            self.covariance[np.ix_(columns, columns)],
        )  # fmt: skip


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
