"""The truth of a log at the right moments: its stamps are those of another computer."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from teamslam.frontend.clock import Clock
from teamslam.joining import Joined
from teamslam.metrics import Late, late_truth, truth_clocks
from teamslam.model import Dataset, Submap, Unknowns, Values, index_of


def in_time(dataset: Dataset, joined: Joined) -> tuple[Dataset, dict[int, Late]]:
    """The log with the truth of each robot at the right moments, where the map tells clearly that its stamps are late,
    or that its clock drifts; and how late each is."""
    unknowns = dataset.unknowns
    if unknowns is None or dataset.names.counts:
        return dataset, {}

    def truth_by(clocks: Mapping[int, Clock]) -> Values | None:
        return unknowns.truth_with({robot: clock.own for robot, clock in clocks.items()})

    found: dict[int, Late] = {}
    for submap, robots in _homes(joined, unknowns.truths):
        near = {robot: _nearly(dataset, unknowns, submap, robot) for robot in robots}
        spans = {robot: _span(dataset, submap, robot) for robot in robots}
        found |= truth_clocks(submap, spans, {r: late for r, late in near.items() if late is not None}, truth_by)
    if not found:
        return dataset, found
    return replace(dataset, truth=truth_by({robot: late.clock for robot, late in found.items()})), found


def _homes(joined: Joined, robots: Iterable[int]) -> list[tuple[Submap, list[int]]]:
    """The maps in which most of the ways of some robots are, and those of each."""
    home = {robot: max(joined.maps, key=lambda map: len(map.trajectory_keys(robot))) for robot in robots}
    return [(map, own) for map in joined.maps if (own := [robot for robot, at in home.items() if at is map])]


def _nearly(dataset: Dataset, unknowns: Unknowns, submap: Submap, robot: int) -> float | None:
    """How late a robot's truth is about [s], by places alone; None where these do not tell."""
    ticks, true = unknowns.truths[robot]
    keys, dim, since = submap.trajectory_keys(robot), dataset.robots[robot], ticks[0]
    stamps, true_stamps = ((at - since) * dataset.names.tick_s for at in (index_of(keys), ticks))
    late = late_truth(stamps, submap.all_values.positions(keys, dim), true_stamps, true[:, :dim])
    return None if late is None else late.value_s


def _span(dataset: Dataset, submap: Submap, robot: int) -> tuple[int, float]:
    """The middle of a robot's way in a map [ticks], and its length [s]."""
    ticks = index_of(submap.trajectory_keys(robot))
    return int(ticks[0] + ticks[-1]) // 2, float(ticks[-1] - ticks[0]) * dataset.names.tick_s
