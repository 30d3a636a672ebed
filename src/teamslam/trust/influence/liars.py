"""Members of a team whose maps contradict the others': who they are, how sure that is, and when nobody can say.

    spare    rows that a loss expects to be wrong, and which are: they are no contradiction of anybody's (`scattered`)
    bound    what anybody could explain at most, by what all cost together; nearly every honest team ends here
    screen   what the map without each would cost at least, by one step from the map of all; the others end here
    try      the map without each that is left, without each two, ... as long as that explains more (`evidence`)
    accuse   the likeliest set, if the others agree, and no other set explains about as much
    tell     apart from that, whose own measurements contradict each other (`alone`)

What agrees is taken for right: a majority that lies in one and the same way cannot be known from one that is right, and
where no majority agrees nobody is accused.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import log

import numpy as np

from teamslam.errors import SolveError, TeamslamError
from teamslam.joining import Joined, join
from teamslam.model import Sources, Submap, chi2_quantile, robot_of
from teamslam.solver import Options
from teamslam.trust.evidence import SURE, Fit, most_to_gain, significance, unlikely
from teamslam.trust.influence.alone import alone, self_contradicting
from teamslam.trust.influence.downdate import left_out
from teamslam.trust.influence.parts import Problem, Rest, freed
from teamslam.trust.influence.scattered import without_scattered
from teamslam.trust.influence.together import together

LEVEL = 1e-3  # the share of honest teams in which anybody is accused, at most
CONTRADICT = 2.0  # times its dof that a join costs which is said not to agree
LIAR = 2.0 * log(100.0)  # of -2 log L: one robot of a hundred lies
FEW = 8  # members that are all tried; of more, those that a downdate shows
QUICK = Options(max_iterations=60, decrement=0.3, elsewhere=False)  # costs to a tenth are enough
KEPT = 3  # sets that are tried further
HIDING = 1  # members more in a set than explains most, that are tried


@dataclass(frozen=True, eq=False)
class Judgement:
    """Who lies, of the `members` (robots, or submaps by id): the `accused`, with the probability `significance` that an
    honest team looks like this, and the map of the `rest`; the `alternatives` that explain about as much, in which case
    nobody is accused; whether the members `contradict` each other, so that what is left unexplained is no chance.
    `themselves`: those whose own measurements contradict each other (see `alone`), with the probability of that.
    `settled`: whether they do so by the noise as it is stated alone, and no more once it is put right."""

    members: tuple[Hashable, ...]
    accused: tuple[Hashable, ...]
    significance: float
    rest: Joined | None
    alternatives: tuple[tuple[Hashable, ...], ...]
    contradict: bool
    themselves: dict[Hashable, float]
    whole: Fit
    left: Fit
    settled: bool = False

    @property
    def undecidable(self) -> bool:
        """Whether somebody must be wrong, and nobody can say who."""
        return self.contradict and not self.accused and not self.settled


def liars(submaps: Sequence[Submap], joined: Joined, *, level: float = LEVEL) -> Judgement:
    """Which robots of a team contradict the others: `joined` is the map of all of the submaps.

    Law: in a team whose noise is as stated, or larger by one factor for all, anybody is accused at most at the rate
    `level`. Components of a map that came apart are judged together: they do not speak of each other.
    """
    return _Search(submaps, joined, level, robot).judgement()


def anybody_could_lie(submaps: Sequence[Submap], joined: Joined, *, level: float = LEVEL) -> bool:
    """Whether what joining cost leaves room for a robot that contradicts the others. Law: where not, `liars` accuses
    nobody."""
    return _Search(submaps, joined, level, robot).room


def lying_submaps(submaps: Sequence[Submap], joined: Joined, *, level: float = LEVEL) -> Judgement:
    """The same of submaps, by their ids."""
    return _Search(submaps, joined, level, lambda submap: submap.id).judgement()


def influences(submaps: Sequence[Submap], joined: Submap, label: Callable[[Submap], Hashable]) -> dict[Hashable, Fit]:
    """What the cost and its dof fall by without each member (those of one label), from one factorisation."""
    problem = Problem.of(submaps, joined)
    parts = problem.parts(label)
    found = {name: left_out(part, problem.factor) for name, part in parts.items()}
    return {name: Fit(gone.decrease, gone.dof) for name, gone in found.items()}


def robot(submap: Submap) -> int:
    """Whose a submap is: the robot of its base."""
    return int(robot_of(submap.base))


class _Search:
    """The members of one team, and what is known of maps without some of them."""

    def __init__(
        self, submaps: Sequence[Submap], joined: Joined, level: float, label: Callable[[Submap], Hashable]
    ) -> None:
        # What-ifs need no account of what went in, which takes longer than they do.
        self.submaps = [replace(submap, sources=Sources()) for submap in submaps]
        self.given, self.level, self.label = submaps, level, label
        self.joined = together(submaps, joined)
        spared = without_scattered(self.submaps, self.joined)
        if spared is not None:
            with suppress(SolveError):  # without them there may be no map: then they count
                found = together(spared, join(spared, near=self.joined, options=QUICK), QUICK)
                self.submaps, self.joined = spared, found
        self.members = tuple(dict.fromkeys(label(submap) for submap in submaps))
        self.whole = fit_of(self.joined)
        self.fits: dict[frozenset[Hashable], Fit] = {frozenset(): self.whole}

    def judgement(self) -> Judgement:
        """Who lies."""
        self._look()
        ranked = sorted(self.fits, key=lambda accused: (self._unlikely(accused), len(accused)))
        best = ranked[0]
        rival = [a for a in ranked if not best <= a and self._unlikely(a) < self._unlikely(best) + SURE]
        chance = self._significance(best) if best else 1.0
        named = bool(best) and not rival and chance < self.level
        left = self.fits[best] if named else self.whole
        return Judgement(
            members=self.members,
            accused=self._in_order(best) if named else (),
            significance=chance if named else 1.0,
            rest=self._rest(best) if named else None,
            alternatives=tuple(map(self._in_order, [best, *rival])) if rival and best else (),
            contradict=contradict(left, self.level),
            themselves=self_contradicting(alone(self.submaps, self.label), self.level),
            whole=self.whole,
            left=left,
        )

    def _look(self) -> None:
        """Maps without some of the members, as long as more of them explain more; where all contradict each other, two
        that lie may hide each other, and one step more is tried."""
        if not self.room:
            return
        patience = HIDING if contradict(self.whole, self.level) else 0
        found = [frozenset[Hashable]()]
        while found and patience >= 0 and len(found[0]) + 1 < len(self.members):
            before = min(map(self._unlikely, self.fits))
            wider = dict.fromkeys(accused | {one} for accused in found for one in self._likely(accused))
            tried = wider if patience else self._promising(wider)
            found = sorted(filter(self._try, tried), key=self._unlikely)[:KEPT]
            patience -= not found or self._unlikely(found[0]) >= before

    @property
    def room(self) -> bool:
        """Whether anything could be explained, for sure or by members that contradict each other."""
        if most_to_gain(self.whole) <= LIAR:
            return False
        return contradict(self.whole, self.level) or self._most_to_gain() > LIAR + SURE

    def _most_to_gain(self) -> float:
        """What leaving any members out could explain at most. Who leaves more out sets more free, and gains less."""
        if len(self.joined.components) > 1:
            return most_to_gain(self.whole)
        return max(most_to_gain(self.whole, dof) for dof in freed(self.submaps, self.label).values())

    def _likely(self, accused: frozenset[Hashable]) -> Iterable[Hashable]:
        """The members to accuse next: all of a few, of many those that a downdate shows."""
        left = [member for member in self.members if member not in accused]
        return left if len(left) <= FEW else sorted(left, key=lambda member: self._shown[member])[:FEW]

    @cached_property
    def _shown(self) -> dict[Hashable, float]:
        """-2 log L of accusing each member alone, by downdating the map of all."""
        shown = dict.fromkeys(self.members, 0.0)
        for component in self.joined.components:
            inside = [submap for submap in self.submaps if submap.id in component.members]
            for member, gone in influences(inside, component.map, self.label).items():
                shown[member] += unlikely(self.whole, self.whole.minus(gone))
        return shown

    @cached_property
    def _problem(self) -> Problem | None:
        """All submaps as one problem, where they are in one map."""
        return Problem.of(self.submaps, self.joined.map) if len(self.joined.components) == 1 else None

    def _try(self, accused: frozenset[Hashable]) -> bool:
        if accused in self.fits:
            return True
        try:
            self.fits[accused] = self._fit(accused)
        except TeamslamError:
            return False
        return True

    def _promising(self, sets: Iterable[frozenset[Hashable]]) -> list[frozenset[Hashable]]:
        """The sets to accuse that may explain more than the likeliest so far, by one step each; none where nobody is
        accused so far and none of it would be sure."""
        promised = {accused: self._promised(accused) for accused in sets}
        before = min(map(self._unlikely, self.fits))
        if len(self.fits) == 1 and min(promised.values(), default=before) > before - SURE:
            return []
        return [accused for accused in promised if promised[accused] < before]

    def _promised(self, accused: frozenset[Hashable]) -> float:
        """-2 log L of accusing some, at least."""
        rest = self._others(accused)
        try:
            return -np.inf if rest is None else self._weighed(Fit(rest.least(), rest.dof), accused)
        except TeamslamError:
            return -np.inf

    def _others(self, accused: frozenset[Hashable]) -> Rest | None:
        whole = self._problem
        return None if whole is None else whole.rest(lambda submap: self.label(submap) not in accused)

    def _fit(self, accused: frozenset[Hashable]) -> Fit:
        """What the others cost by themselves."""
        rest = self._others(accused)
        if rest is not None:
            return Fit(rest.cost(QUICK), rest.dof)
        others = [submap for submap in self.submaps if self.label(submap) not in accused]
        return fit_of(together(others, join(others, near=self.joined, options=QUICK), QUICK))

    def _rest(self, accused: frozenset[Hashable]) -> Joined:
        gone = {submap.id for submap in self.given if self.label(submap) in accused}
        return join([submap for submap in self.given if submap.id not in gone])

    def _unlikely(self, accused: frozenset[Hashable]) -> float:
        return self._weighed(self.fits[accused], accused)

    def _weighed(self, rest: Fit, accused: frozenset[Hashable]) -> float:
        return unlikely(self.whole, rest) + LIAR * len(accused)

    def _significance(self, accused: frozenset[Hashable]) -> float:
        return significance(self.whole, self.fits[accused], len(accused), len(self.members))

    def _in_order(self, accused: frozenset[Hashable]) -> tuple[Hashable, ...]:
        return tuple(member for member in self.members if member in accused)


def fit_of(joined: Joined) -> Fit:
    """What joining cost, without what the submaps cost by themselves."""
    solved = [component.solution for component in joined.components if component.solution is not None]
    return Fit(sum(solution.cost for solution in solved), sum(solution.dof for solution in solved))


def contradict(fit: Fit, level: float) -> bool:
    """Whether a join costs so much that its members do not agree."""
    return fit.dof > 0 and fit.cost > max(CONTRADICT * fit.dof, float(chi2_quantile(1.0 - level, fit.dof)))
