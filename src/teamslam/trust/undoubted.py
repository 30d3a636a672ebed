"""Names that lie beyond doubt: of a landmark that one robot has elsewhere than all others, as where the number of a tag
was misread. One such row bends the map of all, and nothing that this robot measured contradicts it.

They are put right without being asked for; what is less sure is told, and left to people (`suspicions`).
"""

from collections.abc import Sequence
from math import log

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import BoolArray
from teamslam.joining import AtMap, Joined, build, join, split
from teamslam.model import Dataset, Submap, Table
from teamslam.trust.cause import Cause
from teamslam.trust.evidence import most_to_gain
from teamslam.trust.fit import mistakes
from teamslam.trust.influence.liars import fit_of
from teamslam.trust.labels.renaming import Renaming
from teamslam.trust.labels.search import Finding
from teamslam.trust.labels.words import sentence_on_label
from teamslam.trust.suspicions import Suspicions, suspicions

BEYOND_DOUBT = 12.0 * log(10.0)  # odds: a million times a million to one
KINDS = {"apart": "place", "mistaken": "name"}  # of changes, as causes are called


def named_beyond_doubt(
    dataset: Dataset, submaps: Sequence[Submap], joined: Joined, wrong: Sequence[Cause] = ()
) -> tuple[tuple[Cause, ...], Suspicions | None]:
    """The names in a log that lie beyond doubt, each with what puts it right, and all that is suspicious; None where
    nobody looked, since what joining cost leaves no room for such a name.

    `wrong`: the mistakes that were found in the log. A name that a mistake would explain as well is not told: it lies
    with them taken out of the log, too. Law: a team whose submaps agree comes back with nothing.
    """
    if len(submaps) < 2 or most_to_gain(fit_of(joined)) < 2.0 * BEYOND_DOUBT:
        return (), None
    suspected = suspicions(dataset, submaps, joined)
    found = [label for label in suspected.labels if _is_sure(label)]
    mends = [cause.mend for cause in wrong if cause.mend is not None]
    if found and mends:
        try:
            for mend in mends:
                dataset = mend(dataset)
            again = suspicions(dataset, [build(piece) for piece in split(dataset)]).labels
        except TeamslamError:
            return (), suspected
        still = {label.change for label in again if _is_sure(label)}
        found = [label for label in found if label.change in still]
    moved = _moved(dataset, found)
    return moved or tuple(_cause(label, suspected) for label in found), suspected


def _moved(dataset: Dataset, found: Sequence[Finding]) -> tuple[Cause, ...]:
    """The landmarks that were moved while robots saw them, told at the map without the sightings by which they are
    elsewhere: where a loss forgives, each robot may believe in another place, and nothing in its own map is wrong."""
    gone = [(label.change.robot, label.change.one) for label in found if label.change.kind == "apart"]
    if not gone:
        return ()
    try:
        kept = [table.select(~_names(table, gone)) for table in dataset.tables]
        rest = join([build(piece) for piece in split(dataset.with_tables(t for t in kept if len(t)))])
        at = [AtMap(dataset.tables, component.map) for component in rest.components]
        told = mistakes(dataset, rest, at)
    except TeamslamError:
        return ()
    return tuple(cause for cause in told if cause.kind == "landmark" and cause.mend is not None)


def _names(table: Table, which: Sequence[tuple[int, int]]) -> BoolArray:
    """The rows in which a robot sees a landmark of these."""
    hit = [table.keys[:, -1] == mark for robot, mark in which if robot == table.robot]
    return np.asarray(np.any([np.zeros(len(table), bool), *hit], axis=0))


def _is_sure(label: Finding) -> bool:
    return label.change.kind in KINDS and label.odds > BEYOND_DOUBT and not label.instead


def _cause(label: Finding, of: Suspicions) -> Cause:
    change = label.change
    said = sentence_on_label(label, of.names)
    return Cause(KINDS[change.kind], said, label.explains, (change.robot,), Renaming(change))
