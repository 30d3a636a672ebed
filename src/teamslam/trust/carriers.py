"""What carries the excess of a cost, in words: sensors, landmarks, stretches of time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.model import Names
from teamslam.trust.residuals import Rows
from teamslam.trust.tally import Stretches, Tally, by_landmark, by_sensor, by_stretch, whole

MOST = 3  # of each kind that are named
WORTH = 0.05  # of the excess: what carries less is not named
NOTABLE = {"sensor": 1.5, "landmark": 2.0, "stretch": 2.0}  # times the expected cost
ALL = 0.5  # of a robot's time: a longer stretch is the robot
APART = 2.0  # times the whole's: what is as bad as everything else says nothing of where to look


@dataclass(frozen=True)
class Share:
    """A part of a log: its `rows`, what they cost and should, and its share of all that is too much (`excess`)."""

    kind: str
    what: str
    rows: int
    cost: float
    expected: float
    excess: float

    @property
    def ratio(self) -> float:
        """Cost over expected cost; a part with less than one number to spare counts as one."""
        return self.cost / max(self.expected, 1.0)


def sensor_shares(rows: Sequence[Rows], names: Names) -> list[Share]:
    """Every sensor of every robot, in order."""
    tally, kinds = by_sensor(rows)
    words = [f"robot {names.robot(robot)}: {source} ({model})" for robot, source, model in kinds]
    return _shares("sensor", tally, [words[label] for label in tally.labels.tolist()])


def carriers(rows: Sequence[Rows], names: Names) -> Iterator[Share]:
    """The parts that cost notably more than they should, the most of each kind first; landmarks and stretches where
    they stand out."""
    yield from _worst(sensor_shares(rows, names))
    least = APART * float(whole(rows).ratio[0])
    marks = by_landmark(rows)
    seen = _shares("landmark", marks, [f"landmark {names.landmark(key)}" for key in marks.labels.tolist()])
    yield from _worst([share for share in seen if share.ratio > least])
    yield from _worst([share for share in _stretches(rows, names) if share.ratio > least])


def _shares(kind: str, tally: Tally, words: Sequence[str]) -> list[Share]:
    surplus = float(np.maximum(tally.excess, 0.0).sum()) or 1.0
    numbers = zip(tally.rows.tolist(), tally.cost.tolist(), tally.expected.tolist(), strict=True)
    return [
        Share(kind, what, count, cost, expected, max(cost - expected, 0.0) / surplus)
        for what, (count, cost, expected) in zip(words, numbers, strict=True)
    ]


def _worst(shares: Sequence[Share]) -> list[Share]:
    notable = [s for s in shares if s.ratio > NOTABLE[s.kind] and s.excess > WORTH]
    return sorted(notable, key=lambda s: -s.excess)[:MOST]


def _stretches(rows: Sequence[Rows], names: Names) -> list[Share]:
    """Runs of neighbouring stretches of one robot that cost notably too much, each as one."""
    found = by_stretch(rows)
    tally = found.tally
    hot = tally.high & (tally.ratio > NOTABLE["stretch"])
    surplus = float(np.maximum(tally.excess, 0.0).sum()) or 1.0
    shares = []
    for run in _runs(tally.labels, hot, found.robots):
        if len(run) > ALL * np.count_nonzero(found.robots == found.robots[run[0]]):
            continue
        part, first = tally.select(run), int(tally.labels[run[0]])
        last = int(tally.labels[run[-1]])
        span = _span(found, first, last, names)
        what = f"robot {names.robot(int(found.robots[run[0]]))}: {span}"
        cost, expected = float(part.cost.sum()), float(part.expected.sum())
        shares.append(Share("stretch", what, int(part.rows.sum()), cost, expected, (cost - expected) / surplus))
    return shares


def _runs(labels: IntArray, hot: BoolArray, robots: IntArray) -> list[IntArray]:
    """Places of hot groups, those of one robot that follow each other together."""
    places = np.flatnonzero(hot)
    if not len(places):
        return []
    apart = (np.diff(labels[places]) != 1) | (np.diff(robots[places]) != 0)
    return np.split(places, np.flatnonzero(apart) + 1)


def _span(found: Stretches, first: int, last: int, names: Names) -> str:
    start, stop = found.since_start(first), found.since_start(last) + found.width
    if names.tick_s == 1.0:
        return f"poses {found.start + start:.0f} to {found.start + stop:.0f}"
    return f"{start * names.tick_s:.1f} to {stop * names.tick_s:.1f} s after the start"
