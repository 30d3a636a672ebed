"""A robot by itself: which mistake in its odometry or its sightings makes them contradict each other.

screen: every mistake that its tables may hold, and its clock, by what two looks at a landmark say of it (see `looks`)
try:    the stretch where these fit worst, solved without each of the few that they speak for; the likelihood decides
tell:   a mistake counts where the stretch fits without it. What fits as well is told with it: a robot that sees all
        things mirrored cannot know whether its eyes are wrong or its wheels

What it costs does not grow with the log: at most TRIED + 1 stretches are solved of a robot, and none where the looks
speak for nothing.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from teamslam.model import Dataset, Table
from teamslam.trust.causes.clocks import LEAST, earlier, offset, taken_earlier, usual_step
from teamslam.trust.causes.frames import points_of, with_points_seen_from_it, with_steps_in_its_axes
from teamslam.trust.causes.looks import Looks, off, unlikely
from teamslam.trust.causes.pairs import Closing
from teamslam.trust.causes.slips import slips, without, written
from teamslam.trust.causes.trial import Trial
from teamslam.trust.causes.turns import with_turns_in_radians

TRIED = 6  # mistakes, the likeliest
LIKELY = 0.3  # of the gain of the likeliest, that another has which is tried
LEFT = 0.85  # of how far triangles are off, without a mistake that is tried
SUSPECT = 1.3  # times the expected cost: a stretch that costs less needs no explanation
POORLY = 3.0  # and in a log that fits poorly anyway, of which the looks speak plainly
COLLAPSED = 0.1  # times the expected cost: a stretch that costs less was shrunk to nothing, which explains nothing
EXPLAINED = 0.8  # of a stretch's excess, at least: of all, or of that but for outliers far off
SURE = 16.0  # of -2 log likelihood: four sigmas between the best mistake and none
LIKE = 40.0  # of it: what is told with the best, as noise is not quite what is stated


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake in the logs of some robots: `source` and `looks` of what holds it, `mend` takes it out of any part of
    their logs; `unit` is log f of all numbers that it changes, `changes` as of a slip; `amount` [ticks], where it has
    one, is what {} in `looks` stands for."""

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


def mistake_of(log: Dataset, robot: int, left: float = LEFT) -> Found | None:
    """The mistake that makes one robot's own log contradict itself; None where it does not, or none explains it. Tried
    are those without which triangles are off by less than a share `left` of what they are."""
    looks = Looks.of(log, robot)
    suspected = suspects(looks, left) if looks is not None else []
    stretch = looks.worst() if looks is not None and suspected else None
    if stretch is None:
        return None
    as_it_is = Trial.of(stretch)
    if as_it_is.loudness < SUSPECT:
        return None
    tried = [(mistake, Trial(mistake.mend(as_it_is.log))) for mistake in suspected]
    good = [(mistake, trial) for mistake, trial in tried if trial.ratio < POORLY]
    found = likeliest(as_it_is, as_it_is.expected, good)
    if found is None or found.explains > EXPLAINED:
        return found
    rest = next(trial.bulk for mistake, trial in good if mistake is found.alternatives[0])
    return found if as_it_is.bulk - rest > EXPLAINED * (as_it_is.bulk - as_it_is.expected) > 0.0 else None


def suspects(looks: Looks, left: float = LEFT) -> list[Mistake]:
    """The mistakes that the looks of a robot speak for, at most TRIED, the likeliest first."""
    before = off(looks.as_written)
    every = (*_of_tables(looks), *_of_turns(looks), *_of_frames(looks), *_of_clock(looks))
    found = [evidence for evidence in every if evidence.off < left * before]
    gains = sorted(found, key=lambda evidence: -evidence.gain)
    return [e.mistake for e in gains if e.gain > LIKELY * gains[0].gain][:TRIED]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the looks of a robot say of a mistake: by how much likelier they are without it, and how far their triangles
    are then off (`looks.off`)."""

    mistake: Mistake
    gain: float
    off: float


def _of_tables(looks: Looks) -> Iterator[Evidence]:
    """The slips that the robot's tables may hold."""
    tables = looks.log.tables
    for source, model in dict.fromkeys((table.source, table.model) for table in tables):
        mine = [table for table in tables if (table.source, table.model) == (source, model)]
        for name in names_of_slips(mine):
            mistake = slip_of(name, (looks.robot,), mine)
            counts = zip(tables, looks.pairs, strict=True)
            unit = sum(len(p) * written(t, name) for t, p in counts if (t.source, t.model) == (source, model))
            yield from _supported(looks, mistake, looks.meant(mistake.mend(looks.log)), unit)


def _of_turns(looks: Looks) -> Iterator[Evidence]:
    """Turns of odometry in degrees."""
    robot = looks.robot
    meant = with_turns_in_radians(looks.log, robot)
    turned = sum(len(new) for new, old in zip(meant.tables, looks.log.tables, strict=True) if new is not old)
    if turned:
        unit = turned * float(np.log(np.pi / 180.0))
        change = partial(with_turns_in_radians, robot=robot)
        mistake = Mistake((robot,), "odometry", "degrees", "turns are in degrees", change, unit)
        yield from _supported(looks, mistake, looks.meant(meant), 0.0)


def _of_frames(looks: Looks) -> Iterator[Evidence]:
    """Steps, or points that were seen, in the frame of the odometry in place of the robot's."""
    robot = looks.robot
    steps = "steps are written in axes that do not turn with the robot"
    points = "places are those in the frame of its odometry, and not as seen from the robot"
    read: list[tuple[str, str, Callable[[Dataset], Dataset]]] = [
        ("odometry", steps, partial(with_steps_in_its_axes, robot=robot)),
        *(
            (of, points, partial(with_points_seen_from_it, robot=robot, source=of))
            for of in points_of(looks.log, robot)
        ),
    ]
    for source, said, mend in read:
        meant = mend(looks.log)
        if any(new is not old for new, old in zip(meant.tables, looks.log.tables, strict=True)):
            yield from _supported(looks, Mistake((robot,), source, "axes", said, mend), looks.meant(meant), 0.0)


def _of_clock(looks: Looks) -> Iterator[Evidence]:
    """Sightings that are stamped late or early for the odometry."""
    chain, robot = looks.log.pose_keys[looks.robot], looks.robot

    def closings(ticks: float) -> list[Closing]:
        return looks.by(replace(looks.way, poses=taken_earlier(chain, looks.way.poses, ticks)))

    ticks = offset(chain, lambda ticks: unlikely(closings(ticks)))
    if abs(ticks) > LEAST * usual_step(chain):
        said = f"stamps are {{}} {'late' if ticks > 0.0 else 'early'} for the odometry"
        mistake = Mistake(
            (robot,), "sightings", "clock", said, partial(earlier, robot=robot, ticks=ticks), amount=ticks
        )
        yield from _supported(looks, mistake, closings(ticks), 0.0)


def _supported(looks: Looks, mistake: Mistake, closings: Sequence[Closing], unit: float) -> Iterator[Evidence]:
    """The evidence for a mistake, if the looks are surely likelier without it."""
    gain = looks.gain(closings) + 2.0 * unit
    if gain > SURE:
        yield Evidence(mistake, gain, off(closings))


def names_of_slips(tables: Sequence[Table]) -> list[str]:
    """The slips that some tables of one sensor may hold."""
    held = ((table, slip) for table in tables for slip in slips(table.model, table.dim))
    return list(dict.fromkeys(slip.name for table, slip in held if not (slip.of_eyes and table.is_odometry)))


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

    unit = sum(rows * slip.written for rows, slip in found)
    return Mistake(robots, source, first.kind, first.looks, mend, unit, first.changes)


def likeliest(as_it_is: Trial, due: float, tried: Sequence[tuple[Mistake, Trial]]) -> Found | None:
    """The likeliest of the mistakes that were tried on a stretch that is `due` to cost less than it does, with those
    that are about as likely; None where none is surely likelier than that there is none."""
    extent = next((t.extent for t in (as_it_is, *(t for _, t in tried)) if t.optima), 1.0)
    rank = {id(m): trial.unlikely(extent) - 2.0 * m.unit for m, trial in tried}
    best, trial = min(tried, key=lambda t: (rank[id(t[0])], t[0].changes), default=(None, None))
    if best is None or trial is None or not np.isfinite(rank[id(best)]) or trial.cost < COLLAPSED * due:
        return None
    sure = SURE * trial.loudness  # noise that is larger than stated decides as much less
    most = rank[id(best)] + sure
    if as_it_is.unlikely(extent) < most:
        return None
    near = [m for m, _ in tried if rank[id(m)] < rank[id(best)] + LIKE * trial.loudness]
    least = min(m.changes for m in near)
    each = {m.key: m for m in near if m.changes == least}
    order = sorted(each.values(), key=lambda m: (m.source, m.kind, m.looks))
    return Found(tuple(order), as_it_is.cost, trial.cost, due)
