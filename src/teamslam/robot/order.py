"""The variables of a filter in the order in which they came, and how they move together.

Two kinds of variables stand side by side. What the map has told of is written in the map's frame, each variable by
itself. The pose of now, and what the robot has seen for the first time since, `turns` with it:

    T' = c + Exp(w) (T - c) + Exp(w/2) v      R' = Exp(w) R Exp(u)      w: the turn of the pose of now, c: a centre

for what is known of these is how they lie to each other; the heading of all of them is known far less. In these
unknowns a sighting of a point is linear but for the turn of the robot itself, however wrong the heading is: rows that
are linearised at one heading and at another agree (the invariant filter: Barrau and Bonnabel 2017). The half turn is
the exponential of that group but for terms of third order: what is known to stay where it is stays there, however all
turns about it. Without it each turn to and fro would push things outward, and that adds up.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from teamslam.geometry import Array, BoolArray, IntArray, Pose, lift_tangent, rotations
from teamslam.model import Kind, is_landmark, unpack
from teamslam.model.layout import KIND_DOF, KIND_SIZE, rows_of

Part = tuple[Kind, bool, IntArray, IntArray]
SHARED = ("unknowns", "numbers", "natively", "place", "parts", "first")  # they do not depend on what the pose of now is called


@dataclass(frozen=True, eq=False)
class Order:
    """Variables by `keys` (n,) and `kinds` (n,): the pose of now, that at which the filter began (where a map told of
    it), landmarks as they came. `turns` (n,): which turn with the pose of now."""

    keys: IntArray
    kinds: IntArray
    turns: BoolArray

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
    def natively(self) -> NDArray[np.int32]:
        """The kinds as the kernel takes them."""
        return self.kinds.astype(np.int32)

    @cached_property
    def first(self) -> int:
        """The place of the first landmark."""
        return next((n for n, key in enumerate(self.keys[:2].tolist()) if is_landmark(key)), min(2, len(self.keys)))

    @cached_property
    def place(self) -> dict[int, int]:
        """The place of each landmark."""
        return {key: n for n, key in enumerate(self.keys.tolist()) if n >= self.first}

    @cached_property
    def parts(self) -> list[Part]:
        """Of each kind that there is, those that turn and those that do not: their numbers in the state (n, size) and
        their unknowns (n, dof)."""
        out = []
        for kind in map(Kind, np.unique(self.kinds).tolist()):
            for turns in (False, True):
                at = np.flatnonzero((self.kinds == kind) & (self.turns == turns))
                if len(at):
                    numbers, unknowns = self.numbers[at, None], self.unknowns[at, None]
                    out.append((kind, turns, numbers + np.arange(kind.size), unknowns + np.arange(kind.dof)))
        return out

    def columns(self, places: IntArray) -> IntArray:
        """The unknowns of the variables at some places."""
        return rows_of(self.unknowns[places], KIND_DOF[self.kinds[places]])

    def rows(self, places: IntArray) -> IntArray:
        """The numbers in the state of the variables at some places."""
        return rows_of(self.numbers[places], KIND_SIZE[self.kinds[places]])

    # --- with others ----------------------------------------------------------------------------------------------

    def at(self, key: int) -> "Order":
        """With another pose of now."""
        keys = self.keys.copy()
        keys[0] = key
        order = Order(keys, self.kinds, self.turns)
        order.__dict__.update({name: self.__dict__[name] for name in SHARED if name in self.__dict__})
        return order

    def only(self, places: IntArray) -> "Order":
        """Those at some places."""
        return Order(self.keys[places], self.kinds[places], self.turns[places])

    def plus(self, other: "Order") -> "Order":
        """And others after them."""
        return Order(
            np.concatenate([self.keys, other.keys]), np.concatenate([self.kinds, other.kinds]),
            np.concatenate([self.turns, other.turns]),
        )  # fmt: skip

    # --- moving ---------------------------------------------------------------------------------------------------

    def turning(self, state: Array, centre: Array) -> Array:
        """How all unknowns of the mixed chart move as those that turn turn about the centre: (unknowns, axes)."""
        dim = len(centre)
        out = np.zeros((int(self.unknowns[-1]), rotations(dim).DOF))
        for kind, turns, numbers, unknowns in self.parts:
            if turns:
                out[unknowns] = turning(kind, state[numbers], centre)
        return out

    def retract(self, state: Array, delta: Array, centre: Array) -> Array:
        """x (+) delta, by the formulas above, on the numbers themselves."""
        out, d, n = state.copy(), len(centre), int(KIND_DOF[self.kinds[0]])
        half = rotations(d).exp(0.5 * delta[d:n]) if self.turns[0] else np.eye(d)
        turn = half @ half
        for kind, turns, numbers, unknowns in self.parts:
            e, there, step = kind.dim, state[numbers], delta[unknowns]
            if turns:
                there[:, :d] = (there[:, :d] - centre) @ turn.T + centre
                step[:, :d] = step[:, :d] @ half.T
            there[:, :e] += step[:, :e]
            if kind.is_pose:
                rotation = there[:, e:].reshape(-1, e, e)
                if turns:
                    rotation[:, :d] = turn @ rotation[:, :d]
                if turns and unknowns[0, 0] == 0:
                    step[0, e:] = 0.0  # its turn is that of all
                if step[:, e:].any():
                    rotation = rotation @ rotations(e).exp(step[:, e:])
                there[:, e:] = rotation.reshape(len(there), -1)
            out[numbers] = there
        return out

    def minus(self, state: Array, other: Array) -> Array:
        """x (-) y in the mixed chart, of variables each by itself."""
        out = np.zeros(int(self.unknowns[-1]))
        for kind, _, numbers, unknowns in self.parts:
            here, there = unpack(state[numbers], kind), unpack(other[numbers], kind)
            if isinstance(here, Pose) and isinstance(there, Pose):
                out[unknowns] = here.minus(there)
            else:
                out[unknowns] = state[numbers] - other[numbers]
        return out


def turning(kind: Kind, state: Array, centre: Array) -> Array:
    """How variables of a kind, (n, size), move in the mixed chart as they turn about a centre: (n, dof, axes)."""
    d, e = len(centre), kind.dim
    levers, upright = _generators(d), _upright(d, e)
    out = np.zeros((len(state), kind.dof, len(upright[0])))
    out[:, :d] = ((state[:, :d] - centre) @ levers).reshape(len(state), d, -1)
    if kind.is_pose:
        rotation = state[:, e:].reshape(-1, e, e)
        out[:, e:] = rotations(e).adjoint(np.swapaxes(rotation, -1, -2)) @ upright
    return out


@lru_cache
def _upright(dim: int, space: int) -> Array:
    """The axes of a turn in a space of more dimensions."""
    return lift_tangent(dim, space)[space:, dim:]


@lru_cache
def _generators(dim: int) -> Array:
    """d/dw Exp(w) p at 0 for each number of p: (numbers, numbers x axes)."""
    each = np.asarray(rotations(dim).hat(np.eye(rotations(dim).DOF)))
    return np.ascontiguousarray(each.transpose(2, 1, 0).reshape(dim, -1))
