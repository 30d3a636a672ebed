"""ORDERS of joining, by name: all at once, one after another as they arrive, or by a tree.

A joined map is a submap again, so every order is a way of calling `join`. Each level linearises once more, so orders
agree to second order in the noise, not to the last digit (the exact join removes that difference); what is not yet
connected waits as a component of its own until something connects it, and what is not yet determined (a map with one
position in the world, which is free to turn about it) until something determines it.
"""

from collections.abc import Callable, Iterable, Sequence

from teamslam.errors import SolveError
from teamslam.joining.join.join import Joined, in_order, join
from teamslam.model import Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS


def join_sequentially(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """One submap after another, in the order given: the order of arrival. Raises as `join` does."""
    parts: list[Submap] = []
    for submap in submaps:
        parts = [*_so_far(parts, options), submap]
    return join(parts, options=options)


def join_by_tree(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """By a binary tree over the submaps in the order of robot and time: neighbours first, so that each join has a good
    start, and log n levels. Raises as `join` does."""
    return join(_merge(in_order(submaps), options), options=options)


def _merge(submaps: Sequence[Submap], options: Options) -> list[Submap]:
    if len(submaps) <= 2:
        return list(submaps)
    middle = len(submaps) // 2
    halves = (_merge(submaps[:middle], options), _merge(submaps[middle:], options))
    return [part for half in halves for part in _so_far(half, options)]


def _so_far(submaps: Sequence[Submap], options: Options) -> list[Submap]:
    """The maps of what is there so far; the submaps as they are where these alone determine no map."""
    if not submaps:
        return []
    try:
        return [component.map for component in join(submaps, options=options).components]
    except SolveError:
        return list(submaps)


ORDERS: dict[str, Callable[..., Joined]] = {
    "at once": join,
    "sequential": join_sequentially,
    "tree": join_by_tree,
}
