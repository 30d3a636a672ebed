"""Where each submap's frame lies, in closed form: the start of a join, from nothing.

    chains:  consecutive submaps of a robot share their boundary pose, so their frames compose
    clusters: grow from the first chain; in each round the one that is held most firmly by what it shares with the
              cluster (poses, landmarks, raw sightings of each other's robots) is attached by one robust rigid fit
    trusses:  clusters that no pair holds by what it shares, but that are rigid together or by the ranges between their
              robots, are assembled, in every way that fits
    second look: every chain is fitted once more, to all the others of its cluster

What nothing holds starts a cluster of its own: separate components, with the reason in words. One shared pose holds a
frame; points must be two at different places in the plane, three not in line in space, else a hinge is left.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.place.chains import chains_of
from teamslam.joining.place.frameworks import assemblies, freedom, left_open
from teamslam.joining.place.outline import Outline, known_keys, outline_of_chain
from teamslam.joining.place.ranges import Ranges
from teamslam.joining.place.robust_fit import Link, link
from teamslam.model import Names, Submap, is_landmark, is_pose, robot_of
from teamslam.solver import side_by_side

BRANCHES = 8  # assemblies looked at: a truss in the plane has two, two trusses four
TRUSS = 4  # clusters in a truss at most
TRIES = 500  # sets of clusters looked at for a truss; only where very many hang loosely together are there more


@dataclass(frozen=True)
class Cluster:
    """Submaps in one frame: `members` (places in the list, the root first) and the pose of each one's base in it;
    `others`: the frames under other assemblies that fit what is shared as well."""

    members: list[int]
    frames: list[Pose]
    others: list[list[Pose]] = field(default_factory=list)


@dataclass(frozen=True)
class Placement:
    """Clusters in the order of their lowest robot; `reasons` says why there is more than one."""

    clusters: list[Cluster]
    reasons: list[str] = field(default_factory=list)


@dataclass
class _Body:
    """Strands in one frame, while clusters grow: where each lies, and what they know together."""

    placed: dict[int, Pose]
    outline: Outline


def place(submaps: Sequence[Submap]) -> Placement:
    """The frames of all submaps, by clusters. Law: with noise-free submaps every frame is exact."""
    chains = chains_of(submaps)
    if len(chains) == 1:
        return Placement([Cluster(list(chains[0][0]), chains[0][1])])
    return _Placing(submaps, chains).placement()


class _Placing:
    """The chains of one set of submaps, with what several of them know."""

    def __init__(self, submaps: Sequence[Submap], chains: Sequence[tuple[list[int], list[Pose]]]) -> None:
        self.submaps, self.chains = submaps, chains
        known = [np.unique(np.concatenate([known_keys(submaps[m]) for m in members])) for members, _ in chains]
        keys, times = np.unique(np.concatenate(known), return_counts=True)
        self.ranges = Ranges.of(t for members, _ in chains for m in members for t in submaps[m].raw)
        shared = np.union1d(keys[times > 1], self.ranges.keys)
        meets = [np.isin(of, shared).any() for of in known]

        def outline(chain: int) -> Outline:
            members, frames = chains[chain]
            return outline_of_chain([submaps[m] for m in members], frames, shared) if meets[chain] else _nothing()

        self.outlines = side_by_side(outline, range(len(chains)))
        self._holders = (
            np.repeat(np.arange(len(chains)), [len(outline.keys) for outline in self.outlines]),
            np.concatenate([outline.keys for outline in self.outlines]),
        )
        self.planar = [submaps[members[0]].base_dim == 2 for members, _ in chains]

    def placement(self) -> Placement:
        """The assembly with the fewest clusters, with all others of it."""
        branches: list[list[_Body]] = []
        waiting: list[tuple[int, ...]] = [()]
        while waiting and len(branches) < BRANCHES:
            choices = waiting.pop(0)
            bodies, ways = self._grown(choices)
            branches.append(bodies)
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
        return Placement(clusters, self._reasons(best))

    def _frames(self, ordered: Sequence[int], placed: dict[int, Pose]) -> list[Pose]:
        return [placed[s] @ frame for s in ordered for frame in self.chains[s][1]]

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

    def _truss(self, bodies: list[_Body]) -> tuple[tuple[int, ...], list[list[Pose]]] | None:
        """The smallest set of bodies that are rigid together, and their frames in every assembly that fits."""
        dims = [2 if self.planar[next(iter(body.placed))] else 3 for body in bodies]
        known = [body.outline.keys for body in bodies]
        for places in itertools.islice(_candidates(known, self.ranges), TRIES):
            dim = dims[places[0]]
            if any(dims[n] != dim for n in places):
                continue  # robots of the ground and of the air: a truss of both is not looked for
            found = assemblies([bodies[n].outline for n in places], dim, self.ranges)
            if found:
                return places, found
        return None

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
        out = []
        for body in bodies[1:]:
            first = next(iter(body.placed))
            submap = self.submaps[self.chains[first][0][0]]
            others = [other for other in bodies if other is not body]
            heard = self.ranges.between([body.outline.keys, *(other.outline.keys for other in others)])[0, 1:]
            if heard.any():
                most = others[int(np.argmax(heard))]
                loose = left_open([most.outline, body.outline], 2 if self.planar[first] else 3, self.ranges)
                out.append(_why_not_by_ranges(submap, int(heard.max()), loose))
                continue
            closest = max((self._link(o, body) for o in others), key=lambda found: (found.firmness, len(found.shared)))
            out.append(_why(submap, closest, body.outline, self.planar[first]))
        return out


def _nothing() -> Outline:
    empty = np.zeros(0)
    flags = np.zeros(0, bool)
    return Outline(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), flags, empty, empty, flags)


def _attached(cluster: _Body, body: _Body, frame: Pose) -> _Body:
    placed = {**cluster.placed, **{s: frame @ own for s, own in body.placed.items()}}
    return _Body(placed, Outline.of(cluster.outline, body.outline.move(frame)))


def _differ(one: dict[int, Pose], other: dict[int, Pose]) -> bool:
    return any(np.abs(one[s].minus(other[s])).max() > 1e-3 for s in one)


def _candidates(known: Sequence[IntArray], ranges: Ranges) -> Iterator[tuple[int, ...]]:
    """Sets of bodies that may be rigid together, small sets first: pairs with ranges, those with most of them before
    others; three and more of which each shares something with two others or has ranges to one."""
    n = len(known)
    heard = ranges.between(known)
    pairs = sorted(itertools.combinations(range(n), 2), key=lambda pair: -heard[pair])
    yield from (pair for pair in pairs if heard[pair])
    ties = np.where(heard > 0, 2, 0)
    for a, b in itertools.combinations(range(n), 2):
        ties[a, b] = ties[b, a] = max(ties[a, b], int(np.isin(known[a], known[b]).any()))
    around = np.flatnonzero(ties.sum(1) >= 2)
    for size in range(3, TRUSS + 1):
        for places in itertools.combinations(around.tolist(), size):
            if (ties[np.ix_(places, places)].sum(1) >= 2).all():
                yield places


def _who(submap: Submap) -> str:
    names: Names = submap.names
    return f"the submaps of robot {names.robot(int(robot_of(submap.base)))} from {names.describe(submap.base)} on"


def _why_not_by_ranges(submap: Submap, heard: int, loose: int) -> str:
    tied = f"{_who(submap)} are tied to the map by {heard} range{'' if heard == 1 else 's'} between robots"
    if not loose:
        return f"{tied}, but no frame fits them; look for wrong ranges, or for odometry that is worse than it says"
    return (
        f"{tied}, which at these sigmas leave {loose} direction{'' if loose == 1 else 's'} of their frame open: "
        f"under-constrained; ranges from other sides and farther apart, one more common landmark, or one sighting of a "
        f"robot's pose, would join them"
    )


def _why(submap: Submap, found: Link, outline: Outline, planar: bool) -> str:
    names, who = submap.names, _who(submap)
    marks = found.shared[is_landmark(found.shared)]
    if not len(found.shared):
        return (
            f"{who} share nothing with the map: no common landmark, and neither robot saw the other; "
            f"{'two' if planar else 'three'} common landmarks, or one sighting of a robot's pose, would join them"
        )
    things = [f"landmark {names.landmark(int(k))}" for k in marks[:4]] + [
        names.describe(int(k)) for k in found.shared[is_pose(found.shared)][:2]
    ]
    loose = freedom(outline.only(found.shared), 2 if planar else 3)
    sigma = 1.0 / np.sqrt(max(found.firmness, 1e-9))
    heading = f"known to {sigma:.2g} rad" if sigma < 1.0 else "unknown"
    return (
        f"{who} share only {', '.join(things)} with the map and can still turn about "
        f"{'it' if len(found.shared) == 1 else 'them'}: under-constrained, {loose} direction"
        f"{'' if loose == 1 else 's'} free (heading {heading}); "
        f"{'two more common landmarks' if loose == 3 else 'one more common landmark'} elsewhere, "
        f"or one sighting of a robot's pose, would join them"
    )
