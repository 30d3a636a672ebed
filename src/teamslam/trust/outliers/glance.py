"""Which sightings look wrong at a map that was made of all of them: a look at residuals that are there already.

Each sensor's gate (`gates`) is found as where sightings are rejected: noise by the median of its residuals, the share
that is wrong by what is beyond the gate, in turn. A map that wrong sightings bend hides some of them, and throws doubt
on right ones: of few that are wrong this counts several times as many. So nothing is left out by it; `decide` finds
which are wrong, with the map made anew.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.model import Dataset, Names, Table, index_of, is_landmark
from teamslam.trust.cause import rows_called
from teamslam.trust.evidence import Fit
from teamslam.trust.outliers.decide import Decisions, wrong_sightings
from teamslam.trust.outliers.gates import LARGEST, gates, noise_of, share_wrong
from teamslam.trust.outliers.words import in_brackets, sentences_on_sightings
from teamslam.trust.residuals import Rows

ROUNDS = 3
LONG = 20_000  # sightings of a log that are looked at once only
ADRIFT = 0.75  # of a landmark's sightings look wrong: no place fits it,
OFTEN = 6  # of so many at least
UNCLEAR = (
    "most of what a sensor saw is far off at this map, so nobody can tell which sightings are wrong: look for sigmas "
    "that are too small, or for one mistake in all of its rows, or in the odometry beside them"
)


@dataclass(frozen=True, eq=False)
class Glance:
    """Of so many `rows` of one sensor of a robot, those that look wrong: `which`, and what they `cost` at the map."""

    robot: int
    source: str
    rows: int
    which: Table = field(repr=False)
    cost: float

    @property
    def wrong(self) -> int:
        """How many look wrong."""
        return len(self.which)


def at_a_glance(residuals: Sequence[Rows]) -> tuple[Glance, ...]:
    """The sensors of which sightings look wrong, by what all rows leave at a map.

    Law: of noise as stated, or larger by one factor for a sensor, hardly any row looks wrong (less than one of 10,000).
    """
    found = (_of(rows) for rows in residuals if rows.table.source != "odometry")
    return tuple(glance for glance in found if glance.wrong)


def _of(rows: Rows) -> Glance:
    table, wrong, beyond = rows.table, 0, np.zeros(len(rows.table), bool)
    for _ in range(ROUNDS):
        share = share_wrong(wrong, len(table))
        limits = gates(table, share, noise_of(rows.squared, rows.numbers, wrong / max(len(table), 1)))
        beyond = rows.squared > limits
        before, wrong = wrong, int(beyond.sum())
        if wrong == before:
            break
    return Glance(table.robot, table.source, len(table), table.select(beyond), float(rows.cost[beyond].sum()))


def sentences_at_a_glance(found: Sequence[Glance], names: Names) -> Iterator[str]:
    """How many sightings of each sensor look wrong, the largest share first; which, where they are few."""
    for glance in sorted(found, key=lambda glance: (-glance.wrong / glance.rows, glance.robot)):
        counted = (
            f"{glance.wrong:,} of {glance.rows:,} {rows_called(glance.source)} of robot {names.robot(glance.robot)}"
            f"{f', {glance.which.called}' if glance.which.called else ''}"
        )
        yield counted + in_brackets(glance.which.keys, names)


def fits_of(found: Sequence[Glance]) -> dict[int, Fit]:
    """By robot, what its rows that look wrong cost, and how many numbers they are."""
    fits: dict[int, Fit] = {}
    for glance in found:
        held = fits.get(glance.robot, Fit(0.0, 0))
        fits[glance.robot] = Fit(held.cost + glance.cost, held.dof + glance.which.dof)
    return fits


@dataclass(frozen=True)
class Adrift:
    """Landmarks `marks` (keys) that no place fits: of their `rows` sightings so many look `wrong`."""

    marks: tuple[int, ...]
    wrong: int
    rows: int

    def sentence(self, names: Names) -> str:
        """Which, and what that may be."""
        called = [names.landmark(int(index_of(mark))) for mark in self.marks]
        several = len(called) > 1
        which = f"landmarks {', '.join(called[:-1])} and {called[-1]}" if several else f"landmark {called[0]}"
        they, their, them = ("they", "their names", "them") if several else ("it", "its name", "it")
        return (
            f"no place fits {which}, {self.wrong:,} of {self.rows:,} sightings look wrong: {they} moved all the time "
            f"(on a robot, or carried about), {their} stood at many places, or what is stated of {them} is wrong"
        )


def adrift(residuals: Sequence[Rows], found: Sequence[Glance]) -> Adrift | None:
    """The landmarks nearly all sightings of which look wrong, whoever saw them; None where there are none."""
    seen = [rows.table.keys[:, -1] for rows in residuals if rows.table.source != "odometry"]
    marks, rows = np.unique(np.concatenate([np.zeros(0, np.int64), *seen]), return_counts=True)
    wrong = np.zeros(len(marks), np.int64)
    for glance in found:
        np.add.at(wrong, np.searchsorted(marks, glance.which.keys[:, -1]), 1)
    lost = is_landmark(marks) & (rows >= OFTEN) & (wrong >= ADRIFT * rows)
    if not lost.any():
        return None
    return Adrift(tuple(marks[lost].tolist()), int(wrong[lost].sum()), int(rows[lost].sum()))


@dataclass(frozen=True, eq=False)
class Wrong:
    """Sightings that look wrong at a map that was made of all of them, by a `glance`, and landmarks that no place fits
    (`adrift`); where the map does not fit, `decisions` on which they are, made of `log`, unless that is `unclear`: most
    of what was seen is far off. Nothing was left out."""

    glance: tuple[Glance, ...]
    names: Names
    adrift: Adrift | None = None
    log: Dataset | None = None
    decisions: Decisions | None = None
    unclear: bool = False

    def sentences(self) -> Iterator[str]:
        """How many of which sensors."""
        if self.unclear:
            yield UNCLEAR
            return
        if self.decisions is not None:
            yield from sentences_on_sightings(self.decisions)
        else:
            yield from sentences_at_a_glance(self.glance, self.names)
        if self.adrift is not None:
            yield self.adrift.sentence(self.names)


def looks_wrong(log: Dataset, residuals: Sequence[Rows], *, fits: bool, probability: float | None = None) -> Wrong:
    """What looks wrong of a log by what it leaves at its map; where that does not fit at all (`fits`), and it is no
    very long log, found as it would be to leave it out. `probability`: that a sighting is wrong; None: by the data."""
    glance = at_a_glance(residuals)
    found = Wrong(glance, log.names, adrift=adrift(residuals, glance))
    sightings = sum(len(table) for table in log.tables if table.source != "odometry")
    if fits or not found.glance or sightings > LONG:
        return found
    try:
        decisions = wrong_sightings(log, probability=probability)
    except TeamslamError:
        return found
    if _most_are_far_off(decisions):
        return replace(found, adrift=None, unclear=True)
    return replace(found, log=log, decisions=decisions) if decisions.rejected else found


def _most_are_far_off(found: Decisions) -> bool:
    """Whether most of all sightings would be wrong, or the noise of what is left of a sensor is larger than is looked
    for: what supposes that most are right tells nothing then."""
    rows = sum(sensor.rows for sensor in found.sensors)
    return 2 * found.rejected > rows or any(sensor.noise >= LARGEST for sensor in found.sensors)
