"""How far a join is from the full least squares: a round in which nobody moves.

The paper's join replaces each submap's cost f_i by its quadratic at the submap's own optimum. What that costs is seen
where the join ended (see `gap`). A join that is exact promises no decrease. `exact_join` goes on from here, round by
round, until nothing is promised.
"""

from collections.abc import Sequence
from dataclasses import replace

from teamslam.errors import SolveError
from teamslam.joining.exact.gap import AtMap
from teamslam.joining.exact.robot import Sending, separators_of
from teamslam.joining.join.join import Component, Exactness, Joined
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import WORLD, Dataset, Sources, Submap


def with_exactness(
    joined: Joined, members: Sequence[tuple[Dataset, Submap]], at: Sequence[AtMap] | None = None
) -> Joined:
    """A join that knows how exact it is: pairs of a piece of log and the submap that was built of it, in any order.

    A component of which some piece is missing stays without, and so does one whose problem is not determined where it
    ended. `at`, the log at each component's map, saves linearising it again. Law: the gap is that to `full` on the same
    data, to first order in it and, under robust losses, of its size; `rounds` is 1, `bytes` what that round takes, and
    `join_shift_sigma` 0: a join did not move from itself.
    """
    known: Sequence[AtMap | None] = at or [None] * len(joined.components)
    both = zip(joined.components, known, strict=True)
    return replace(joined, components=tuple(_with_exactness(component, members, here) for component, here in both))


def _with_exactness(component: Component, members: Sequence[tuple[Dataset, Submap]], at: AtMap | None) -> Component:
    if component.exactness is not None:
        return component
    here = [(piece, submap) for piece, submap in members if component.map.sources.overlap(submap.sources)]
    if Sources().merge(*(submap.sources for _, submap in here)) != component.map.sources:
        return component
    try:
        return replace(component, exactness=_exactness(component.map, here, at))
    except SolveError:
        return component


def _exactness(joined: Submap, members: Sequence[tuple[Dataset, Submap]], known: AtMap | None) -> Exactness:
    at = AtMap([table for piece, _ in members for table in piece.tables], joined)
    if known is not None and len(known) == len(at):
        at = known  # a log has all rows of its pieces: as many are the same
    submaps = [submap for _, submap in members]
    raw, _ = usable_rows(
        [table for submap in submaps for table in submap.raw], at.values.layout, world=joined.base == WORLD
    )
    separators = separators_of(submaps, raw)
    sent = [Sending.of(submap, separators) for submap in submaps]
    numbers = sum(sending.placing + sending.numbers for sending in sent)
    return at.gap.exactness(rounds=1, bytes=8 * numbers if len(sent) > 1 else 0)
