"""Algorithm 2: submaps joined into one map, minimising g(G) = sum_i |S^_i (-) H_i(G)|^2 weighed by I_i (paper, eq. 11).

    place:  where each submap's frame lies, in closed form
    solve:  all frames and variables together; raw measurements that travel with the submaps join in; where the
            frames have several assemblies, from each, and the lowest cost counts
    keep :  G^ and its information: a submap again

A join is a pure function of the set of submaps: they are put in order by id before anything is computed. It refuses to
count a measurement twice. Submaps that nothing holds together come back as separate components, with the reason.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import IntArray, Pose
from teamslam.joining.join.double_counting import refuse_double_counting
from teamslam.joining.join.gauge import anchor
from teamslam.joining.join.homes import homes
from teamslam.joining.join.start_values import start_values
from teamslam.joining.place.place import Cluster, place
from teamslam.joining.place.stack import Stack
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import WORLD, Layout, LeftOut, Names, Sources, Submap, Table
from teamslam.solver import Options, Solution, Step, SubmapTerm, System, convex_start, optimise
from teamslam.solver.optimise import DEFAULTS

RULED_OUT = 16.0  # of cost: four sigmas; an assembly that costs more is not mentioned


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
    after an exact join how exact it is. `ambiguities` names other ways to put the submaps together (a mirrored truss)
    that cost about as much."""

    map: Submap
    solution: Solution | None
    members: tuple[str, ...]
    exactness: Exactness | None = None
    ambiguities: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Joined:
    """What a team's submaps make together. `components` in the order of their lowest robot; `reasons` says, where there
    are several, why they could not be joined and what would join them.

    Where the log is at hand, `left_out` is all of it that is in no map (see `account`); `remarks` says in words what is
    in a map though something is to be known of it, such as a submap that stopped short of its optimum."""

    components: tuple[Component, ...]
    reasons: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def map(self) -> Submap:
        """The map of the first component."""
        return self.components[0].map

    @property
    def converged(self) -> bool:
        """True where every component reached an optimum."""
        return all(c.solution is None or c.solution.converged for c in self.components)


def join(
    submaps: Iterable[Submap],
    *,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Joined:
    """The map of all submaps together, all at once.

    Its frame is the base pose of the lowest robot's first submap, or the world's where positions in the world were
    measured. Laws: the result does not depend on the order of the submaps; joining one submap gives that submap back.
    Raises ModelError for an empty set, for ids that stand twice, and where one measurement is in two submaps (see
    `twice`).
    """
    ordered = in_order(submaps)
    refuse_double_counting(ordered)
    placement = place(ordered)
    components = [_join_cluster(ordered, cluster, options, progress) for cluster in placement.clusters]
    return Joined(tuple(components), tuple(placement.reasons))


def in_order(submaps: Iterable[Submap]) -> list[Submap]:
    """The submaps sorted by the robot and time of their base, then by id; the newest version of each."""
    newest: dict[str, Submap] = {}
    for submap in submaps:
        held = newest.get(submap.id)
        if held is not None and held.version == submap.version and held is not submap:
            raise ModelError(f"two different submaps are both called {submap.id}, version {submap.version}")
        if held is None or submap.version > held.version:
            newest[submap.id] = submap
    if not newest:
        raise ModelError("there is nothing to join: the set of submaps is empty")
    return sorted(newest.values(), key=lambda s: (s.base, s.id))


def _join_cluster(
    submaps: Sequence[Submap], cluster: Cluster, options: Options, progress: Callable[[Step], None] | None
) -> Component:
    members = [submaps[number] for number in cluster.members]
    found = [_join_from(members, frames, options, progress) for frames in (cluster.frames, *cluster.others)]
    found.sort(key=lambda component: component.map.cost)
    return replace(
        found[0], ambiguities=tuple(_ambiguity(found[0], other) for other in found[1:] if _close(found[0], other))
    )


def _join_from(
    members: Sequence[Submap], frames: Sequence[Pose], options: Options, progress: Callable[[Step], None] | None
) -> Component:
    """The optimum from one assembly of the members' frames."""
    ids = tuple(sorted(m.id for m in members))
    raw = [table for member in members for table in member.raw]
    if len(members) == 1 and not raw:
        return Component(members[0], None, ids)
    names = members[0].names.merge(m.names for m in members[1:])
    stack = Stack.of(members)
    start = triangulate(start_values(stack, frames), raw)
    usable, _ = usable_rows(raw, start.layout)
    start, fixed = anchor(start, members[0], usable)
    terms = [SubmapTerm.of(member) for member in members]
    carried = homes(start.layout, stack)
    system = System(start.layout, tables=usable, submaps=terms, fixed=fixed, names=names, homes=carried)
    solution = optimise(system, convex_start(system, start, options), options, progress)
    return Component(joined_map(members, usable, solution, fixed, names), solution, ids)


def _close(best: Component, other: Component) -> bool:
    """Whether another optimum cannot be ruled out, and is another one."""
    apart = np.abs(other.map.values.minus(best.map.values)).max() > 1e-3
    return bool(apart) and other.map.cost - best.map.cost < RULED_OUT


def _ambiguity(best: Component, other: Component) -> str:
    return (
        f"ambiguous: {len(best.members)} submaps fit together in another way too, such as mirrored; this map costs "
        f"{best.map.cost:.6g}, the other {other.map.cost:.6g}. One more common landmark, or one sighting of a robot's "
        f"pose, would decide"
    )


def usable_rows(raw: Iterable[Table], layout: Layout) -> tuple[list[Table], list[Table]]:
    """Raw measurements in two parts: those whose variables are all there, and those that wait for another submap."""
    usable, waiting = [], []
    for table in raw:
        ready = np.asarray(layout.contains(table.keys).all(1))
        usable += [table.select(ready)] if ready.any() else []
        waiting += [table.select(~ready)] if not ready.all() else []
    return usable, waiting


def joined_map(
    members: Sequence[Submap], raw: Sequence[Table], solution: Solution, fixed: IntArray, names: Names
) -> Submap:
    """The joined map as a submap, in the frame of the fixed pose (or the world's)."""
    _, waiting = usable_rows([t for m in members for t in m.raw], solution.values.layout)
    keep = ~np.isin(solution.values.layout.keys, fixed)
    base, base_dim = (int(fixed[0]), members[0].base_dim) if len(fixed) else (WORLD, members[0].base_dim)
    return Submap(
        id="+".join(sorted(m.id for m in members)),
        version=max(m.version for m in members),
        base=base,
        base_dim=base_dim,
        values=solution.values.select(keep),
        information=solution.information,
        sources=Sources().merge(*(m.sources for m in members)),
        names=names,
        raw=tuple(waiting),
        cost=solution.cost + sum(m.cost for m in members),
        chi2=solution.chi2 + sum(m.chi2 for m in members),
        rows=sum(m.rows for m in members) + sum(t.dof for t in raw),
    )
