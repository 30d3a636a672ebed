"""Where each submap's frame lies, in closed form: the start of a join, from nothing.

    chains:  consecutive submaps of a robot share their boundary pose, so their frames compose
    clusters: grow from the first chain; in each round the one that is held most firmly by what it shares with the
              cluster (poses, landmarks, raw sightings of each other's robots) is attached by one robust rigid fit
    trusses:  clusters that no pair holds by what it shares, but that are rigid together by all rows between them, are
              assembled, in every way that fits
    second look: every chain is fitted once more, to all the others of its cluster

Fits look at clusters as rigid, at what they share as points; where that is too rough to tell whether a frame is held,
the join itself is asked (a `Judge`). What nothing holds starts a cluster of its own: separate components, with the
reason in words. One shared pose holds a frame; points must be two at different places in the plane, three not in line
in space, else a hinge is left.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.place.chains import chains_of
from teamslam.joining.place.frameworks import Assembly, Truss, in_their_dimension
from teamslam.joining.place.outline import Outline, known_keys, outline_of_chain
from teamslam.joining.place.reasons import Held, why_apart
from teamslam.joining.place.robust_fit import Link, link
from teamslam.joining.place.ties import MOST, Tied
from teamslam.model import WORLD, Submap, Table
from teamslam.solver import side_by_side

BRANCHES = 8  # assemblies looked at: a truss in the plane has two, two trusses four
TRUSS = 4  # clusters in a truss at most; and one of all that hang rigidly together, if these are not more than
WHOLE = 8
TRIES = 500  # sets of clusters looked at for a truss; only where very many hang loosely together are there more
SOLVED = 4  # of them that are solved in all, for each chain: the search takes time in proportion to the log
ALL_OF_THEM = 10**9  # rows: to know what is open no row is left out
MOST_AT_ONCE = 100  # clusters whose freedoms are asked of all rows together; of more two by two
JUDGED = 3  # assemblies of a truss that the join is asked about

Judge = Callable[[Sequence[int], Sequence[int], Sequence[Pose]], Sequence[Held]]
"""`judge(members, bodies, frames)`: how firmly the rows themselves hold submaps, each of some body, at their optimum
near these frames: of each body but the first."""


@dataclass(frozen=True)
class Cluster:
    """Submaps in one frame: `members` (places in the list, the root first) and the pose of each one's base in it;
    `others`: the frames under other assemblies that fit what is shared as well."""

    members: list[int]
    frames: list[Pose]
    others: list[list[Pose]] = field(default_factory=list)


@dataclass(frozen=True)
class Placement:
    """Clusters in the order of their lowest robot; `reasons` says why there is more than one. `searched`: how many
    trusses were solved to find them, which takes nearly all of the time where there is one."""

    clusters: list[Cluster]
    reasons: list[str] = field(default_factory=list)
    searched: int = 0


@dataclass
class _Body:
    """Strands in one frame, while clusters grow: where each lies, and what they know together."""

    placed: dict[int, Pose]
    outline: Outline


def place(submaps: Sequence[Submap], judge: Judge | None = None) -> Placement:
    """The frames of all submaps, by clusters. Law: with noise-free submaps every frame is exact."""
    chains = chains_of(submaps)
    if len(chains) == 1:
        return Placement([Cluster(list(chains[0][0]), chains[0][1])])
    return _Placing(submaps, chains, judge).placement()


class _Placing:
    """The chains of one set of submaps, with what several of them know."""

    def __init__(
        self, submaps: Sequence[Submap], chains: Sequence[tuple[list[int], list[Pose]]], judge: Judge | None
    ) -> None:
        self.submaps, self.chains, self.judge = submaps, chains, judge
        known = [np.unique(np.concatenate([known_keys(submaps[m]) for m in members])) for members, _ in chains]
        keys, times = np.unique(np.concatenate(known), return_counts=True)
        self.shared = keys[times > 1]
        meets = [np.isin(of, self.shared).any() for of in known]
        self.outlines = side_by_side(
            lambda n: self._outline(n, raw=True) if meets[n] else _nothing(), range(len(chains))
        )
        self._holders = (
            np.repeat(np.arange(len(chains)), [len(outline.keys) for outline in self.outlines]),
            np.concatenate([outline.keys for outline in self.outlines]),
        )
        self.planar = [submaps[members[0]].base_dim == 2 for members, _ in chains]
        self._judged: dict[tuple[int, ...], Held] = {}  # by the chains of a body
        self._loose: set[tuple[tuple[int, ...], ...]] = set()  # bodies, by their chains, that are no truss now
        self._left = SOLVED * len(chains)  # trusses that may still be solved

    @cached_property
    def raw(self) -> list[Table]:
        """Raw measurements between chains, or in the world, evenly thinned where they are very many."""
        tables = [t for members, _ in self.chains for m in members for t in self.submaps[m].raw]
        across = [t.select(np.isin(t.keys[:, -1], self.shared) | t.row.unary) for t in tables]
        return [_spread(t, len(self.chains) * MOST) for t in across if len(t)]

    @cached_property
    def bare(self) -> list[Outline]:
        """What the chains know themselves of all that is shared, and of the ends of raw measurements."""
        return side_by_side(lambda chain: self._outline(chain, raw=False), range(len(self.chains)))

    def _outline(self, chain: int, *, raw: bool) -> Outline:
        members, frames = self.chains[chain]
        keys = self.shared if raw else np.concatenate([self.shared, [WORLD], *(t.keys.ravel() for t in self.raw)])
        return outline_of_chain([self.submaps[m] for m in members], frames, np.unique(keys), raw=raw)

    def placement(self) -> Placement:
        """The assembly with the fewest clusters, with all others of it."""
        branches: list[list[_Body]] = []
        waiting: list[tuple[int, ...]] = [()]
        while waiting and len(branches) < BRANCHES:
            choices = waiting.pop(0)
            bodies, ways = self._grown(choices)
            branches.append(sorted(bodies, key=self._lone))
            # Each truss met beyond those chosen so far opens branches.
            for depth in range(len(choices), len(ways)):
                ahead = choices + (0,) * (depth - len(choices))
                waiting += [(*ahead, other) for other in range(1, ways[depth])]
        best = min(branches, key=len)
        clusters = []
        for number, body in enumerate(best):
            others = [of[number].placed for of in branches if of is not best and len(of) == len(best)]
            same = [o for o in others if set(o) == set(body.placed) and o is not body.placed]
            ordered = list(body.placed)
            clusters.append(
                Cluster(
                    [m for s in ordered for m in self.chains[s][0]],
                    self._frames(ordered, body.placed),
                    [self._frames(ordered, o) for o in same if _differ(o, body.placed)],
                )
            )
        return Placement(clusters, self._reasons(best), SOLVED * len(self.chains) - self._left)

    def _frames(self, ordered: Sequence[int], placed: dict[int, Pose]) -> list[Pose]:
        return [placed[s] @ frame for s in ordered for frame in self.chains[s][1]]

    def _lone(self, body: _Body) -> bool:
        """Whether it is one pose from which nothing is known: such come last, as nobody's frame."""
        members = [m for s in body.placed for m in self.chains[s][0]]
        return len(members) == 1 and not self.submaps[members[0]].dof

    # --- growth -----------------------------------------------------------------------------------------------

    def _grown(self, choices: Sequence[int]) -> tuple[list[_Body], list[int]]:
        """The clusters, taking of the truss met as n-th the assembly number choices[n] (0 beyond); and how many
        assemblies each truss had."""
        # Planar robots share the ground, which must be the frame where robots of both kinds meet.
        order = sorted(
            range(len(self.chains)), key=lambda s: (not self.planar[s], self.submaps[self.chains[s][0][0]].base)
        )
        bodies = [_Body({s: Pose.identity(2 if self.planar[s] else 3)}, self.outlines[s]) for s in order]
        ways: list[int] = []
        self._loose.clear()
        while True:
            bodies = self._merged(bodies)
            truss = self._truss(bodies)
            if truss is None:
                break
            places, found = truss
            frames = found[choices[len(ways)] if len(ways) < len(choices) else 0]
            ways.append(len(found))
            whole = bodies[places[0]]
            for at, frame in zip(places[1:], frames[1:], strict=True):
                whole = _attached(whole, bodies[at], frame)
            bodies = [whole if n == places[0] else b for n, b in enumerate(bodies) if n not in places[1:]]
        return [self._looked_again(body) for body in bodies], ways

    def _merged(self, bodies: list[_Body]) -> list[_Body]:
        """Pairs that hold joined, the firmest first, until none is left."""
        waiting, done = list(bodies), []
        while waiting:
            root = waiting.pop(0)
            links = {n: self._link(root, body) for n, body in enumerate(waiting)}
            joined: set[int] = set()
            while links:
                best = max(links, key=lambda n: (links[n].holds, links[n].firmness))
                found = links.pop(best)
                if not found.holds:
                    break
                joined.add(best)
                known = root.outline.keys
                root = _attached(root, waiting[best], found.frame)
                fresh = np.setdiff1d(root.outline.keys, known)
                for n in links:
                    if np.isin(waiting[n].outline.keys, fresh).any():
                        links[n] = self._link(root, waiting[n])
            waiting = [body for n, body in enumerate(waiting) if n not in joined]
            done.append(root)
        return done

    def _link(self, cluster: _Body, body: _Body) -> Link:
        return link(cluster.outline, body.outline, self.planar[next(iter(body.placed))])

    def _tied(self, bodies: Sequence[_Body]) -> Tied:
        """The bodies with all rows between them."""
        outlines = [Outline.of(*(self.bare[s].move(frame) for s, frame in body.placed.items())) for body in bodies]
        return Tied.of(outlines, self._flat(bodies), self.raw)

    def _flat(self, bodies: Sequence[_Body]) -> list[bool]:
        return [self.planar[next(iter(body.placed))] for body in bodies]

    def _truss(self, bodies: list[_Body]) -> tuple[tuple[int, ...], list[list[Pose]]] | None:
        """The smallest set of bodies that are rigid together, and their frames in every assembly that fits."""
        if len(bodies) == 1:
            return None
        tied, flat = self._tied(bodies), self._flat(bodies)
        for places in itertools.islice(_candidates(tied), TRIES):
            if not self._left:
                break
            truss, inside = Truss(tied.among(places)), [bodies[n] for n in places]
            which = tuple(tuple(body.placed) for body in inside)
            if which in self._loose or not truss.may_be_rigid():
                continue
            self._left -= 1
            held, frames = self._held(inside, truss.assemblies(), [flat[n] for n in places])
            if held:
                return tuple(places[n] for n in held), frames
            self._loose.add(which)
        return None

    def _held(
        self, bodies: Sequence[_Body], found: Sequence[Assembly], flat: Sequence[bool]
    ) -> tuple[list[int], list[list[Pose]]]:
        """Which of the bodies are held together, and their frames in the assemblies that fit, where one of them is
        rigid: what fits better counts as well, though a direction seems loose there, for the join decides by cost.
        Where none is rigid, those that the judge says are."""
        frames = [in_their_dimension(a.frames, flat) for a in found]
        rigid = [n for n, a in enumerate(found) if a.fits and not a.nullity]
        if not rigid:
            return self._by_judge(bodies, frames[:JUDGED])
        ways = [frames[n] for n, a in enumerate(found) if n in rigid or (a.fits and n < rigid[0])]
        return list(range(len(bodies))), ways

    def _by_judge(
        self, bodies: Sequence[_Body], assemblies: Sequence[list[Pose]]
    ) -> tuple[list[int], list[list[Pose]]]:
        """The bodies that the rows themselves hold, where they fit, and their frames: all of them, or where one hangs
        loosely the others."""
        judged = [(frames, self._asked(bodies, frames)) for frames in assemblies if self.judge is not None]
        firm = [frames for frames, holds in judged if all(h.fits and h.firm for h in holds)]
        if firm:
            return list(range(len(bodies))), firm
        for frames, holds in judged:
            held = [0, *(n for n, h in enumerate(holds, 1) if h.fits and h.firm)]
            fewer, at = [bodies[n] for n in held], [frames[n] for n in held]
            if len(held) > 1 and all(h.fits and h.firm for h in self._asked(fewer, at)):
                return held, [at]
        return [], []

    def _asked(self, bodies: Sequence[_Body], frames: Sequence[Pose]) -> Sequence[Held]:
        """What the judge says of bodies near some frames, which is remembered."""
        assert self.judge is not None
        which: list[int] = []
        of: list[int] = []
        stand: list[Pose] = []
        for n, (frame, body) in enumerate(zip(frames, bodies, strict=True)):
            members = [m for s in body.placed for m in self.chains[s][0]]
            which, of = which + members, of + [n] * len(members)
            stand += [frame @ pose for pose in self._frames(list(body.placed), body.placed)]
        holds = self.judge(which, of, stand)
        for body, held in zip(bodies, [min(holds, key=_merit), *holds], strict=True):
            known = self._judged.get(tuple(body.placed), held)
            self._judged[tuple(body.placed)] = min(held, known, key=_merit)
        return holds

    def _looked_again(self, body: _Body) -> _Body:
        """Every chain but the root fitted once more, to all the others: early links saw only part of them."""
        placed = dict(body.placed)
        for s in list(placed)[1:]:
            rest = [self.outlines[o].move(placed[o]) for o in self._met(s) if o in placed and o != s]
            if not rest:
                continue
            found = link(Outline.of(*rest), self.outlines[s], self.planar[s])
            if found.holds:
                placed[s] = found.frame
        return _Body(placed, body.outline)

    def _met(self, s: int) -> list[int]:
        """The chains that share something with chain s."""
        holders, keys = self._holders
        return [int(o) for o in np.unique(holders[np.isin(keys, self.outlines[s].keys)])]

    # --- words ------------------------------------------------------------------------------------------------

    def _reasons(self, bodies: Sequence[_Body]) -> list[str]:
        """Why each cluster but the first stands alone."""
        if len(bodies) == 1:
            return []
        tied, out = self._tied(bodies), []
        meets, free = tied.meetings(), _freedoms(tied)
        for number, body in enumerate(bodies[1:], 1):
            first = next(iter(body.placed))
            others = [n for n in range(len(bodies)) if n != number]
            # Nearest to being held.
            closest = min(others, key=lambda n: (free[n, number], -meets[n, number], n))
            told = self._judged.get(tuple(body.placed))
            around = tied.among([closest, number, *(n for n in others if n != closest)], ALL_OF_THEM)
            out.append(why_apart(self.submaps[self.chains[first][0][0]], around, int(free[closest, number]), told))
        return out


def _freedoms(tied: Tied) -> IntArray:
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


def _nothing() -> Outline:
    empty = np.zeros(0)
    flags = np.zeros(0, bool)
    return Outline(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), flags, empty, empty, flags)


def _attached(cluster: _Body, body: _Body, frame: Pose) -> _Body:
    placed = {**cluster.placed, **{s: frame @ own for s, own in body.placed.items()}}
    return _Body(placed, Outline.of(cluster.outline, body.outline.move(frame)))


def _differ(one: dict[int, Pose], other: dict[int, Pose]) -> bool:
    return any(np.abs(one[s].minus(other[s])).max() > 1e-3 for s in one)


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
    rigid = _freedoms(tied) == 0 if n <= MOST_AT_ONCE else np.ones((n, n), bool)
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


def _spread(table: Table, count: int) -> Table:
    return table.select(np.unique(np.linspace(0, len(table) - 1, min(count, len(table))).astype(int)))
