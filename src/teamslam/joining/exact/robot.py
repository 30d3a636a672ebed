"""A robot's side of a join that is exact: its raw measurements and its interiors it keeps to itself.

At its point S_i it linearises, H = J'WJ, g = J'We, f, and eliminates its interiors b. What it sends speaks of its
separators s alone, the variables that somebody else knows too:

    Lambda = H_ss - H_sb H_bb^-1 H_bs,    eta = g_s - H_sb H_bb^-1 g_b,    f,    |g_b|^2 in H_bb^-1

When the separators have moved by a share of the step, the interiors go the same share of theirs:
d_b = H_bb^-1 (share g_b - H_bs d_s), so that a small enough share of a step goes down. A robot whose separators are so
many that Lambda, which is dense, is larger than its own sparse H sends that instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining.build.problem import gaussian_part
from teamslam.joining.condense import condense
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import Dataset, Layout, Submap, Table, Values
from teamslam.model.sparse import sp
from teamslam.solver import Factor, SubmapTerm, System
from teamslam.solver.linear import block_matrix
from teamslam.solver.newton import Curvature


@dataclass(frozen=True, eq=False)
class Reduced:
    """What a robot sends: information and slope over its separators, its cost, its interiors' decrement^2.

    `numbers`: how many that are. The places of the separators are not among them; the coordinator put them there.
    `rounding`: how large the rounding of its residuals is [sigmas].
    """

    information: sp.csr_array
    slope: Array
    cost: float
    interior: float
    numbers: int
    rounding: float = 0.0


@dataclass(frozen=True, eq=False)
class Sending:
    """What a robot sends of a submap in a round: of which variables (`keep` (n,), their layout `kept`), whether its
    `whole` matrix, because that is smaller, and how many `numbers` that are."""

    keep: BoolArray
    kept: Layout
    whole: bool
    numbers: int

    @classmethod
    def of(cls, submap: Submap, separators: IntArray) -> "Sending":
        """What is sent where others know these separators."""
        layout, stored = submap.values.layout, _numbers_of_blocks(submap)
        keep = np.isin(layout.keys, separators)
        dense = int(layout.dofs[keep].sum())
        if dense == 0 or dense * dense >= stored:
            return cls(np.ones(len(layout), bool), layout, True, (stored + layout.dof) // 2 + layout.dof + 1)
        return cls(keep, layout.select(keep), False, dense * (dense + 1) // 2 + dense + 2)

    @property
    def placing(self) -> int:
        """How many numbers say where its separators are, and by what share of a step."""
        return int(self.kept.state_start[-1]) + 1


def _numbers_of_blocks(submap: Submap) -> int:
    """How many numbers the blocks of a submap's information hold, whether zeros in them are stored (as a solve leaves
    them) or not (as a file does)."""
    layout = submap.values.layout
    pattern, _ = block_matrix(layout, submap.information)
    return 2 * pattern.size - int((layout.dofs.astype(np.int64) ** 2).sum())


class Part:
    """One submap at a point `values` in its own frame, with the rows that tell of it there (`system`), or what was sent
    of it in place of rows; `floor`: what it costs besides."""

    def __init__(
        self, submap: Submap, sending: Sending, system: System, values: Values, kept: Layout, floor: float = 0.0
    ) -> None:
        self.submap, self.sending, self.system, self.values, self._floor = submap, sending, system, values, floor
        free = system.free
        self.kept, self.sends_whole = kept, len(kept) == len(free)
        self._columns = free.unknowns(kept.keys)
        self._gradient = np.zeros(free.dof)

    @cached_property
    def _factor(self) -> Factor:
        """By which interiors are eliminated; what is sent whole needs none."""
        last = np.flatnonzero(np.isin(self.system.free.keys, self.kept.keys))
        return Factor(self.system.free, self.system.pattern, last=last, names=self.submap.names)

    @classmethod
    def of(cls, piece: Dataset, submap: Submap, sending: Sending) -> "Part":
        """A submap with the piece of log it was built of."""
        robot = piece.tables[0].robot
        values = submap.all_values
        inside, _ = gaussian_part(piece.tables, robot, submap.trajectory_keys(robot), values.layout)
        system = System(values.layout, tables=inside, fixed=np.array([submap.base]), names=piece.names)
        return cls(submap, sending, system, values, sending.kept)

    @classmethod
    def as_sent(cls, submap: Submap, sending: Sending) -> "Part":
        """A submap whose rows nobody can be asked for: it stays the Gaussian that it is."""
        rest = submap if sending.whole else condense(submap, sending.kept.keys)[0]
        values = rest.all_values
        system = System(values.layout, submaps=[SubmapTerm.of(rest)], fixed=np.array([submap.base]), names=submap.names)
        return cls(submap, sending, system, values, sending.kept, submap.cost)

    def cost(self, values: Values) -> float:
        """What it costs at another point."""
        return self.system.cost(values) + self._floor

    @property
    def separators(self) -> Values:
        """The estimate of what is sent, in the submap's frame."""
        return self.values.only(self.kept.keys)

    def reduce(self, curvature: Curvature = "none") -> Reduced:
        """Linearise at the present point and eliminate the interiors; `curvature` as in System.linearise."""
        at = self.system.linearise(self.values, curvature=curvature)
        self._gradient = at.gradient
        rounding, n = self.system.rounding(self.values), self.kept.dof
        if self.sends_whole:
            whole = at.hessian.to_csr()
            return Reduced(whole, at.gradient, at.cost + self._floor, 0.0, self.sending.numbers, rounding)
        complement, slope = self._factor.eliminate(at.hessian.numbers, at.gradient)
        at_rest = self._factor.back_substitute(np.zeros(n), at.gradient)
        interior = float(at.gradient @ at_rest)
        return Reduced(dense(complement), slope, at.cost + self._floor, interior, self.sending.numbers, rounding)

    def moved(self, values: Values, share: float) -> Values:
        """The robot's estimate with its separators where a map has them, by this share of a step."""
        return self.follow(values.seen_from(values.pose(self.submap.base), self.kept), share)

    def follow(self, separators: Values, share: float) -> Values:
        """The robot's estimate after its separators moved there, by this share of a step; all of a step takes the
        interiors where the quadratic has its least."""
        shift = separators.minus(self.separators)
        if self.sends_whole:
            delta = np.zeros(self.system.free.dof)
            delta[self._columns] = shift
        else:
            delta = self._factor.back_substitute(shift, share * self._gradient)
        return self.system.retract(self.values, delta)


def parts_of(
    members: Sequence[tuple[Dataset, Submap]], layout: Layout, *, world: bool
) -> tuple[list[Part], list[Table]]:
    """The parts of pieces and the submaps built of them, and what of their raw measurements speaks of the layout, and
    of the `world`, if the map is written in its frame."""
    submaps = [submap for _, submap in members]
    raw, _ = usable_rows([t for s in submaps for t in s.raw], layout, world=world)
    separators = separators_of(submaps, raw)
    return [Part.of(piece, submap, Sending.of(submap, separators)) for piece, submap in members], raw


def separators_of(submaps: Sequence[Submap], raw: Sequence[Table]) -> IntArray:
    """The keys that more than one submap knows (bases among them), or that raw measurements name, and first poses."""
    everywhere = np.concatenate([s.keys for s in submaps])
    keys, times = np.unique(everywhere, return_counts=True)
    first = [submap.first_pose for submap in submaps]
    return np.unique(np.concatenate([keys[times > 1], first, *(t.keys.ravel() for t in raw)]))


def dense(complement: Array) -> sp.csr_array:
    """A dense block as a sparse matrix that keeps its zeros: its structure must not change between rounds."""
    n = len(complement)
    symmetric = 0.5 * (complement + complement.T)
    return sp.csr_array((symmetric.ravel(), np.tile(np.arange(n), n), np.arange(0, n * n + 1, n)), shape=(n, n))
