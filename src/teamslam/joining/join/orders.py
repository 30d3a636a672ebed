"""ORDERS of joining, by name: all at once, one after another as they arrive, or by a tree.

A joined map is a submap again, so every order is a way of calling `join`. Each level linearises once more, so orders
agree to second order in the noise, not to the last digit (the exact join removes that difference); what is not yet
connected waits as a component of its own until something connects it.
"""

from collections.abc import Callable, Iterable, Sequence

from teamslam.joining.join.join import Joined, in_order, join
from teamslam.model import Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS


def join_sequentially(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """One submap after another, in the order given: the order of arrival. Raises as `join` does."""
    parts: list[Submap] = []
    joined: Joined | None = None
    for submap in submaps:
        joined = join([*parts, submap], options=options)
        parts = [component.map for component in joined.components]
    return joined if joined is not None else join([], options=options)


def join_by_tree(submaps: Iterable[Submap], *, options: Options = DEFAULTS) -> Joined:
    """By a binary tree over the submaps in the order of robot and time: neighbours first, so that each join has a good
    start, and log n levels. Raises as `join` does."""
    return join(_merge(in_order(submaps), options), options=options)


def _merge(submaps: Sequence[Submap], options: Options) -> list[Submap]:
    if len(submaps) <= 2:
        return list(submaps)
    middle = len(submaps) // 2
    halves = (_merge(submaps[:middle], options), _merge(submaps[middle:], options))
    return [component.map for half in halves for component in join(half, options=options).components]


ORDERS: dict[str, Callable[..., Joined]] = {
    "at once": join,
    "sequential": join_sequentially,
    "tree": join_by_tree,
}
