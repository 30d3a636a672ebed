"""Algorithm 2: submaps joined into one map, minimising g(G) = sum_i |S^_i (-) H_i(G)|^2 weighed by I_i (paper, eq. 11).

    spare:  what only one submap knows, where that is most of it, is eliminated first: it changes nothing but the time
    place:  where each submap's frame lies, in closed form
    solve:  all frames and shared variables together; raw measurements that travel with the submaps join in; where the
            frames have several assemblies, from each, and of those that lead to an optimum the lowest cost counts;
            where that makes no sense, from the maps of both halves too; where there is no optimum, without raw rows
            that contradict the rest, and where there is none even so, both halves for themselves
    keep :  G^, all variables back in it, and its information: a submap again

A join is a pure function of the set of submaps: they are put in order by id before anything is computed. It refuses to
count a measurement twice. Submaps that nothing holds together come back as separate components, with the reason.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.answers import Answers, ResidualTable
from teamslam.answers.maps_card import facts_of, maps_card
from teamslam.answers.residuals import residual_table
from teamslam.errors import ModelError, SolveError
from teamslam.geometry import Array, Pose
from teamslam.joining.join.contradicting import without_contradictions
from teamslam.joining.join.double_counting import refuse_double_counting
from teamslam.joining.join.held import held
from teamslam.joining.join.interiors import Member, members_of
from teamslam.joining.join.optimum import Optimum
from teamslam.joining.place.place import Cluster, Placement, place
from teamslam.joining.place.reasons import Held
from teamslam.joining.start.twofold import RULED_OUT
from teamslam.model import WORLD, Dataset, Kind, LeftOut, Submap, Values, expect, is_landmark, rebased
from teamslam.solver import Covariances, Options, Solution, Step
from teamslam.solver.optimise import DEFAULTS
from teamslam.solver.solution import SENSELESS

SUBMAPS = "submaps (of ts.build or ts.read_submaps)"


@dataclass(frozen=True)
class Exactness:
    """How far a join is from the full least squares over all raw data, and what it took to get there.

    `relative_cost_gap`: the decrease of F still to be had, over F. `gradient_norm`: the gradient of F in the norm of
    H^-1 (the Newton decrement), in sigmas: no combination of variables is farther than this from the optimum.
    `max_shift_sigma`: the farthest that any one variable still has to go, in its own sigmas. `join_shift_sigma`: the
    farthest that any one variable moved from the paper's join; 0 of that join itself.

    `rounds`: how often the robots linearised and sent what they found: for the paper's join, and once more for every
    step, those included whose matrix turned out to be indefinite. `bytes`: all these messages up; the separators'
    places down and the robots' costs back, for every step and part of a step that was tried. A number is eight bytes;
    of sparse matrices the numbers count. Nothing is sent for one submap alone. Not counted: the map itself, should
    somebody want to hold it whole, and starts that led to a worse optimum.
    """

    relative_cost_gap: float
    gradient_norm: float
    max_shift_sigma: float
    join_shift_sigma: float
    rounds: int
    bytes: int


@dataclass(frozen=True, eq=False)
class Component:
    """Submaps that could be joined: their `map`, the solver's account (None for a submap left alone), their ids, and
    after an exact join how exact it is. `dearer`: how much more than the map other ways to put the submaps together (a
    mirrored truss) cost, as far as the join of the submaps tells. `second_places`: landmarks, by key, that could be
    elsewhere too, and where, in the frame of the map, as far as the log is at hand."""

    map: Submap
    solution: Solution | None
    members: tuple[str, ...]
    exactness: Exactness | None = None
    dearer: tuple[float, ...] = ()
    second_places: tuple[tuple[int, Array], ...] = ()

    def __repr__(self) -> str:
        return f"Component({self.map!r}, of {len(self.members)} submaps)"

    @property
    def converged(self) -> bool:
        """Whether its map is at an optimum, as a submap left alone is."""
        return self.solution is None or self.solution.converged

    @property
    def ambiguities(self) -> tuple[str, ...]:
        """The other ways to put the submaps together, in words."""
        return tuple(
            f"ambiguous: {len(self.members)} submaps fit together in another way too, such as mirrored; this map costs "
            f"{self.map.cost:.6g}, the other about {more:.2g} more. One more common landmark, or one sighting of a "
            f"robot's pose, would decide"
            for more in self.dearer
        )


@dataclass(frozen=True, eq=False)
class Joined(Answers):
    """What a team's submaps make together, asked by name (see `teamslam.answers`). `components` in the order of their
    lowest robot; `reasons` says, where there are several, why they could not be joined and what would join them.

    Where the `log` is at hand, `left_out` is all of it that is in no map (see `account`); `remarks` says in words what
    is in a map though something is to be known of it, such as a submap that stopped short of its optimum.
    `searched`: how many sets of submaps were solved for where they lie, since no two of them hold each other."""

    components: tuple[Component, ...]
    reasons: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    remarks: tuple[str, ...] = ()
    log: Dataset | None = None
    searched: int = 0

    @property
    def map(self) -> Submap:
        """The map of the first component."""
        return self.components[0].map

    @property
    def maps(self) -> tuple[Submap, ...]:
        """One for each component."""
        return tuple(component.map for component in self.components)

    @cached_property
    def covariances(self) -> tuple[Covariances, ...]:
        """Of each map; what is found of them is kept."""
        return tuple(Covariances.of_map(submap) for submap in self.maps)

    @property
    def converged(self) -> bool:
        """True where every component reached an optimum."""
        return all(component.converged for component in self.components)

    def residuals(self, log: Dataset | None = None) -> ResidualTable:
        """How far every row of the log is off at the maps. Submaps hold no rows: what was joined of them needs the
        `log` that they were built of (ModelError without); what `full` or `run` made knows its own."""
        log = log or self.log
        if log is None:
            raise ModelError("submaps do not hold the rows that they were built of; hand over the log: residuals(log)")
        return residual_table(self, log.tables)

    def __repr__(self) -> str:
        return f"Joined({'; '.join(value for _, value in self._facts())})"

    def _repr_html_(self) -> str:
        return maps_card("A team's map", self, self._facts())

    def _facts(self) -> list[tuple[str, str]]:
        return [
            *facts_of(self),
            ("state", "converged" if self.converged else "not converged"),
            *([("left out", ", ".join(lost.what for lost in self.left_out))] if self.left_out else []),
        ]


def join(
    submaps: Iterable[Submap],
    *,
    near: Joined | None = None,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Joined:
    """The map of all submaps together, all at once.

    Its frame is the lowest robot's first pose, or the world's where positions in the world were measured. `near`: an
    earlier join of submaps with the same ids, by which their frames lie instead of being looked for; where it is
    ambiguous, they are looked for all the same. Laws: the result does not depend on the order of the submaps; joining
    one submap gives that submap back, seen from its first pose. Raises ModelError for an empty set, for ids that stand
    twice, and where one measurement is in two submaps (see `twice`).
    """
    ordered = in_order(submaps)
    refuse_double_counting(ordered)
    return _joined(ordered, options, progress, by_halves=options.elsewhere, near=near)


def _joined(
    ordered: Sequence[Submap],
    options: Options,
    progress: Callable[[Step], None] | None,
    by_halves: bool,
    near: Joined | None = None,
) -> Joined:
    members = members_of(ordered)

    def judge(which: Sequence[int], bodies: Sequence[int], frames: Sequence[Pose]) -> Sequence[Held]:
        return held([members[n] for n in which], bodies, frames, options)

    lain = _as_lain([member.joined for member in members], near) if near else None
    placement = lain or place([member.joined for member in members], judge)
    found: list[tuple[str, Component]] = []
    for reason, cluster in zip(("", *placement.reasons), placement.clusters, strict=True):
        try:
            found.append((reason, _join_cluster(members, cluster, options, progress, by_halves)))
        except SolveError as error:
            if len(cluster.members) == 1 or not options.elsewhere:
                raise
            inside = [members[number].whole for number in cluster.members]
            found += [(again or reason, c) for again, c in _fallen_apart(inside, error, options, progress)]
    return Joined(tuple(c for _, c in found), tuple(why for why, _ in found[1:]), searched=placement.searched)


def _fallen_apart(
    submaps: Sequence[Submap], error: SolveError, options: Options, progress: Callable[[Step], None] | None
) -> list[tuple[str, Component]]:
    """Both halves of submaps of which no one map could be made, each with why it is a map of its own; the reason of the
    first is empty."""
    middle = len(submaps) // 2
    found: list[tuple[str, Component]] = []
    for half in (submaps[:middle], submaps[middle:]):
        joined = _joined(half, options, progress, by_halves=False)
        between = f"together no map of them was found: {error}" if found else ""
        found += zip((between, *joined.reasons), joined.components, strict=True)
    return found


def _as_lain(submaps: Sequence[Submap], near: Joined) -> Placement | None:
    """The submaps where an earlier join has them, and alone those that by its books are in none of its maps; None where
    it has not all of them, or in several ways."""
    number, clusters = {submap.id: n for n, submap in enumerate(submaps)}, []
    for component in near.components:
        inside = sorted(number.pop(name) for name in component.members if name in number)
        frames = _frames_in(component.map, [submaps[n] for n in inside]) if inside else []
        if not frames or component.dearer:
            return None
        clusters.append(Cluster(inside, frames, known=_landmarks_in(component.map, submaps[inside[0]])))
    alone = [(n, _why_out(submaps[n], near)) for n in number.values()]
    if any(why is None for _, why in alone):
        return None
    clusters += [Cluster([n], [Pose.identity(submaps[n].base_dim)]) for n, _ in alone]
    return Placement(clusters, [*near.reasons, *(why or "" for _, why in alone)])


def _why_out(submap: Submap, near: Joined) -> str | None:
    """Why an earlier join holds a submap in none of its maps, by its books; None where these do not speak of it."""
    reason = next((out.reason for out in near.left_out if (out.keys == submap.base).any()), None)
    return reason and reason.split(f"; {submap.names.describe(submap.base)} stands alone: ")[0]


def in_order(submaps: Iterable[Submap]) -> list[Submap]:
    """The submaps sorted by the robot and time of their base, then by id; the newest version of each."""
    newest: dict[str, Submap] = {}
    expect(submaps, Iterable, f"{SUBMAPS}, in a list")
    for submap in submaps:
        expect(submap, Submap, SUBMAPS)
        held = newest.get(submap.id)
        if held is not None and held.version == submap.version and held is not submap:
            raise ModelError(f"two different submaps are both called {submap.id}, version {submap.version}")
        if held is None or submap.version > held.version:
            newest[submap.id] = submap
    if not newest:
        raise ModelError("there is nothing to join: the set of submaps is empty")
    return sorted(newest.values(), key=lambda s: (s.base, s.id))


def _join_cluster(
    members: Sequence[Member],
    cluster: Cluster,
    options: Options,
    progress: Callable[[Step], None] | None,
    by_halves: bool,
) -> Component:
    """The best of the optima from all assemblies of the members' frames; others that come close are named."""
    inside = [members[number] for number in cluster.members]
    ids = tuple(sorted(member.whole.id for member in inside))
    if len(inside) == 1 and not inside[0].whole.raw:
        return Component(rebased(inside[0].whole, inside[0].whole.first_pose), None, ids)
    found = _optima(inside, cluster, options, progress)
    if by_halves and len(inside) > 2 and (lowest := min(found, key=_excess)).shared.senseless:
        found += _from_halves(inside, lowest, options, progress)
    best, *others = sorted(found, key=lambda optimum: (optimum.stopped, _excess(optimum)))
    dearer = tuple(_excess(other) - _excess(best) for other in others if not other.stopped and _close(best, other))
    return Component(best.map(inside[0].whole.base_dim), best.solution, ids, dearer=dearer)


def _optima(
    inside: Sequence[Member], cluster: Cluster, options: Options, progress: Callable[[Step], None] | None
) -> list[Optimum]:
    """The optima from all assemblies that lead to one; where one leads to nothing that is determined, a search that
    stopped short of an optimum from another is on its way there as well. Raises SolveError where none is left."""
    found: list[Optimum] = []
    problem: SolveError | None = None
    for frames in (cluster.frames, *cluster.others):
        try:
            found.append(Optimum.of(inside, frames, options, progress, cluster.known))
        except SolveError as error:
            problem = problem or error
    if problem is not None:
        found = [optimum for optimum in found if not optimum.stopped]
    if not found and options.elsewhere:
        rest = without_contradictions(inside, cluster.frames, options, progress)
        found += [rest] if rest is not None else []
    if not found:
        assert problem is not None
        raise problem
    return found


def _from_halves(
    members: Sequence[Member], whole: Optimum, options: Options, progress: Callable[[Step], None] | None
) -> list[Optimum]:
    """The optimum from where the submaps lie once each half of them is a map: what a long chain of them has lost is
    found along its parts before these are laid end to end. None where the halves make no one map, and where these cost
    what the `whole` does: no way to lay them makes sense of parts that make none. At most log2 of their number of
    levels, each of which joins every submap twice more, with its half and that with the other, from one start."""
    submaps, middle = [member.joined for member in members], len(members) // 2
    once = replace(options, elsewhere=False)
    try:
        halves = [_joined(half, once, None, by_halves=True) for half in (submaps[:middle], submaps[middle:])]
        components = [component for half in halves for component in half.components]
        if not _senseless_between(whole, components):
            return []
        merged, *others = _joined(in_order(c.map for c in components), once, None, by_halves=False).components
        frames = _frames_in(merged.map, submaps)
        return [Optimum.of(members, frames, once, progress)] if frames and not others else []
    except SolveError:
        return []  # a start ends nothing


def _senseless_between(whole: Optimum, parts: Sequence[Component]) -> bool:
    """Whether a join costs more beyond its parts' own joins than noise explains. Law: no join costs less than they."""
    inside = [part.solution for part in parts if part.solution is not None]
    cost, dof = whole.shared.cost - sum(s.cost for s in inside), whole.shared.dof - sum(s.dof for s in inside)
    return cost > SENSELESS * max(dof, 1)


def _frames_in(whole: Submap, submaps: Sequence[Submap]) -> list[Pose]:
    """The bases of submaps in a map that was made of them, seen from the first; none where it lacks one, or where some
    are planar and some are not."""
    bases = np.array([submap.base for submap in submaps])
    values = whole.all_values if whole.base >= 0 else whole.values
    if not values.layout.contains(bases).all():
        return []
    kinds = np.unique(values.layout.kinds[values.layout.index(bases)])
    if len(kinds) > 1:
        return []
    poses = values.poses_of(bases, Kind(int(kinds[0])).dim)
    return [poses[0].between(poses[place]) for place in range(len(poses))]


def _landmarks_in(whole: Submap, first: Submap) -> Values:
    """The landmarks of a map, seen from the base of one of the submaps that it was made of."""
    values = whole.all_values if whole.base >= 0 else whole.values
    keys = values.layout.keys
    marks = values.layout.select(is_landmark(keys) & (keys != WORLD) & (values.layout.kinds > Kind.POSE3))
    base = np.array([first.base])
    kind = Kind(int(values.layout.kinds[values.layout.index(base)][0]))
    return values.seen_from(values.poses_of(base, kind.dim)[0], marks)


def _excess(optimum: Optimum) -> float:
    """What an optimum costs beyond what is expected of the numbers that it explains; a landmark that one assembly
    leaves open is no merit of it."""
    return optimum.shared.cost - optimum.shared.rows


def _close(best: Optimum, other: Optimum) -> bool:
    """Whether another optimum cannot be ruled out, and is another one."""
    mine, its = best.shared.values, other.shared.values
    both = np.intersect1d(mine.layout.keys, its.layout.keys)
    apart = np.abs(its.only(both).minus(mine.only(both))).max() > 1e-3
    return bool(apart) and _excess(other) - _excess(best) < RULED_OUT
