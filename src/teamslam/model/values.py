"""What is believed: an estimate of many variables, as one flat vector with a layout.

`Values` is a layout with numbers. The state vector holds poses as T then R (row-major) and points as they are, so that
the native kernel and numpy read the same memory.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.cards import card
from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose, Sealed, seal
from teamslam.model.layout import KIND_SIZE, Kind, Layout, rows_of


@dataclass(frozen=True, eq=False)
class Values(Sealed):
    """An estimate: a layout and its state vector. All frames alike: the one that the owner states."""

    layout: Layout
    state: Array  # (layout.state_start[-1],)

    def __post_init__(self) -> None:
        if self.state.shape != (int(self.layout.state_start[-1]),):
            raise ModelError(f"the layout needs {int(self.layout.state_start[-1])} numbers, found {self.state.shape}")
        seal(self, "state")

    def __repr__(self) -> str:
        return repr(self.layout).replace("Layout", "Values", 1)

    def _repr_html_(self) -> str:
        from teamslam.model.portrait import portrait

        counts = [(kind.name.lower(), f"{len(keys):,}") for kind, keys, _ in self.parts()]
        return card(f"Values of {len(self):,} variables", counts, picture=portrait(self))

    @classmethod
    def of(cls, parts: dict[Kind, tuple[IntArray, Pose | Array]]) -> "Values":
        """Values from keys (n,) and Poses or points (n, d) per kind, in any order of keys."""
        keys, kinds, states = [], [], []
        for kind in sorted(parts):
            part_keys, data = parts[kind]
            kinds.append(np.full(len(part_keys), int(kind)))
            flat = pack(data)
            if flat.shape != (len(part_keys), kind.size):
                raise ModelError(f"{kind.name} needs {len(part_keys)} rows of {kind.size} numbers, found {flat.shape}")
            part_keys = np.asarray(part_keys, np.int64)
            if not (part_keys[1:] > part_keys[:-1]).all():
                order = np.argsort(part_keys, kind="stable")
                part_keys, flat = part_keys[order], flat[order]
            keys.append(part_keys)
            states.append(flat.ravel())
        if not keys:
            return cls(Layout(np.zeros(0, np.int64), np.zeros(0, np.int64)), np.zeros(0))
        return cls(Layout(np.concatenate(keys), np.concatenate(kinds)), np.concatenate(states))

    @classmethod
    def together(cls, parts: Sequence["Values"]) -> "Values":
        """The variables of several estimates, of which no two know the same one (ModelError)."""
        keys, kinds, state = (
            np.concatenate(column)
            for column in zip(*((p.layout.keys, p.layout.kinds, p.state) for p in parts), strict=True)
        )
        order = np.lexsort((keys, kinds))
        sizes = KIND_SIZE[kinds]
        starts = np.cumsum(sizes) - sizes
        return cls(Layout(keys[order], kinds[order]), state[rows_of(starts[order], sizes[order])])

    def __len__(self) -> int:
        return len(self.layout)

    def table(self, kind: Kind) -> Array:
        """The raw rows (n, size) of one kind: a view."""
        at = self.layout.stretch(kind)
        return self.state[self.layout.state_start[at.start] : self.layout.state_start[at.stop]].reshape(-1, kind.size)

    def of_kind(self, kind: Kind) -> Pose | Array:
        """All variables of one kind, in key order: Pose (n,) or points (n, d)."""
        return unpack(self.table(kind), kind)

    def parts(self) -> Iterator[tuple[Kind, IntArray, Pose | Array]]:
        """Each kind that occurs, with its keys and its Poses or points."""
        for kind in Kind:
            if len(keys := self.layout.keys_of(kind)):
                yield kind, keys, self.of_kind(kind)

    def gather(self, keys: AnyArray, kind: Kind) -> Pose | Array:
        """Variables of one kind by key, any batch shape of keys."""
        starts = self.layout.state_start[self.layout.index(keys)]
        return unpack(self.state[starts[..., None] + np.arange(kind.size)], kind)

    def pose(self, key: int) -> Pose:
        """One pose. Raises ModelError where the key is no pose."""
        kind = Kind(int(self.layout.kinds[self.layout.index(key)]))
        found = self.gather(np.asarray(key), kind)
        if not isinstance(found, Pose):
            raise ModelError(f"variable {key} is a point, not a pose")
        return found

    def positions(self, keys: AnyArray, dim: int) -> Array:
        """Where variables are, (..., dim) [m]: points, and the translations of poses; planar ones lie at height 0."""
        keys = np.asarray(keys, np.int64)
        places = self.layout.index(keys)
        out = np.zeros((*keys.shape, dim))
        for kind in Kind:
            if (mask := self.layout.kinds[places] == kind).any():
                d = min(dim, kind.dim)
                starts = self.layout.state_start[places[mask]]
                out[mask, :d] = self.state[starts[:, None] + np.arange(d)]
        return out

    def poses_of(self, keys: AnyArray, dim: int) -> Pose:
        """The poses of several keys as one batch of dimension `dim`, planar ones lifted where dim is 3."""
        keys = np.asarray(keys, np.int64)
        kinds = self.layout.kinds[self.layout.index(keys)]
        rotation, translation = np.zeros((*keys.shape, dim, dim)), np.zeros((*keys.shape, dim))
        for kind in (Kind.POSE2, Kind.POSE3):
            if (mask := kinds == kind).any():
                found = self.gather(keys[mask], kind)
                assert isinstance(found, Pose)
                lifted = found.lift(dim)
                rotation[mask], translation[mask] = lifted.rotation, lifted.translation
        if (kinds > Kind.POSE3).any():
            raise ModelError(f"variable {int(keys[kinds > Kind.POSE3].flat[0])} is a point where a pose is needed")
        return Pose(rotation, translation)

    # --- the chart ----------------------------------------------------------------------------------------------

    def retract(self, delta: Array) -> "Values":
        """x (+) delta, delta (layout.dof,)."""
        return self._each(lambda kind, data, d: data.retract(d) if isinstance(data, Pose) else data + d, delta)

    def minus(self, other: "Values") -> Array:
        """x (-) other, (layout.dof,), for values of the same layout. Law: (x (+) d) (-) x = d."""
        if not np.array_equal(self.layout.keys, other.layout.keys):
            raise ModelError("two estimates of different variables cannot be subtracted")
        out = np.zeros(self.layout.dof)
        for kind, _, mine in self.parts():
            theirs = other.of_kind(kind)
            difference = _subtract(mine, theirs)
            at = self.layout.stretch(kind)
            out[self.layout.dof_start[at.start] : self.layout.dof_start[at.stop]] = difference.ravel()
        return out

    # --- frames and parts ---------------------------------------------------------------------------------------

    def transform(self, frame: Pose) -> "Values":
        """The same things written in another frame: X -> frame @ X, p -> frame.act(p).

        A planar frame moves spatial values by its lift; a spatial frame cannot move planar values (ModelError).
        """

        def move(kind: Kind, data: Pose | Array) -> Pose | Array:
            lifted = frame.lift(kind.dim)
            return lifted @ data if isinstance(data, Pose) else lifted.act(data)

        return Values(
            self.layout, np.concatenate([pack(move(k, x)).ravel() for k, _, x in self.parts()] or [np.zeros(0)])
        )

    def seen_from(self, frame: Pose, layout: Layout) -> "Values":
        """The variables of `layout` as seen from a frame, of the kinds that it states (planar ones lifted where it
        says so).

        The observation function h of a submap (paper, eqs. 12-14): X -> frame^-1 X, p -> R'(p - T).
        """
        state = []
        for kind in Kind:
            keys = layout.keys_of(kind)
            eye = frame.lift(kind.dim) if len(keys) else frame
            if len(keys) and kind.is_pose:
                state.append(pack(eye.between(self.poses_of(keys, kind.dim))))
            elif len(keys):
                state.append(eye.unact(self.positions(keys, kind.dim)))
        return Values(layout, np.concatenate([part.ravel() for part in state] or [np.zeros(0)]))

    def select(self, mask: BoolArray) -> "Values":
        """The variables where mask (n,) is true."""
        places = np.flatnonzero(mask)
        rows = rows_of(self.layout.state_start[places], KIND_SIZE[self.layout.kinds[places]])
        return Values(self.layout.select(mask), self.state[rows])

    def only(self, keys: AnyArray) -> "Values":
        """The variables named by keys; unknown ones raise ModelError."""
        mask = np.zeros(len(self), bool)
        mask[self.layout.index(keys)] = True
        return self.select(mask)

    def renamed(self, keys: AnyArray, names: AnyArray) -> "Values":
        """The variables of `keys` (n,), unique, under the names (n,) in their place."""
        at = self.layout.index(keys)
        kinds = self.layout.kinds[at]
        order = np.lexsort((names, kinds))
        rows = rows_of(self.layout.state_start[at[order]], KIND_SIZE[kinds[order]])
        return Values(Layout(np.asarray(names, np.int64)[order], kinds[order]), self.state[rows])

    def update(self, other: "Values") -> "Values":
        """These variables with the other's added; where both know one, the other's is taken."""
        layout = self.layout.union(other.layout)
        state = np.zeros(int(layout.state_start[-1]))
        for values in (self, other):
            places = layout.index(values.layout.keys)
            state[rows_of(layout.state_start[places], KIND_SIZE[layout.kinds[places]])] = values.state
        return Values(layout, state)

    def _each(self, function: Callable[[Kind, Pose | Array, Array], Pose | Array], delta: Array) -> "Values":
        out = []
        for kind, keys, data in self.parts():
            at = self.layout.stretch(kind)
            part = delta[self.layout.dof_start[at.start] : self.layout.dof_start[at.stop]].reshape(len(keys), kind.dof)
            out.append(pack(function(kind, data, part)).ravel())
        return Values(self.layout, np.concatenate(out or [np.zeros(0)]))


def _subtract(a: Pose | Array, b: Pose | Array) -> Array:
    if isinstance(a, Pose) and isinstance(b, Pose):
        return a.minus(b)
    assert not isinstance(a, Pose) and not isinstance(b, Pose)
    return a - b


def pack(data: Pose | Array) -> Array:
    """Poses or points as rows of the state vector: (..., size)."""
    if isinstance(data, Pose):
        return np.concatenate([data.translation, data.rotation.reshape(*data.batch, data.dim**2)], -1)
    return np.asarray(data, float)


def unpack(rows: Array, kind: Kind) -> Pose | Array:
    """Rows of the state vector as Poses or points; the inverse of `pack`."""
    if not kind.is_pose:
        return rows
    d = kind.dim
    return Pose(rows[..., d:].reshape(*rows.shape[:-1], d, d), rows[..., :d])
