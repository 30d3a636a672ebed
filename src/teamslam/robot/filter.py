"""Where the robot is now, and the landmarks about it: one Gaussian, moved and sharpened row by row.

    moved     x_new = x (+) u        F = -D^-1 B', Q = D^-1 from H = [A B; B' D] of the odometry between the two poses
    told      a landmark that the map knows, seen for the first time: from the map, given what is held of it (`ahead`)
    enter     a landmark that nobody knows: as the pose, from the rows that see it
    seen      x (+) P J' S^-1 (e + J d)     P - P J' S^-1 J P     S = 1 + J P J'

with e and J of the rows, whitened and weighted, and d how far x has moved since the start of the update: it is
repeated, linearised anew, while the sight of things turns by more than a little. All in the unknowns of `order`, in
which what is new turns with the pose. `moved`, `told` and `seen` are one call each of the native kernel
(cpp/filter.hpp, cpp/telling.hpp), for sensors that people added as well: the kernel asks for their rows.

What the filter forgets it has marginalised: a landmark that comes back enters as one that nobody knows, which loses
what was known of it and counts nothing twice. So work is bounded by how many landmarks it may hold, whatever the
mission; and as it begins anew from the map wherever a submap closes (`outlook`), its linearisations do not grow old.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.start.targets import measured_poses, sightings
from teamslam.model import Kind, Layout, Table, Values, is_landmark, pack, point_kind, pose_kind, unpack
from teamslam.model.keys import WORLD
from teamslam.robot.ahead import Ahead
from teamslam.robot.changed import changed
from teamslam.robot.order import Order, turning
from teamslam.solver import Gaussian, moved, normal_equations, seen, told

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
        return self.order.kind

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
        T = _charted(self._turning)
        found = T @ self.covariance[:n, :n] @ T.T
        return np.asarray(0.5 * (found + found.T))

    @property
    def _turning(self) -> Array:
        """How the pose of now moves in the mixed chart as it turns: (unknowns, axes)."""
        return np.asarray(turning(self.kind, self.state[None, : self.kind.size], self.centre)[0])

    # --- moving ---------------------------------------------------------------------------------------------------

    def moved(self, table: Table) -> "Filter | None":
        """At the next pose, by relative poses between this one and that; None where they leave it open."""
        found = moved(self._numbers, self.key, table, _first_step(table, self.kind.dim))
        if found is None:
            return None
        keys = table.keys[0].tolist()
        order = self.order.at(keys[1] if keys[0] == self.key else keys[0])
        return changed(self, order=order, state=found[0], covariance=found[1])

    @property
    def _numbers(self) -> Gaussian:
        """As the kernel takes it."""
        return Gaussian(self.order.natively, self.order.turns, self.centre, self.state, self.covariance)

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
        mine = self.order.keys[~self.order.turns].tolist()  # the first is the pose where the map begins
        theirs = np.array([0, *(known[k] for k in mine[1:])])
        new = np.array([known[k] for k in marks])
        found = told(self._numbers, self.ahead.numbers, theirs, new)
        if found is None:
            return self
        return changed(
            self, order=self.order.plus(self.ahead.order.only(new)), state=found[0], covariance=found[1],
            told=self.told | frozenset(marks),
        )  # fmt: skip

    def entered(self, table: Table) -> "Filter":
        """With the landmarks that a table's rows see whole from this pose and that were not in it yet; each by its
        first row."""
        targets, held = table.keys[:, 1], self.order.place
        unheld = [key not in held for key in targets.tolist()]
        if not any(unheld):
            return self
        new = np.array(unheld) & is_landmark(targets)
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
        F = F @ _charted(self._turning)
        F[:, self.kind.dim :] -= turning(Kind(int(kinds[0])), states, self.centre).reshape(len(F), -1)
        across = F @ self.covariance[:n]
        own = across[:, :n] @ F.T + Q
        covariance = _grown(self.covariance, across, own)
        order = self.order.plus(Order(keys, kinds, np.ones(len(keys), bool)))
        return changed(self, order=order, state=np.concatenate([self.state, states.ravel()]), covariance=covariance)

    def seen(self, table: Table) -> "Filter":
        """Sharpened by the rows of a table that see what it holds from this pose."""
        if table.row.unary:
            if self.frame != WORLD:
                return self
            known, index = [key == self.key for (key,) in table.keys.tolist()], np.zeros((len(table), 1), np.int64)
        else:
            known = [self.order.place.get(key, 0) for key in table.keys[:, 1].tolist()]
            index = np.array([(0, place) for place in known])
        if not any(known):
            return self
        if not all(known):
            rows = np.array(known, bool)
            table, index = table.select(rows), index[rows]
        try:
            found = seen(self._numbers, self.order.keys, table, index, REPEATED, LITTLE)
        except ModelError:  # kinds that the model does not relate: the submap's business
            return self
        return self if found is None else changed(self, state=found[0], covariance=found[1])

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
        return changed(
            self, order=self.order.only(kept), state=self.state[self.order.rows(kept)],
            covariance=self.covariance[np.ix_(columns, columns)],
        )  # fmt: skip


def _first_step(table: Table, dim: int) -> Array:
    """What the first row of relative poses measured between two bodies, as a pose's numbers."""
    if table.row.measures_pose and table.sensor is None and table.dim == dim:
        return np.asarray(table.values[0])
    return np.asarray(pack(measured_poses(table.select(np.zeros(1, np.int64)), dim))[0])


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
