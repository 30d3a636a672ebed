"""Mistakes that show only between robots: each by itself is consistent, and together they are not.

    in sightings of robots    the slips of their tables, by one robot or by all
    in a whole robot          all its lengths in another unit, all it sees and does mirrored, its clock behind

A stretch of the team's log is solved with and without each, in a round at most TRIED_A_ROBOT for each robot, and none
any more once TRUSSES_A_ROBOT trusses were solved for each; none where the residuals at the map leave no room for a
mistake. Sightings of robots are first looked at from where the landmarks alone put the robots, where they do: there
nothing is bent by the sightings in question.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, zip_longest

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Dataset, Table, Values, is_landmark, is_pose, robot_of, told_by
from teamslam.trust.causes.alone import (
    Found,
    Mistake,
    likeliest,
    names_of_slips,
    slip_of,
)
from teamslam.trust.causes.clocks import LEAST, at_other_times, least_bad, usual_step
from teamslam.trust.causes.looks import own
from teamslam.trust.causes.retime import with_clock_ahead
from teamslam.trust.causes.slips import MIRRORED, TOO, UNITS, without, written
from teamslam.trust.causes.trial import Trial, log_determinant
from teamslam.trust.residuals import Rows
from teamslam.trust.tally import whole

TRIED, TRIED_BLINDLY = 2, 5  # slips of one sensor
LIKELY = ("sign", "direction", "degrees", "unit", "axes")  # what is tried first, where nothing says more
MOST_ROBOTS = 3  # that are suspected one by one
TRIED_A_ROBOT, MOST_TRIED = 5, 20  # mistakes, of a round: for each robot of the stretch, and in all
TRUSSES_A_ROBOT = 2  # of a round: half as many as one join may solve
ROUNDS = 2  # mistakes that are sought, one after the other
GAIN = 0.3  # of the excess, that each must take away
FITS = 2.0  # times the expected cost: what costs more between robots is not explained
EXCESS = 50.0  # of cost, between robots: what is less needs no explanation
SHOWS = 5.0  # times what is due, that a whole robot mirrored, or in another unit, costs at least
FEWEST_SHARED = 4  # landmarks of two maps that tell of their shapes
NEAR_UNIT = 0.4  # of log f: how near a unit that must be; feet are 1.2 from metres
MIRROR = 0.5  # of the squared distances that are left, in a mirror
HALF_OFF = 2.0  # times the median of chi-square: squared residuals of half the rows of a sensor
OFFSETS = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Of a robot's clock, in usual steps between poses: those that are tried first, `BLINDLY` many where each is a solve.
One that is off by more than the last is told to be off by less than it is."""
BLINDLY = 3


def mistakes_between(stretch: Dataset, order: Sequence[int]) -> list[Found]:
    """The mistakes between robots that explain a stretch of the team's log, robots being suspected in `order`; none
    where it costs no more than its robots do by themselves, or where even all together do not explain it."""
    found: list[Found] = []
    team = _Team.of(Trial.of(stretch))
    if not np.isfinite(team.due):
        return []  # a robot that contradicts itself, for no reason known
    most = min(TRIED_A_ROBOT * len(team.alone), MOST_TRIED)
    for _ in range(ROUNDS):
        if not team.disagrees:
            return found
        trusses = TRUSSES_A_ROBOT * len(team.alone)
        tried = list(_affordable(islice(_tried(team, list(order)[:MOST_ROBOTS]), most), trusses))
        best = likeliest(team.trial, team.due, tried)
        if best is None or best.explains < GAIN:
            return []
        found.append(best)
        team = replace(team, trial=Trial(best.alternatives[0].mend(team.trial.log)))
    return [] if team.disagrees else found


@dataclass(frozen=True, eq=False)
class _Team:
    """A stretch of the team's log, each robot's part of it by itself, and what the whole is `due` to cost: the robots
    as much as they do by themselves, what is between them as it should."""

    trial: Trial
    alone: dict[int, Trial]
    due: float

    @classmethod
    def of(cls, trial: Trial) -> "_Team":
        alone = {robot: Trial(own(trial.log, robot)) for robot in dict.fromkeys(t.robot for t in trial.log.tables)}
        between = trial.expected - sum(t.expected for t in alone.values())
        return cls(trial, alone, sum(t.cost for t in alone.values()) + max(between, 0.0))

    @property
    def disagrees(self) -> bool:
        """Whether the robots together cost notably more than they may."""
        links = sum(table.dof for table in self.trial.log.tables if table.observes_robots)
        return self.trial.cost >= FITS * self.due or self.trial.cost - self.due > max(EXCESS, links)


def may_disagree(rows: Sequence[Rows]) -> bool:
    """Whether the residuals at a team's map leave room for a mistake between robots: sightings of robots cost more than
    chance allows, or half of what some sensor measured is farther off than it should be, as where a robot has all in a
    mirror."""
    links = [r for r in rows if r.table.observes_robots]
    if links and bool(whole(links).high[0]) and float(whole(links).excess[0]) > EXCESS:
        return True
    halves = [float(np.median(r.typical)) for r in rows if len(r)]
    return max(halves, default=0.0) > HALF_OFF


def _affordable(tried: Iterable[tuple[Mistake, Trial]], trusses: int) -> Iterator[tuple[Mistake, Trial]]:
    """What is tried, the last of it that by which so many trusses have been solved."""
    for mistake, trial in tried:
        yield mistake, trial
        trusses -= trial.searched
        if trusses <= 0:
            return


def _tried(team: _Team, order: Sequence[int]) -> Iterator[tuple[Mistake, Trial]]:
    """The mistakes that may be between robots, the likeliest of each kind first, each with the stretch solved without
    it: near where the landmarks alone put the robots, where they do."""
    log = team.trial.log
    alone = Trial(without_links(log))
    seers = list(dict.fromkeys(t.robot for t in log.tables if t.observes_robots))
    groups = dict.fromkeys([tuple(seers), *((robot,) for robot in order if robot in seers)])
    linked = [robot for robot in order if any(t.observes_robots and robot in _who(t) for t in log.tables)]
    shown = order if team.trial.cost > SHOWS * team.due else ()
    kinds = [
        *(_of_sightings(log, alone.values, robots) for robots in groups),
        *(_of_clock(log, alone.values, robot) for robot in linked),
        *(_of_all(team, robot) for robot in shown),
    ]
    for some in zip_longest(*kinds):
        yield from ((m, Trial(m.mend(log), near=alone if m.source else None)) for m in some if m is not None)


def without_links(log: Dataset) -> Dataset:
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
        yield from sorted(found, key=lambda m: unlikely_at(m.mend(part).tables, blind) - 2.0 * m.unit)[:TRIED]


def unlikely_at(tables: Sequence[Table], values: Values) -> float:
    """-2 log of how likely rows are where all is known."""
    return cost_at(tables, values) - 2.0 * sum(map(log_determinant, tables))


def cost_at(tables: Iterable[Table], values: Values) -> float:
    """Of the rows whose poses are known."""
    return sum(table.cost(values) for table in told_by(tables, values.layout))


def _of_all(team: _Team, robot: int) -> Iterator[Mistake]:
    """All that a robot measured in a mirror, or in another unit with its standard deviations (else it would contradict
    itself): what the landmarks tell that it and another have on maps of their own, or all where they tell nothing."""
    mine = team.alone.get(robot)
    others = [trial for other, trial in team.alone.items() if other != robot]
    seen = [shape for other in others if mine is not None and (shape := Shape.of(mine, other)) is not None]
    if not seen or sum(shape.mirrored for shape in seen) > 0.5 * len(seen):
        change = partial(_everywhere, robot=robot, name=MIRRORED)
        yield Mistake((robot,), "", "sign", "all is mirrored, left for right", change)
    longer = float(np.median([shape.longer for shape in seen])) if seen else 0.0
    for name, factor in UNITS.items():
        if not seen or abs(np.log(longer * factor)) < NEAR_UNIT:
            change = partial(_everywhere, robot=robot, name=f"{name} {TOO}")
            tables = [t for t in team.trial.log.tables if t.robot == robot]
            unit = sum(len(t) * written(t, f"{name} {TOO}") for t in tables)
            yield Mistake((robot,), "", "unit", f"all lengths are in {name}", change, unit)


@dataclass(frozen=True)
class Shape:
    """What the landmarks common to two maps look like in the one beside the other: how many times as far from each
    other, and whether in a mirror."""

    longer: float
    mirrored: bool

    @classmethod
    def of(cls, one: Trial, other: Trial) -> "Shape | None":
        """None where the maps have too few landmarks in common."""
        if one.values is None or other.values is None:
            return None
        keys = np.intersect1d(one.values.layout.keys, other.values.layout.keys)
        marks = keys[is_landmark(keys)]
        if len(marks) < FEWEST_SHARED:
            return None
        a, b = (v.positions(marks, 3) for v in (one.values, other.values))
        a, b = a - a.mean(0), b - b.mean(0)
        longer = float(np.sqrt(np.sum(a**2) / max(np.sum(b**2), 1e-300)))
        flat = min(np.ptp(a[:, 2]), np.ptp(b[:, 2])) == 0.0
        d = 2 if flat else 3
        u, s, v = np.linalg.svd(a[:, :d].T @ b[:, :d])
        turned = np.linalg.det(u @ v) > 0.0
        rest = float(np.sum(a**2) + longer**2 * np.sum(b**2))
        off = [rest - 2.0 * longer * float(s.sum() - 2.0 * s[-1] * flip) for flip in (not turned, turned)]
        return cls(longer, bool(off[1] < MIRROR * off[0]))


def _everywhere(log: Dataset, robot: int, name: str) -> Dataset:
    """A log without a slip in all that a robot measured."""
    return log.with_tables(without(table, name) if table.robot == robot else table for table in log.tables)


def _of_clock(log: Dataset, blind: Values | None, robot: int) -> Iterator[Mistake]:
    """A robot's clock ahead of the others' or behind: by what fits best where the landmarks put the robots; where these
    put them in no one map, by whole steps and halves."""
    usual = usual_step(log.pose_keys[robot])
    shares = OFFSETS if blind is not None else OFFSETS[:BLINDLY]
    tried = [sign * share * usual for share in shares for sign in (1.0, -1.0)]
    if blind is not None:
        tried = [least_bad(tried, lambda ticks: _cost_of_links(log, blind, robot, ticks))]
    for ticks in map(round, tried):
        if abs(ticks) > LEAST * usual:
            looks = f"clock is {{}} {'ahead of' if ticks > 0 else 'behind'} those of the others"
            change = partial(with_clock_ahead, robot=robot, ticks=ticks)
            yield Mistake((robot,), "", "clock", looks, change, amount=float(ticks))


def _cost_of_links(log: Dataset, values: Values, robot: int, ticks: float) -> float:
    """Of sightings of a robot by others, and of others by it, if its clock were so far ahead: those of poses beyond the
    ends of a way as much as the others."""
    links = [t for t in log.tables if t.observes_robots]
    of_it = [t.select(np.asarray(robot_of(t.keys[:, -1]) == robot)) for t in links if t.robot != robot]
    by_it = [t for t in links if t.robot == robot]
    others = [who for who in log.pose_keys if who != robot]
    sides = ((of_it, at_other_times(values, [robot], ticks)), (by_it, at_other_times(values, others, -ticks)))
    known = sum(table.dof for tables, there in sides for table in told_by(tables, there.layout))
    due = sum(table.dof for table in (*of_it, *by_it))
    return sum(cost_at(*side) for side in sides) * due / known if known else np.inf


def _who(table: Table) -> IntArray:
    return np.unique(robot_of(table.keys[is_pose(table.keys)]))
