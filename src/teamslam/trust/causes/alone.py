"""A robot by itself: which mistake in its odometry or its sightings makes them contradict each other.

rank:  every mistake that its tables may hold, by how well triangles of two looks and the odometry between them
       close without it (see `pairs`); of the stretch of its way where they close worst as it is
try:   that stretch solved without each of the best few, and with its clock put right; the likelihood decides
tell:  a mistake counts where the stretch fits without it. What fits as well is told with it: a robot that sees all
       things mirrored cannot know whether its eyes are wrong or its wheels
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.joining import split
from teamslam.model import Dataset, Table, index_of, is_landmark, robot_of
from teamslam.trust.causes.clocks import earlier, offset
from teamslam.trust.causes.pairs import misfit, pairs_of, way_of
from teamslam.trust.causes.slips import slips, without
from teamslam.trust.causes.trial import Trial
from teamslam.trust.causes.turns import with_turns_in_radians

POSES = 80  # of a stretch
STRETCHES = 4  # that are looked at
TRIED = 6  # mistakes of the best rank
FAR = 25.0  # of a triangle's misfit: what is more is as bad
FEWEST = 20  # triangles
SUSPECT = 1.3  # times the expected cost: a stretch that costs less needs no explanation
FITS = 2.0  # times the expected cost: a stretch that costs more is not explained
COLLAPSED = 0.1  # times the expected cost: a stretch that costs less was shrunk to nothing, which explains nothing
EXPLAINED = 0.8  # of a stretch's excess, at least
LEAST = 0.05  # of a usual step between poses: a clock that is off by less is not worth a word
SURE = 16.0  # of -2 log likelihood: four sigmas between the best mistake and another


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake in the logs of some robots: `source` and `looks` of what holds it, `mend` takes it out of any part of
    their logs; `unit` and `changes` as of a slip; `amount` [ticks], where it has one, is what {} in `looks` stands
    for."""

    robots: tuple[int, ...]
    source: str
    kind: str
    looks: str
    mend: Callable[[Dataset], Dataset]
    unit: float = 0.0
    changes: int = 1
    amount: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, bool]:
        """The same for the same mistake of other robots, whatever its amount."""
        return self.source, self.kind, "" if self.amount else self.looks, self.amount > 0.0


@dataclass(frozen=True, eq=False)
class Found:
    """A mistake that explains a stretch of log, with others that explain it as well; what the stretch cost, costs
    without it, and should cost."""

    alternatives: tuple[Mistake, ...]
    before: float
    after: float
    expected: float

    @property
    def explains(self) -> float:
        """The share of the stretch's excess that is gone without the mistake."""
        if not np.isfinite(self.before):
            return 1.0
        return float(np.clip((self.before - self.after) / max(self.before - self.expected, 1e-12), 0.0, 1.0))


def mistake_of(log: Dataset, robot: int) -> Found | None:
    """The mistake that makes one robot's own log contradict itself; None where it does not, or none explains it."""
    stretch = worst_stretch(own(log, robot), robot)
    if stretch is None:
        return None
    as_it_is = Trial.of(stretch)
    if as_it_is.ratio < SUSPECT:
        return None
    tried = [(mistake, Trial(mistake.mend(as_it_is.log))) for mistake in suspects(as_it_is, robot)]
    good = [(mistake, trial) for mistake, trial in tried if trial.ratio < FITS]
    found = likeliest(as_it_is.cost, as_it_is.expected, good)
    return found if found is not None and found.explains > EXPLAINED else None


def own(log: Dataset, robot: int) -> Dataset:
    """What a robot measured without the others: its odometry, and landmarks."""
    tables = [table for table in log.of_robot(robot).tables if not table.row.unary]
    mine = [((robot_of(t.keys) == robot) | is_landmark(t.keys)).all(1) for t in tables]
    kept = [table.select(rows) for table, rows in zip(tables, mine, strict=True)]
    return log.with_tables(table for table in kept if len(table))


def worst_stretch(log: Dataset, robot: int) -> Dataset | None:
    """The stretch of a robot's way, of those with most looks, where the triangles close worst; None without any."""
    pieces = split(log, poses_per_piece=POSES)
    looks = [sum(len(pairs_of(piece, robot, table)) for table in piece.tables) for piece in pieces]
    many = [pieces[n] for n in np.argsort(-np.array(looks), kind="stable")[:STRETCHES] if looks[n] >= FEWEST]
    return max(many, key=lambda piece: closing(piece, robot), default=None)


def closing(piece: Dataset, robot: int) -> float:
    """How badly triangles close on average, far ones as one; FAR where there is no way to be had."""
    try:
        way = way_of(piece, robot)
    except TeamslamError:
        return FAR
    off = np.concatenate([np.zeros(0), *(misfit(t, pairs_of(piece, robot, t), way) for t in piece.tables)])
    return float(np.mean(np.minimum(off, FAR))) if len(off) else 0.0


def suspects(as_it_is: Trial, robot: int) -> Iterator[Mistake]:
    """The mistakes to try on a stretch."""
    piece = as_it_is.log
    found = sorted(_of_tables(piece, robot), key=lambda mistake: closing(mistake.mend(piece), robot))
    yield from found[:TRIED]
    meant = with_turns_in_radians(piece, robot).tables
    if turned := [new for new, old in zip(meant, piece.tables, strict=True) if new is not old]:
        unit = sum(map(len, turned)) * float(np.log(np.pi / 180.0))
        change = partial(with_turns_in_radians, robot=robot)
        yield Mistake((robot,), "odometry", "degrees", "turns are in degrees", change, unit)
    try:
        ticks = offset(piece, robot, lambda log: closing(log, robot))
    except TeamslamError:
        return
    chain = index_of(piece.pose_keys[robot])
    if abs(ticks) > LEAST * float(np.median(np.diff(chain))):
        looks = f"stamps are {{}} {'late' if ticks > 0.0 else 'early'} for the odometry"
        change = partial(earlier, robot=robot, ticks=ticks)
        yield Mistake((robot,), "sightings", "clock", looks, change, amount=ticks)


def _of_tables(piece: Dataset, robot: int) -> Iterator[Mistake]:
    """The slips that the tables of a piece may hold."""
    for source, model in dict.fromkeys((table.source, table.model) for table in piece.tables):
        mine = [table for table in piece.tables if (table.source, table.model) == (source, model)]
        yield from (slip_of(name, (robot,), mine) for name in names_of_slips(mine))


def names_of_slips(tables: Sequence[Table]) -> list[str]:
    """The slips that some tables of one sensor may hold."""
    return list(dict.fromkeys(slip.name for table in tables for slip in slips(table.model, table.dim)))


def slip_of(name: str, robots: tuple[int, ...], tables: Sequence[Table]) -> Mistake:
    """A slip in the tables of one sensor of some robots, some of which are given."""
    found = [(len(t), slip) for t in tables for slip in slips(t.model, t.dim) if slip.name == name]
    first, source, model, links = found[0][1], tables[0].source, tables[0].model, tables[0].observes_robots

    def mend(log: Dataset) -> Dataset:
        def concerned(table: Table) -> bool:
            return (table.source, table.model, table.observes_robots) == (source, model, links)

        return log.with_tables(
            without(table, name) if table.robot in robots and concerned(table) else table for table in log.tables
        )

    unit = sum(rows * slip.unit for rows, slip in found)
    return Mistake(robots, source, first.kind, first.looks, mend, unit, first.changes)


def likeliest(before: float, due: float, tried: Sequence[tuple[Mistake, Trial]]) -> Found | None:
    """The likeliest of the mistakes that were tried on a stretch that costs `before` and is `due` to cost less, with
    those that are about as likely; None where none is surely likelier than that there is none."""
    rank = {id(m): trial.cost - 2.0 * m.unit for m, trial in tried}
    best, trial = min(tried, key=lambda t: (rank[id(t[0])], t[0].changes), default=(None, None))
    if best is None or trial is None or not np.isfinite(rank[id(best)]) or trial.cost < COLLAPSED * due:
        return None
    sure = SURE * max(trial.ratio, 1.0)  # noise that is larger than stated decides as much less
    most = rank[id(best)] + sure
    if before < most:
        return None
    near = sorted((m for m, _ in tried if rank[id(m)] < most), key=lambda m: -m.changes)
    each = {(m.robots, m.source, m.kind): m for m in near}
    least = {(m.robots, m.source): m.changes for m in near}  # of one sensor the least changes
    each = {key: m for key, m in each.items() if m.changes == least[m.robots, m.source]}
    order = sorted(each.values(), key=lambda m: (m.changes, m.source, m.kind))
    return Found(tuple(order), before, trial.cost, due)
