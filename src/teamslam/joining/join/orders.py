"""ORDERS of joining, by name: all at once, one after another as they arrive, or by a tree.

A joined map is a submap again, so every order is a way of calling `join`. Each level linearises once more, so orders
agree to second order in the noise, not to the last digit (the exact join removes that difference); what is not yet
connected waits as a component of its own until something connects it, and what is not yet determined (a map with one
position in the world, which is free to turn about it) until something determines it. Law: whatever the order, the
members of the components are the submaps that went in.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from teamslam.errors import SolveError
from teamslam.joining.join.join import Component, Joined, in_order, join
from teamslam.model import Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS

Within = dict[str, Component]  # the maps that were joined on the way, by their ids, as of the submaps that went in


def join_sequentially(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """One submap after another, in the order given: the order of arrival. Raises as `join` does."""
    parts, within = list[Submap](), Within()
    for submap in submaps:
        parts = [*_so_far(parts, options, within), submap]
    return _whole(join(parts, options=options), within)


def join_by_tree(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """By a binary tree over the submaps in the order of robot and time: neighbours first, so that each join has a good
    start, and log n levels. Raises as `join` does."""
    within = Within()
    return _whole(join(_merge(in_order(submaps), options, within), options=options), within)


def _merge(submaps: Sequence[Submap], options: Options, within: Within) -> list[Submap]:
    if len(submaps) <= 2:
        return list(submaps)
    middle = len(submaps) // 2
    halves = (_merge(submaps[:middle], options, within), _merge(submaps[middle:], options, within))
    return [part for half in halves for part in _so_far(half, options, within)]


def _so_far(submaps: Sequence[Submap], options: Options, within: Within) -> list[Submap]:
    """The maps of what is there so far; the submaps as they are where these alone determine no map."""
    if not submaps:
        return []
    try:
        components = join(submaps, options=options).components
    except SolveError:
        return list(submaps)
    within |= {component.map.id: _named(component, within) for component in components}
    return [component.map for component in components]


def _whole(joined: Joined, within: Within) -> Joined:
    """A join of maps, by the submaps that these were joined of."""
    return replace(joined, components=tuple(_named(component, within) for component in joined.components))


def _named(component: Component, within: Within) -> Component:
    """A component by the submaps that went in; a map that was left alone is as it was joined before."""
    if component.solution is None and component.map.id in within:
        return within[component.map.id]
    parts = (within[name].members if name in within else (name,) for name in component.members)
    return replace(component, members=tuple(sorted(name for part in parts for name in part)))


ORDERS: dict[str, Callable[..., Joined]] = {
    "at once": join,
    "sequential": join_sequentially,
    "tree": join_by_tree,
}
