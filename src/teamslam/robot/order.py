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

from teamslam.geometry import Array, BoolArray, IntArray, lift_tangent, rotations
from teamslam.model import Kind, is_landmark
from teamslam.model.layout import KIND_DOF, KIND_SIZE, rows_of

# They do not depend on what the pose of now is called.
SHARED = ("unknowns", "numbers", "natively", "kind", "place", "first")


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
    def kind(self) -> Kind:
        """Of the pose of now."""
        return Kind(int(self.kinds[0]))

    @cached_property
    def first(self) -> int:
        """The place of the first landmark."""
        return next((n for n, key in enumerate(self.keys[:2].tolist()) if is_landmark(key)), min(2, len(self.keys)))

    @cached_property
    def place(self) -> dict[int, int]:
        """The place of each landmark."""
        return {key: n for n, key in enumerate(self.keys.tolist()) if n >= self.first}

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


def turning(kind: Kind, state: Array, centre: Array) -> Array:
    """How variables of a kind, (n, size), move in the mixed chart as they turn about a centre: (n, dof, axes)."""
    d, e = len(centre), kind.dim
    levers, upright = _generators(d), _upright(d, e)
    out = np.zeros((len(state), kind.dof, len(upright[0])))
    out[:, :d] = ((state[:, :d] - centre) @ levers).reshape(len(state), d, -1)
    if kind.is_pose:
        rotation = state[:, e:].reshape(-1, e, e)
        turned = rotations(e).adjoint(np.swapaxes(rotation, -1, -2))
        out[:, e:] = turned if d == e else turned @ upright
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
