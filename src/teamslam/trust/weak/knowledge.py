"""What measurements say of a map's shape, and what not: its null space, and its covariance up to where it lies.

The information H over all variables, base included, is blind to rigid motions G of the whole map, and where parts hang
loose, to N beside. With lengths weighed by M and B an M-orthonormal basis of [G N], the covariance of the shape is

    P = S (H + D)^-1 S',     S = 1 - B B'M

for any diagonal D that holds as many unknowns as B has columns, or the covariance in the frame of any pose in place of
that inverse: the pseudoinverse of H in the metric M, the inner constraints of a free network. It does not depend on
which pose is the map's frame. Nothing is regularised: D fixes what H leaves open, and S takes it out again. A map in
the world's frame has no G, and P is its covariance.
Sources: Meissl, "Die innere Genauigkeit eines Punkthaufens" (1962); Baarda, "S-transformations" (1973).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import AtMap
from teamslam.joining.exact.gap import Inverted, frame_of
from teamslam.model import WORLD, Layout, Names, Submap, Table, Values
from teamslam.solver import Factor, Matrix, SubmapTerm, System
from teamslam.trust.weak.motions import Motions, turns

ROUNDING = 1e-12  # of the stiffest direction: what is softer may not be held at all
LOOSE = 1e-6  # of the longest displacement: what moves less does not move
BLOCK = 8  # columns that are tried at once for what is not held
DENSE = 300  # unknowns: smaller problems are decomposed whole


Stacks = list[tuple[IntArray, Array]]
"""A block for every variable, those of one size as a stack (k, d, d), with the unknowns (k, d) that they are of."""


class Inverse(Protocol):
    """A covariance C over all unknowns in some frame."""

    def solve(self, right: Array) -> Array:
        """C right, right (dof,) or (dof, k)."""

    def marginals_by_size(self) -> list[tuple[IntArray, Array]]:
        """The blocks of C of every variable, those of one size as a stack, with their places."""


@dataclass(frozen=True, eq=False)
class InFrame:
    """The covariance in the frame of a variable that does not move, by that `of_others`: their `unknowns` among those
    of all, and their `places` in the layout of all."""

    of_others: Inverted
    unknowns: IntArray
    places: IntArray

    def __repr__(self) -> str:
        return f"InFrame({len(self.unknowns):,} unknowns)"

    def solve(self, right: Array) -> Array:
        """C right."""
        out = np.zeros_like(right)
        out[self.unknowns] = self.of_others.factor.solve(right[self.unknowns])
        return out

    def marginals_by_size(self) -> list[tuple[IntArray, Array]]:
        """The blocks of C, but those of what does not move: they are zero."""
        return [(self.places[at], blocks) for at, blocks in self.of_others.marginals]


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of the variables of `values`, relative to each other.

    `motions` of them; `frame` (dof, g): the motions of the whole map that no measurement could see, none in the world;
    `unknown` (dof, q): displacements that the measurements leave open beside, M-orthonormal and orthogonal to these;
    `covariance` in some frame, such as the factor of H held where it is open.
    """

    values: Values
    names: Names
    motions: Motions
    frame: Array
    unknown: Array
    covariance: Inverse

    def __repr__(self) -> str:
        return f"Knowledge({self.values!r})"

    @property
    def weight(self) -> Array:
        """M (dof,)."""
        return self.motions.weight

    @cached_property
    def open(self) -> Array:
        """B (dof, g + q)."""
        return np.concatenate([self.frame, self.unknown], 1)

    def shape(self, x: Array) -> Array:
        """S x: displacements (dof, ...) without what is open in them."""
        return np.asarray(x - self.open @ (self.open.T @ (self.weight * x.T).T))

    def spread(self, f: Array) -> Array:
        """P f, for functions f (dof, ...) of a displacement."""
        inner = f - (self.weight * (self.open @ (self.open.T @ f)).T).T
        return self.shape(self.covariance.solve(inner))

    @cached_property
    def _carried(self) -> tuple[Array, Array, Array]:
        """B, Z = C M B and B' M Z: what takes C to P = C - B Z' - Z B' + B (B' M Z) B'."""
        B = self.open
        Z = self.covariance.solve(self.weight[:, None] * B)
        return B, Z, B.T @ (self.weight[:, None] * Z)

    @cached_property
    def _given(self) -> Stacks:
        """The blocks of C of every variable; those of what does not move are zero."""
        layout, found = self.values.layout, []
        given = {blocks.shape[-1]: (places, blocks) for places, blocks in self.covariance.marginals_by_size()}
        for d in np.unique(layout.dofs).tolist():
            alike = np.flatnonzero(layout.dofs == d)
            blocks = np.zeros((len(alike), d, d))
            if d in given:
                blocks[np.searchsorted(alike, given[d][0])] = given[d][1]
            found.append((layout.dof_start[alike, None] + np.arange(d), blocks))
        return found

    @cached_property
    def stacks(self) -> Stacks:
        """The blocks of P of every variable."""
        return [(at, self._block(at, blocks)) for at, blocks in self._given]

    def few(self, which: IntArray) -> Stacks:
        """Those of some variables, by their places."""
        first = self.values.layout.dof_start[which]
        given = [(at, blocks, np.isin(at[:, 0], first)) for at, blocks in self._given]
        return [(at[chosen], self._block(at[chosen], blocks[chosen])) for at, blocks, chosen in given if chosen.any()]

    def _block(self, at: IntArray, given: Array) -> Array:
        """Blocks of P for those of C, of the unknowns `at` (k, d)."""
        B, Z, middle = self._carried
        b, z = B[at], Z[at]
        across = b @ np.swapaxes(z, 1, 2)
        return np.asarray(given + b @ middle @ np.swapaxes(b, 1, 2) - across - np.swapaxes(across, 1, 2))

    @cached_property
    def variances(self) -> Array:
        """The diagonal of P (dof,)."""
        B, Z, middle = self._carried
        found = np.empty(len(self.weight))
        for at, blocks in self._given:
            found[at] = np.diagonal(blocks, axis1=1, axis2=2)
        return np.asarray(found + np.sum(B * (B @ middle - 2.0 * Z), 1))

    def stretch(self, told: Array) -> float:
        """The most that the variance of an unknown grows by what others are not known: max C_ii H_ii, `told` (dof,) the
        diagonal of H.

        What is not held grows to the inverse of rounding. Law: neither units nor the number of poses matter, as they do
        for the softest direction beside the stiffest: odometry at 200 Hz is ten orders stiffer than the whole of a map.
        """
        grown = [(np.diagonal(blocks, axis1=1, axis2=2) * told[at]).max(initial=0.0) for at, blocks in self._given]
        return float(max(grown, default=0.0))

    @property
    def total(self) -> float:
        """The sum of all variances, in the metric: no direction has a larger one."""
        return float(self.weight @ self.variances)

    def seen_from(self, base: int) -> Stacks:
        """The covariance of every variable in the frame of the pose `base`.

        Law: where nothing is open, it is the inverse of the information without the base. What hangs loose from the
        base is no better known there than anywhere (see `holds`): its block speaks of the rest alone.
        """
        layout, G = self.values.layout, self.motions.of_the_whole
        own = layout.unknowns(np.array([base]))
        unit = np.zeros((layout.dof, len(own)))
        unit[own, np.arange(len(own))] = 1.0
        across = self.spread(unit)
        carried = G @ np.linalg.pinv(G[own])  # what the base's displacement does to all, were the map rigid
        middle, found = across[own], []
        for at, blocks in self.stacks:
            c, x = carried[at], across[at]
            moved = x @ np.swapaxes(c, 1, 2)
            found.append((at, blocks - moved - np.swapaxes(moved, 1, 2) + c @ middle @ np.swapaxes(c, 1, 2)))
        return found

    def holds(self, base: int) -> BoolArray:
        """The variables (n,) that are tied to the pose `base`: what is open moves them as the base, or not at all."""
        layout, G = self.values.layout, self.motions.of_the_whole
        own = layout.unknowns(np.array([base]))
        off = np.sqrt(self.weight)[:, None] * (self.unknown - G @ np.linalg.pinv(G[own]) @ self.unknown[own])
        largest = np.abs(self.unknown).max(initial=0.0) * max(1.0, self.motions.lever)
        farthest = np.maximum.reduceat(np.abs(off).max(-1, initial=0.0), layout.dof_start[:-1])
        return np.asarray(farthest <= LOOSE * largest)


def knowledge_of(map: Submap) -> Knowledge:
    """What is known of a finished map."""
    values = map.values if map.base == WORLD else map.all_values
    system = System(values.layout, submaps=[SubmapTerm.of(map)], names=map.names)
    return _knowledge(system, values, in_world=map.base == WORLD)


def knowledge_at(at: AtMap) -> Knowledge:
    """What a log says of its map, by the factor that others use as well. Raises SolveError where it does not determine
    the map.

    Law: up to what a join's own approximation does to the information, `knowledge_of` the map.
    """
    gap, values = at.gap, at.values
    free = ~np.isin(values.layout.keys, frame_of(at.joined))
    motions = Motions(values, _lever(gap.hessian, values.select(free)))
    frame = np.zeros((values.layout.dof, 0))
    if len(frame_of(at.joined)):
        frame = _orthonormal(motions.of_the_whole, motions.weight, frame)
    unknowns = values.layout.unknowns(gap.free.keys)
    covariance = InFrame(gap.covariance, unknowns, np.asarray(values.layout.index(gap.free.keys)))
    known = Knowledge(values, at.joined.names, motions, frame, np.zeros((len(motions.weight), 0)), covariance)
    told = np.zeros(values.layout.dof)
    told[unknowns] = gap.hessian.diagonal()
    if known.stretch(told) * ROUNDING < 1.0:
        return known
    return knowledge_from(at.tables, values, at.joined.names)


def knowledge_from(tables: Sequence[Table], values: Values, names: Names) -> Knowledge:
    """What measurements would tell of variables that are at `values`; all of them are named by some table."""
    system = System(values.layout, tables=tables, names=names)
    in_world = any(table.row.unary and len(table) for table in tables)
    return _knowledge(system, values, in_world=in_world)


def _knowledge(system: System, values: Values, *, in_world: bool) -> Knowledge:
    H = system.linearise(values).information
    motions = Motions(values, _lever(H, values))
    frame = np.zeros((values.layout.dof, 0))
    if not in_world:
        frame = _orthonormal(motions.of_the_whole, motions.weight, frame)
    factor = system.factor(values)
    nothing = np.zeros((values.layout.dof, 0))
    with suppress(SolveError):  # where something is open, beside the frame
        _hold(factor, H, frame)
        known = Knowledge(values, system.names, motions, frame, nothing, factor)
        if known.stretch(H.diagonal()) * ROUNDING < 1.0:
            return known
    unknown = _null_space(H, factor, motions.weight, frame)
    _hold(factor, H, np.concatenate([frame, unknown], 1))
    return Knowledge(values, system.names, motions, frame, unknown, factor)


def _hold(factor: Factor, H: Matrix, open_: Array) -> None:
    """Factorise H held where `open_` (dof, k) moves."""
    damping = np.zeros(len(open_))
    pins = _pins(open_)
    damping[pins] = np.maximum(H.diagonal()[pins], 1e-12 * H.diagonal().max(initial=1.0))
    factor.factorise(H.numbers, damping)


def listed(layout: Layout, stacks: Stacks) -> list[Array]:
    """Blocks in the order of a layout."""
    out: list[Array] = [np.empty(0)] * len(layout)
    for at, blocks in stacks:
        for place, block in zip(np.searchsorted(layout.dof_start, at[:, 0]).tolist(), blocks, strict=True):
            out[place] = block
    return out


def worst_variances(layout: Layout, stacks: Stacks) -> tuple[Array, Array]:
    """The largest variance of each variable's place [m^2] and of its turn [rad^2] (n,), in any direction; nan where it
    has none."""
    turning, places, headings = turns(layout), np.full(len(layout), np.nan), np.full(len(layout), np.nan)
    for at, blocks in stacks:
        which = np.searchsorted(layout.dof_start, at[:, 0])
        for kinds in np.unique(turning[at], axis=0):
            alike = (turning[at] == kinds).all(1)
            for out, axes in ((places, np.flatnonzero(~kinds)), (headings, np.flatnonzero(kinds))):
                if len(axes):
                    out[which[alike]] = np.linalg.eigvalsh(blocks[alike][:, axes[:, None], axes])[:, -1]
    return places, headings


def _lever(H: Matrix, values: Values) -> float:
    """The usual distance [m] between variables that were measured together, 1 where there is none."""
    pattern = H.pattern
    column = np.repeat(np.arange(len(values.layout)), np.diff(pattern.column_start))
    pairs = np.flatnonzero(pattern.row != column)
    # A map's base stands beside all of its variables: how far these are says nothing.
    busy = np.bincount(np.concatenate([pattern.row[pairs], column[pairs]]), minlength=len(values.layout))
    local = pairs[np.maximum(busy[pattern.row[pairs]], busy[column[pairs]]) < len(values.layout) - 1]
    places = values.positions(values.layout.keys, 3)
    apart = np.linalg.norm(places[pattern.row] - places[column], axis=-1)[local if len(local) else pairs]
    apart = apart[apart > 0.0]
    return float(np.median(apart)) if len(apart) else 1.0


def _orthonormal(columns: Array, weight: Array, against: Array) -> Array:
    """An M-orthonormal basis of what is in `columns` (dof, k) and not in `against`."""
    root = np.sqrt(weight)[:, None]
    white = root * columns
    known = root * against
    for _ in range(2):
        white = white - known @ (known.T @ white)
    u, singular, _ = np.linalg.svd(white, full_matrices=False)
    return np.asarray(u[:, singular > 1e-9 * singular.max(initial=0.0)] / root)


def _null_space(H: Matrix, factor: Factor, weight: Array, frame: Array) -> Array:
    """What H holds no better than rounding, beside the frame: inverse iteration with H + shift M, whose eigenvectors
    are those of H."""
    dof, diagonal = len(weight), H.diagonal() / weight
    stiffest = float(diagonal.max(initial=0.0))
    csr = H.to_csr()
    factor.factorise(H.numbers, 0.1 * ROUNDING * stiffest * weight)
    rng, block = np.random.default_rng(0), BLOCK
    while True:
        size = min(block, dof - frame.shape[1])
        basis = _orthonormal(rng.standard_normal((dof, size)) / np.sqrt(weight)[:, None], weight, frame)
        for _ in range(4):
            basis = _orthonormal(factor.solve(weight[:, None] * basis), weight, frame)
        small, turn = np.linalg.eigh(basis.T @ (csr @ basis))
        null = small <= ROUNDING * stiffest
        if not null.all() or size < block:
            return np.asarray((basis @ turn)[:, null])
        block *= 2


def _pins(open_: Array) -> Array:
    """As many unknowns as `open_` (dof, k) has columns, whose displacement tells each combination of them."""
    from scipy.linalg import qr

    if not open_.shape[1]:
        return np.zeros(0, np.int64)
    _, order = qr(open_.T, mode="r", pivoting=True)
    return np.asarray(order[: open_.shape[1]])
