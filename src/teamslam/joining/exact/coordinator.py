"""The coordinator of exact rounds: it asks, is answered, and decides on the next step (`rounds` has the mathematics).

    course   a generator of what is asked: the same for robots in one process (`Parts`) and over links
    reduce   where you are, what is left without your interiors?
    try      what would it cost you with the separators there?
    take     go there

It never sees a raw measurement but those that travel with the submaps. A robot that does not answer ends nothing here:
who drives the course closes it.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray
from teamslam.joining.exact.gap import frame_of, point_of, raw_cost
from teamslam.joining.exact.robot import Part, Reduced, Sending
from teamslam.joining.join.join import Exactness
from teamslam.model import Submap, Table, Values
from teamslam.solver import Factor, Status, Step, SubmapTerm, System
from teamslam.solver.newton import Bend, Curvature

UNSEEN = 1e-12  # of F: what its rounding hides
FALLS = 0.9  # the decrement that falls less than to this, where F shows nothing any more, is rounding itself
LEAST_SHARE = 1e-4  # of a step
SLOW = 0.25  # as in Bend; a round costs messages, curvature costs none


@dataclass(frozen=True, eq=False)
class _Ahead:
    """What a round found: F here, the step, and the decrease of F that it promises."""

    cost: float
    step: Array
    decrease: float

    @property
    def decrement(self) -> float:
        """The distance to the optimum [sigmas]."""
        return float(np.sqrt(self.decrease))

    def told(self, share: float) -> Step:
        """The account of going that share of the step."""
        largest = float(np.abs(self.step).max(initial=0.0))
        return Step(self.cost, self.decrement, largest, 1.0 - share, share > 0.0, 0.0)


class Side(Protocol):
    """What a coordinator knows of one submap: in whose frame, what is `kept` of it and how much is sent, and where its
    separators are now, as seen from its base."""

    submap: Submap
    sending: Sending

    @property
    def separators(self) -> Values:
        """Where they are."""


@dataclass(frozen=True)
class Reduce:
    """Asks every robot to linearise where it is, and for what is left without its interiors: a `Reduced` a submap."""

    curvature: Curvature


@dataclass(frozen=True, eq=False)
class Try:
    """Asks where the robots would be with the separators at `values`, in the map's frame, by this share of a step, and
    what their measurements would cost there: a number a submap."""

    values: Values
    share: float


@dataclass(frozen=True)
class Take:
    """Tells all robots to go where they last were asked to try. Needs no answer."""


Ask = Reduce | Try | Take
Course = Generator[Ask, Any, "Ended"]


@dataclass(frozen=True)
class Ended:
    """How rounds ended: the `status`, the steps, how far the last one was `ahead`, and how many rounds and numbers it
    took."""

    status: Status
    history: tuple[Step, ...]
    ahead: "_Ahead | None"
    rounds: int
    numbers: int


class Coordinator:
    """The coordinator's side of the rounds: it asks (`course`) and is answered, and never sees a raw measurement but
    those that travel with the submaps. It counts rounds, and every number that goes up or down."""

    def __init__(self, sides: Sequence[Side], raw: Sequence[Table], joined: Submap) -> None:
        self.sides, self.raw, self.map = sides, list(raw), joined
        self.values = point_of(joined).only(common_keys(sides, raw))
        self.system: System | None = None
        self.factor: Factor | None = None
        self.rounds, self.numbers, self._rounding = 0, 0, 0.0

    def course(self, gap: float, max_rounds: int, progress: Callable[[Step], None] | None = None) -> Course:
        """The paper's join, which is where the map is, and rounds until the gap is closed, or until rounding is all
        that is left of it. A SolveError in place of an answer is taken as one of its own."""
        yield from self._reduced("none")
        yield from self._tried(self.values, 1.0)
        yield Take()
        history: list[Step] = []
        bend, status, last = Bend(SLOW), Status.MAX_ITERATIONS, np.inf
        ahead: _Ahead | None = None
        for _ in range(max_rounds):
            ahead = yield from self._round(bend)
            if ahead.decrement > FALLS * last and ahead.decrease <= self._unseen(ahead.cost):
                status = Status.FLAT
                break
            bend.see(ahead.decrement)
            last = ahead.decrement
            share = yield from self._descend(ahead)
            history.append(ahead.told(share))
            if progress is not None:
                progress(history[-1])
            if not share and bend.retreat():
                last = np.inf
                continue  # curvature that leads nowhere here: the next round goes without
            if not share:
                status = Status.FLAT if ahead.decrease <= self._unseen(ahead.cost) else Status.STUCK
                break
            if ahead.decrease <= gap * ahead.cost:
                status = Status.CONVERGED  # and the last step, already known, is taken
                break
        return Ended(status, tuple(history), ahead, self.rounds, self.numbers)

    def _unseen(self, cost: float) -> float:
        """The decrease of F that its rounding hides: a share of F, or where F is next to nothing that of residuals."""
        assert self.system is not None
        residual = max(self._rounding, self.system.rounding(self.values))  # the world's origin may be far away
        return max(UNSEEN * max(cost, 1.0), 10.0 * residual * float(np.sqrt(cost + 1.0)))

    def _descend(self, ahead: "_Ahead") -> Generator[Ask, Any, float]:
        """Go the largest share of the step (1, 1/2, 1/4, ...) that does not raise F, and say which; 0 for none."""
        share = 1.0
        while share > LEAST_SHARE:
            candidate = self._retract(share * ahead.step)
            costs = yield from self._tried(candidate, share)
            self.numbers += len(self.sides)
            after = raw_cost(self.raw, candidate) + sum(costs)
            if np.isfinite(after) and after <= ahead.cost + self._unseen(ahead.cost):
                self.values = candidate
                yield Take()
                return share
            share *= 0.5
        return 0.0

    # --- messages -----------------------------------------------------------------------------------------------

    def _reduced(self, curvature: Curvature) -> Generator[Ask, Any, list[Reduced]]:
        """A round: every robot linearises where it is, and sends what is left without its interiors."""
        self.rounds += 1
        sent: list[Reduced] = yield Reduce(curvature)
        self.numbers += sum(reduced.numbers for reduced in sent)
        self._rounding = max(reduced.rounding for reduced in sent)
        return sent

    def _tried(self, values: Values, share: float) -> Generator[Ask, Any, list[float]]:
        """What it would cost with the separators there, by this share of the step, which the robots are told."""
        self.numbers += sum(side.sending.placing for side in self.sides)
        costs: list[float] = yield Try(values, share)
        return costs

    # --- one round ----------------------------------------------------------------------------------------------

    def _round(self, bend: Bend) -> Generator[Ask, Any, "_Ahead"]:
        """One round: with curvature where there is enough of it for a step that goes down."""
        while True:
            try:
                return (yield from self._linearised(bend.curvature))
            except SolveError:
                if not bend.retreat():
                    raise

    def _linearised(self, curvature: Curvature) -> Generator[Ask, Any, "_Ahead"]:
        reduced = yield from self._reduced(curvature)
        terms = [
            SubmapTerm(p.submap.base, p.separators, r.information, r.slope)
            for p, r in zip(self.sides, reduced, strict=True)
            if len(p.sending.kept)  # some share but a frame
        ]
        if self.system is None:
            self.system = System(
                self.values.layout, tables=self.raw, submaps=terms, fixed=frame_of(self.map), names=self.map.names
            )
            self.factor = self.system.factor(self.values)
        else:
            for number, term in enumerate(terms):
                self.system.set_submap(number, term)
        assert self.factor is not None
        at = self.system.linearise(self.values, curvature=curvature)
        self.factor.factorise(at.hessian.numbers)
        step = self.factor.solve(at.gradient)
        return _Ahead(
            cost=sum(r.cost for r in reduced) + raw_cost(self.raw, self.values),
            step=step,
            decrease=max(float(at.gradient @ step) + sum(r.interior for r in reduced), 0.0),
        )

    def exactness(self, ended: Ended) -> Exactness:
        """How exact the separators' places are where rounds `ended`, as far as the coordinator can know."""
        assert ended.ahead is not None and self.factor is not None and self.system is not None
        start = point_of(self.map).only(self.system.free.keys)
        moved = self.values.only(self.system.free.keys).minus(start)
        return Exactness(
            relative_cost_gap=ended.ahead.decrease / ended.ahead.cost if ended.ahead.cost > 0.0 else 0.0,
            gradient_norm=ended.ahead.decrement,
            max_shift_sigma=float(self.factor.in_sigmas(ended.ahead.step).max(initial=0.0)),
            join_shift_sigma=float(self.factor.in_sigmas(moved).max(initial=0.0)),
            rounds=ended.rounds,
            bytes=8 * ended.numbers,
        )

    def _retract(self, step: Array) -> Values:
        assert self.system is not None
        return self.system.retract(self.values, step)


class Far:
    """A coordinator's view of the submap of another robot, which answers over a link: it knows where the separators
    are, for it has put them there."""

    def __init__(self, submap: Submap, sending: Sending) -> None:
        self.submap, self.sending = submap, sending
        self.separators = submap.all_values.only(sending.kept.keys)

    def put(self, values: Values) -> None:
        """The separators are where a map has them."""
        self.separators = values.seen_from(values.pose(self.submap.base), self.sending.kept)


class Parts:
    """All robots' sides in one place: their parts, and where they were last asked to try."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = parts
        self._moved: list[Values] = []

    def answer(self, ask: Ask) -> Any:
        """What they answer."""
        match ask:
            case Reduce(curvature):
                return [part.reduce(curvature) for part in self.parts]
            case Try(values, share):
                self._moved = [part.moved(values, share) for part in self.parts]
                return [part.cost(there) for part, there in zip(self.parts, self._moved, strict=True)]
            case Take():
                for part, values in zip(self.parts, self._moved, strict=True):
                    part.values = values
        return None


def common_keys(sides: Sequence[Side], raw: Sequence[Table]) -> IntArray:
    """What coordinator and robots speak of: separators, the submaps' bases, and what raw measurements name."""
    bases = np.array([side.submap.base for side in sides])
    return np.unique(
        np.concatenate([*(side.sending.kept.keys for side in sides), bases, *(t.keys.ravel() for t in raw)])
    )
