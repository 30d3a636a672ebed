"""Which of the bodies that no pair of them holds are a truss, and in which assemblies: rigid by all rows between them.

Sets of few bodies come first. A set of which some assembly is rigid by the rows as they look at it (see `frameworks`)
is a truss; where none is, the join is asked (a `Judge`), which knows what rigid bodies are too rough for. Rows as few
as fit many assemblies of two bodies may leave one of three: so of sets to be asked about those come first that fit in
one way, then the largest. What is found of bodies that stay as they are whatever else is put together, is found once.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.place.frameworks import Assembly, Truss, in_their_dimension
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.reasons import Held
from teamslam.joining.place.ties import Tied

TRUSS = 4  # clusters in a truss at most; and one of all that hang rigidly together, if these are not more than
WHOLE = 8
TRIES = 500  # sets of clusters looked at for a truss; only where very many hang loosely together are there more
SOLVED = 4  # of them that are solved in all, for each chain: the search takes time in proportion to the log
MANY = 50  # chains; for each beyond these one
ALL_OF_THEM = 10**9  # rows: to know what is open no row is left out
MOST_AT_ONCE = 100  # clusters whose freedoms are asked of all rows together; of more two by two
JUDGED = 3  # assemblies of a truss that the join is asked about

T = TypeVar("T")
Chains = Sequence[tuple[list[int], list[Pose]]]
Found = tuple[tuple[int, ...], list[list[Pose]]]  # places of bodies that are a truss, their frames in each assembly
Which = tuple[tuple[int, ...], ...]  # bodies by their chains
Lie = tuple[tuple[int, bytes, bytes], ...]  # a body by its chains, and where these lie in it

Judge = Callable[[Sequence[int], Sequence[int], Sequence[Pose]], Sequence[Held]]
"""`judge(members, bodies, frames)`: how firmly the rows themselves hold submaps, each of some body, at their optimum
near these frames: of each body but the first."""


@dataclass
class Body:
    """Strands in one frame, while clusters grow: where each lies, and what they know together."""

    placed: dict[int, Pose]
    outline: Outline

    @cached_property
    def lie(self) -> "Lie":
        """What it is made of, and where these lie in it, to the bit."""
        return tuple((s, at.rotation.tobytes(), at.translation.tobytes()) for s, at in self.placed.items())


class Trusses:
    """The search for trusses among bodies that are made of `chains`, each some submaps and their frames in it."""

    def __init__(self, chains: Chains, judge: Judge | None) -> None:
        self.chains, self.judge = chains, judge
        self._judged: dict[tuple[int, ...], Held] = {}  # by the chains of a body
        self._loose: set[Which] = set()  # bodies that are no truss now
        self._all = self._left = may_be_solved(len(chains))  # trusses that may still be solved
        self._may_be: dict[tuple[Lie, ...], bool] = {}  # of bodies as they lie, whether rows are enough
        self._known: dict[tuple[Lie, ...], list[Assembly]] = {}  # what a truss of them is, and which the judge holds
        self._held: dict[tuple[Lie, ...], tuple[list[int], list[list[Pose]]]] = {}

    @property
    def searched(self) -> int:
        """How many trusses were solved."""
        return self._all - self._left

    def begin(self) -> None:
        """All bodies are what they were: none is known to be no truss."""
        self._loose.clear()

    def told(self, body: Body) -> Held | None:
        """How the join said that a body is held, where it was asked."""
        return self._judged.get(tuple(body.placed))

    def among(self, bodies: Sequence[Body], tied: Tied, flat: Sequence[bool]) -> Found | None:
        """The smallest set of bodies that are rigid together, and their frames in every assembly that fits; where none
        is, one that the join says is held. Few rows fit many assemblies of two bodies, of which three leave one: so a
        set that fits in one way is asked about first, then the largest."""
        unsure: list[tuple[tuple[int, ...], list[Assembly]]] = []
        least = self._left // 2  # the others are for what comes once some of these bodies are one
        for places in itertools.islice(_candidates(tied), TRIES):
            truss, inside = Truss(tied.among(places)), [bodies[n] for n in places]
            if self._left <= least and tuple(body.lie for body in inside) not in self._known:
                break
            if _which(inside) in self._loose or not self._once(inside, self._may_be, truss.may_be_rigid):
                continue
            found = self._assemblies(truss, inside)
            rigid = [n for n, a in enumerate(found) if a.fits and not a.nullity]
            if rigid:  # what fits better counts as well, though a direction seems loose there: the join decides by cost
                ways = [a for n, a in enumerate(found) if n in rigid or (a.fits and n < rigid[0])]
                return places, [in_their_dimension(a.frames, [flat[n] for n in places]) for a in ways]
            unsure.append((places, found))
        for places, found in sorted(unsure, key=lambda of: (sum(a.fits for a in of[1]) != 1, -len(of[0]))):
            inside = [bodies[n] for n in places]
            held, frames = self._once(
                inside, self._held, partial(self._by_judge, inside, found, [flat[n] for n in places])
            )
            if held:
                return tuple(places[n] for n in held), frames
            self._loose.add(_which(inside))
        return None

    def _assemblies(self, truss: Truss, bodies: Sequence[Body]) -> list[Assembly]:
        """What a truss of these bodies is."""
        return self._once(bodies, self._known, partial(self._solved, truss))

    def _solved(self, truss: Truss) -> list[Assembly]:
        self._left -= 1
        return truss.assemblies()

    def _once(self, bodies: Sequence[Body], known: dict[tuple[Lie, ...], T], find: Callable[[], T]) -> T:
        """What is found of bodies, once of the same as they lie: most stay so whatever else is put together."""
        lie = tuple(body.lie for body in bodies)
        if lie not in known:
            known[lie] = find()
        return known[lie]

    def _by_judge(
        self, bodies: Sequence[Body], found: Sequence[Assembly], flat: Sequence[bool]
    ) -> tuple[list[int], list[list[Pose]]]:
        """The bodies that the rows themselves hold, where they fit, and their frames: all of them, in every assembly
        that fits and of which nobody knows that it does not hold them; or where one hangs loosely the others."""
        if self.judge is None:
            return [], []
        frames = [in_their_dimension(a.frames, flat) for a in found]
        judged = [(frame, self._asked(bodies, frame)) for frame in frames[:JUDGED]]
        firm = [frame for frame, holds in judged if all(h.fits and h.firm for h in holds)]
        if firm:
            rest = zip(found[JUDGED:], frames[JUDGED:], strict=True)
            return list(range(len(bodies))), [*firm, *(frame for a, frame in rest if a.fits)]
        for frame, holds in judged:
            held = [0, *(n for n, h in enumerate(holds, 1) if h.fits and h.firm)]
            fewer, at = [bodies[n] for n in held], [frame[n] for n in held]
            if len(held) > 1 and all(h.fits and h.firm for h in self._asked(fewer, at)):
                return held, [at]
        return [], []

    def _asked(self, bodies: Sequence[Body], frames: Sequence[Pose]) -> Sequence[Held]:
        """What the judge says of bodies near some frames, which is remembered."""
        assert self.judge is not None
        which: list[int] = []
        of: list[int] = []
        stand: list[Pose] = []
        for n, (frame, body) in enumerate(zip(frames, bodies, strict=True)):
            members = [m for s in body.placed for m in self.chains[s][0]]
            which, of = which + members, of + [n] * len(members)
            stand += [frame @ pose for pose in frames_in(self.chains, list(body.placed), body.placed)]
        holds = self.judge(which, of, stand)
        for body, held in zip(bodies, [min(holds, key=_merit), *holds], strict=True):
            known = self._judged.get(tuple(body.placed), held)
            self._judged[tuple(body.placed)] = min(held, known, key=_merit)
        return holds


def may_be_solved(chains: int) -> int:
    """How many trusses may be solved, at most, to place so many chains."""
    return SOLVED * min(chains, MANY) + max(chains - MANY, 0)


def frames_in(chains: Chains, ordered: Sequence[int], placed: dict[int, Pose]) -> list[Pose]:
    """The frames of all submaps of some chains that are placed, chain by chain."""
    return [placed[s] @ frame for s in ordered for frame in chains[s][1]]


def freedoms(tied: Tied) -> IntArray:
    """How many directions are open between each two bodies (n, n) wherever they may be, by all rows; of very many
    bodies two by two."""
    n = tied.given
    if n <= MOST_AT_ONCE:
        return Truss(tied.among(range(n), ALL_OF_THEM)).freedoms()
    rows, out = tied.meetings(), np.full((n, n), 6)
    for a, b in np.argwhere(np.triu(rows[:n, :n] + rows[:n, n:] @ rows[n:, :n], 1)).tolist():
        out[a, b] = out[b, a] = Truss(tied.among([a, b], ALL_OF_THEM)).freedoms()[0, 1]
    return out


def _merit(held: Held) -> tuple[bool, float]:
    return not held.fits, held.looseness


def _which(bodies: Sequence[Body]) -> Which:
    return tuple(tuple(body.placed) for body in bodies)


def _candidates(tied: Tied) -> Iterator[tuple[int, ...]]:
    """Sets of bodies that may be rigid together, small sets first: pairs, those with most rows before others; three and
    more of which each is tied to two others, or to one by several rows; all that hang rigidly together.

    What all rows together leave open, those between some bodies do: no set reaches beyond bodies that cannot move
    against each other when all are there.
    """
    n = tied.given
    rows = tied.meetings()
    # The world and landmarks that are bodies tie those that they meet.
    by_others = rows[:n, n:] @ rows[n:, :n]
    ties = rows[:n, :n] + np.where(by_others > 0, 1.0, 0.0)
    np.fill_diagonal(ties, 0.0)
    rigid = freedoms(tied) == 0 if n <= MOST_AT_ONCE else np.ones((n, n), bool)
    pairs = sorted(itertools.combinations(range(n), 2), key=lambda pair: -ties[pair])
    yield from (pair for pair in pairs if ties[pair] and rigid[pair])
    around = np.flatnonzero((np.minimum(ties, 2).sum(1) >= 2) & (rigid.sum(1) > 2))
    for size in range(3, TRUSS + 1):
        for places in itertools.combinations(around.tolist(), size):
            if rigid[places[0], places].all() and (np.minimum(ties[np.ix_(places, places)], 2).sum(1) >= 2).all():
                yield places
    for whole in sorted({tuple(np.flatnonzero(of).tolist()) for of in rigid} if n <= MOST_AT_ONCE else ()):
        if TRUSS < len(whole) <= WHOLE:
            yield whole
