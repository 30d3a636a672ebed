"""Mistakes that show only between robots: each by itself is consistent, and together they are not.

    in sightings of robots    the slips of their tables, by one robot or by all
    in a whole robot          all its lengths in another unit, all it sees and does mirrored, its clock behind

A stretch of the team's log is solved with and without each. What the best leave of sightings of robots is first looked
at from where the landmarks alone put the robots, where they do: there nothing is bent by the sightings in question.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Dataset, Table, Values, index_of, is_pose, robot_of
from teamslam.trust.causes.alone import (
    FITS,
    Found,
    Mistake,
    likeliest,
    names_of_slips,
    own,
    slip_of,
)
from teamslam.trust.causes.clocks import at_other_times, least_bad
from teamslam.trust.causes.retime import with_clock_ahead
from teamslam.trust.causes.slips import MIRRORED, TOO, UNITS, without
from teamslam.trust.causes.trial import Trial

TRIED, TRIED_BLINDLY = 2, 8  # slips of one sensor
LIKELY = ("sign", "direction", "degrees", "unit", "axes")  # what is tried first, where nothing says more
MOST_ROBOTS = 3  # that are suspected one by one
ROUNDS = 2  # mistakes that are sought, one after the other
GAIN = 0.3  # of the excess, that each must take away
EXCESS = 50.0  # of cost, between robots: what is less needs no explanation
SHOWS = 5.0  # times what is due, that a whole robot mirrored, or in another unit, costs at least
LEAST = 0.05  # of a usual step: a clock that is off by less is not worth a word
OFFSETS = (0.5, 1.0, 2.0)
"""Of a robot's clock, in usual steps between poses: those that are tried first."""


def mistakes_between(stretch: Dataset, order: Sequence[int]) -> list[Found]:
    """The mistakes between robots that explain a stretch of the team's log, robots being suspected in `order`; none
    where it costs no more than its robots do by themselves, or where even all together do not explain it."""
    found: list[Found] = []
    trial = Trial.of(stretch)
    due = _due(trial)
    if not np.isfinite(due):
        return []  # a robot that contradicts itself, for no reason known
    for _ in range(ROUNDS):
        if trial.cost < FITS * due and not _linked_badly(trial, due):
            return found
        tried = [(m, Trial(m.mend(trial.log))) for m in _suspects(trial, due, list(order)[:MOST_ROBOTS])]
        best = likeliest(trial.cost, due, tried)
        if best is None or best.explains < GAIN:
            return []
        found.append(best)
        trial = Trial(best.alternatives[0].mend(trial.log))
    return found if trial.cost < FITS * due and not _linked_badly(trial, due) else []


def _due(trial: Trial) -> float:
    """What a stretch may cost: its robots by themselves as much as they do, what is between them as it should."""
    alone = [Trial(own(trial.log, robot)) for robot in dict.fromkeys(table.robot for table in trial.log.tables)]
    return sum(t.cost for t in alone) + max(trial.expected - sum(t.expected for t in alone), 0.0)


def _linked_badly(trial: Trial, due: float) -> bool:
    """Whether the robots together cost notably more than they may."""
    links = sum(table.dof for table in trial.log.tables if table.observes_robots)
    return trial.cost - due > max(EXCESS, links)


def _suspects(trial: Trial, due: float, order: Sequence[int]) -> Iterator[Mistake]:
    log = trial.log
    blind = Trial(_without_links(log)).values
    seers = list(dict.fromkeys(t.robot for t in log.tables if t.observes_robots))
    for robots in dict.fromkeys([tuple(seers), *((robot,) for robot in order if robot in seers)]):
        yield from _of_sightings(log, blind, robots)
    for robot in order:
        if trial.cost > SHOWS * due:
            yield from _of_all_lengths(log, robot)
            change = partial(_everywhere, robot=robot, name=MIRRORED)
            yield Mistake((robot,), "", "sign", "all is mirrored, left for right", change)
        if any(t.observes_robots and robot in _who(t) for t in log.tables):
            yield from _of_clock(log, blind, robot)


def _without_links(log: Dataset) -> Dataset:
    """A log in which no robot sees another."""
    return log.with_tables(t for t in log.tables if not t.observes_robots)


def _of_sightings(log: Dataset, blind: Values | None, robots: tuple[int, ...]) -> Iterator[Mistake]:
    """The slips that sightings of robots may hold: the best where the landmarks put the robots, with the unit taken
    into account; the least, where these put them in no one map."""
    links = [t for t in log.tables if t.observes_robots and t.robot in robots]
    for source, model in dict.fromkeys((t.source, t.model) for t in links):
        mine = [t for t in links if (t.source, t.model) == (source, model)]
        found = [slip_of(name, robots, mine) for name in names_of_slips(mine)]
        if blind is None:
            yield from sorted(found, key=lambda m: (m.changes, LIKELY.index(m.kind)))[:TRIED_BLINDLY]
            continue
        part = log.with_tables(mine)
        yield from sorted(found, key=lambda m: _cost(m.mend(part).tables, blind) - 2.0 * m.unit)[:TRIED]


def _cost(tables: Iterable[Table], values: Values) -> float:
    """Of the rows whose poses are known."""
    known = [table.select(table.told_by(values.layout)) for table in tables]
    return sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in known)


def _of_all_lengths(log: Dataset, robot: int) -> Iterator[Mistake]:
    """All lengths that a robot measured in another unit, with their standard deviations: else it would contradict
    itself."""
    for name in UNITS:
        change = partial(_everywhere, robot=robot, name=f"{name} {TOO}")
        yield Mistake((robot,), "", "unit", f"all lengths are in {name}", change)


def _everywhere(log: Dataset, robot: int, name: str) -> Dataset:
    """A log without a slip in all that a robot measured."""
    return log.with_tables(without(table, name) if table.robot == robot else table for table in log.tables)


def _of_clock(log: Dataset, blind: Values | None, robot: int) -> Iterator[Mistake]:
    """A robot's clock ahead of the others' or behind: by what fits best where the landmarks put the robots; where these
    put them in no one map, by whole steps and halves."""
    chain = index_of(log.pose_keys[robot])
    usual = float(np.median(np.diff(chain))) if len(chain) > 1 else 1.0
    tried = [sign * share * usual for share in OFFSETS for sign in (1.0, -1.0)]
    if blind is not None:
        tried = [least_bad(tried, lambda ticks: _cost_of_links(log, blind, robot, ticks))]
    for ticks in map(round, tried):
        if abs(ticks) > LEAST * usual:
            looks = f"clock is {{}} {'ahead of' if ticks > 0 else 'behind'} those of the others"
            change = partial(with_clock_ahead, robot=robot, ticks=ticks)
            yield Mistake((robot,), "", "clock", looks, change, amount=float(ticks))


def _cost_of_links(log: Dataset, values: Values, robot: int, ticks: float) -> float:
    """Of sightings of a robot by others, and of others by it, if its clock were so far ahead."""
    links = [t for t in log.tables if t.observes_robots]
    of_it = [t.select(np.asarray(robot_of(t.keys[:, -1]) == robot)) for t in links if t.robot != robot]
    by_it = [t for t in links if t.robot == robot]
    others = [who for who in log.pose_keys if who != robot]
    return _cost(of_it, at_other_times(values, [robot], ticks)) + _cost(by_it, at_other_times(values, others, -ticks))


def _who(table: Table) -> IntArray:
    return np.unique(robot_of(table.keys[is_pose(table.keys)]))
