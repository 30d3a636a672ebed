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

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from teamslam.geometry import Pose
from teamslam.joining.place.chains import chains_of
from teamslam.joining.place.outline import Outline, known_keys, outline_of_chain
from teamslam.joining.place.reasons import why_apart
from teamslam.joining.place.robust_fit import Link, link
from teamslam.joining.place.ties import MOST, Tied
from teamslam.joining.place.trusses import ALL_OF_THEM, Body, Found, Judge, Lie, Trusses, frames_in, freedoms
from teamslam.model import WORLD, Submap, Table, Values
from teamslam.solver import side_by_side

BRANCHES = 16  # assemblies looked at: a truss in the plane has two, two trusses four; one by ranges in space dozens


@dataclass(frozen=True)
class Cluster:
    """Submaps in one frame: `members` (places in the list, the root first) and the pose of each one's base in it;
    `others`: the frames under other assemblies that fit what is shared as well; `known`: landmarks of an earlier map,
    where it has them in this frame."""

    members: list[int]
    frames: list[Pose]
    others: list[list[Pose]] = field(default_factory=list)
    known: Values | None = None


@dataclass(frozen=True)
class Placement:
    """Clusters in the order of their lowest robot; `reasons` says why there is more than one. `searched`: how many
    trusses were solved to find them, which takes nearly all of the time where there is one."""

    clusters: list[Cluster]
    reasons: list[str] = field(default_factory=list)
    searched: int = 0


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
        self.submaps, self.chains = submaps, chains
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
        self.trusses = Trusses(chains, judge)
        self._links: dict[tuple[Lie, Lie], Link] = {}  # of bodies as they lie
        self._met_before: dict[tuple[int, ...], Found | None] = {}  # by the assemblies chosen of those before

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
        branches: list[list[Body]] = []
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
                    frames_in(self.chains, ordered, body.placed),
                    [frames_in(self.chains, ordered, o) for o in same if _differ(o, body.placed)],
                )
            )
        return Placement(clusters, self._reasons(best), self.trusses.searched)

    def _lone(self, body: Body) -> bool:
        """Whether it is one pose from which nothing is known: such come last, as nobody's frame."""
        members = [m for s in body.placed for m in self.chains[s][0]]
        return len(members) == 1 and not self.submaps[members[0]].dof

    # --- growth -----------------------------------------------------------------------------------------------

    def _grown(self, choices: Sequence[int]) -> tuple[list[Body], list[int]]:
        """The clusters, taking of the truss met as n-th the assembly number choices[n] (0 beyond); and how many
        assemblies each truss had."""
        # Planar robots share the ground, which must be the frame where robots of both kinds meet.
        order = sorted(
            range(len(self.chains)), key=lambda s: (not self.planar[s], self.submaps[self.chains[s][0][0]].base)
        )
        bodies = [Body({s: Pose.identity(2 if self.planar[s] else 3)}, self.outlines[s]) for s in order]
        ways: list[int] = []
        self.trusses.begin()
        while True:
            bodies = self._merged(bodies)
            chosen = (*choices, *(0,) * len(ways))[: len(ways)]
            truss = self._truss(bodies, chosen)
            if truss is None:
                break
            places, found = truss
            frames = found[(*choices, *(0,) * (len(ways) + 1))[len(ways)]]
            ways.append(len(found))
            whole = bodies[places[0]]
            for at, frame in zip(places[1:], frames[1:], strict=True):
                whole = _attached(whole, bodies[at], frame)
            bodies = [whole if n == places[0] else b for n, b in enumerate(bodies) if n not in places[1:]]
        return [self._looked_again(body) for body in bodies], ways

    def _merged(self, bodies: list[Body]) -> list[Body]:
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

    def _link(self, cluster: Body, body: Body) -> Link:
        """The fit of a body to a cluster, found once of both as they lie."""
        both = cluster.lie, body.lie
        if both not in self._links:
            self._links[both] = link(cluster.outline, body.outline, self.planar[next(iter(body.placed))])
        return self._links[both]

    def _truss(self, bodies: Sequence[Body], chosen: tuple[int, ...]) -> Found | None:
        """The truss that is met where of those before it these assemblies were `chosen`; what is left to be searched
        with when a branch comes by again has no say in it."""
        if chosen not in self._met_before:
            found = self.trusses.among(bodies, self._tied(bodies), self._flat(bodies)) if len(bodies) > 1 else None
            self._met_before[chosen] = found
        return self._met_before[chosen]

    def _tied(self, bodies: Sequence[Body]) -> Tied:
        """The bodies with all rows between them."""
        outlines = [Outline.of(*(self.bare[s].move(frame) for s, frame in body.placed.items())) for body in bodies]
        return Tied.of(outlines, self._flat(bodies), self.raw)

    def _flat(self, bodies: Sequence[Body]) -> list[bool]:
        return [self.planar[next(iter(body.placed))] for body in bodies]

    def _looked_again(self, body: Body) -> Body:
        """Every chain but the root fitted once more, to all the others: early links saw only part of them."""
        placed = dict(body.placed)
        for s in list(placed)[1:]:
            rest = [self.outlines[o].move(placed[o]) for o in self._met(s) if o in placed and o != s]
            if not rest:
                continue
            found = link(Outline.of(*rest), self.outlines[s], self.planar[s])
            if found.holds:
                placed[s] = found.frame
        return Body(placed, body.outline)

    def _met(self, s: int) -> list[int]:
        """The chains that share something with chain s."""
        holders, keys = self._holders
        return [int(o) for o in np.unique(holders[np.isin(keys, self.outlines[s].keys)])]

    # --- words ------------------------------------------------------------------------------------------------

    def _reasons(self, bodies: Sequence[Body]) -> list[str]:
        """Why each cluster but the first stands alone."""
        if len(bodies) == 1:
            return []
        tied, out = self._tied(bodies), []
        meets, free = tied.meetings(), freedoms(tied)
        for number, body in enumerate(bodies[1:], 1):
            first = next(iter(body.placed))
            others = [n for n in range(len(bodies)) if n != number]
            # Nearest to being held.
            closest = min(others, key=lambda n: (free[n, number], -meets[n, number], n))
            told = self.trusses.told(body)
            around = tied.among([closest, number, *(n for n in others if n != closest)], ALL_OF_THEM)
            out.append(why_apart(self.submaps[self.chains[first][0][0]], around, int(free[closest, number]), told))
        return out


def _nothing() -> Outline:
    empty = np.zeros(0)
    flags = np.zeros(0, bool)
    return Outline(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), flags, empty, empty, flags)


def _attached(cluster: Body, body: Body, frame: Pose) -> Body:
    placed = {**cluster.placed, **{s: frame @ own for s, own in body.placed.items()}}
    return Body(placed, Outline.of(cluster.outline, body.outline.move(frame)))


def _differ(one: dict[int, Pose], other: dict[int, Pose]) -> bool:
    return any(np.abs(one[s].minus(other[s])).max() > 1e-3 for s in one)


def _spread(table: Table, count: int) -> Table:
    return table.select(np.unique(np.linspace(0, len(table) - 1, min(count, len(table))).astype(int)))
