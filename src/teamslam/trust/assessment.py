"""How far a map is to be believed: the one door by which a run asks.

    verdict      how well the map fits the log, and what a misfit looks like
    wrong        the sightings that look wrong; of a map that does not fit, those that are
    suspicions   names of landmarks that lie, robots that contradict the others
    weak         of each component what it does not know, and what it knows least; where that is something, which
                 sightings would firm it up, once somebody asks

All of it, and how exact a join is, reads the log at the map as it was linearised and factorised there once (`AtMap`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from teamslam.errors import SolveError, TeamslamError
from teamslam.joining import AtMap, Joined, build, split
from teamslam.model import Dataset, Submap, Table
from teamslam.trust.cause import Cause
from teamslam.trust.fit import Verdict, verdict
from teamslam.trust.outliers.glance import Wrong, fits_of, looks_wrong
from teamslam.trust.outliers.words import LARGER
from teamslam.trust.suspicions import Suspicions, suspicions
from teamslam.trust.weak import Weak, knowledge_at, weakest_of
from teamslam.trust.weak.eyes import eyes_of
from teamslam.trust.weak.sightings import Sighting, look_next


@dataclass(frozen=True, eq=False)
class Assessment:
    """What speaks for a map and against it. `suspicions` are None where nobody looked; `weak` has one for each
    component, None where its measurements do not determine it; `tables` the rows that are in each; `wrong` which of
    these look wrong, None where such were left out already."""

    verdict: Verdict
    suspicions: Suspicions | None
    weak: tuple[Weak | None, ...]
    tables: tuple[Sequence[Table], ...] = field(default=(), repr=False)
    wrong: Wrong | None = None

    @cached_property
    def sightings(self) -> tuple[tuple[Sighting, ...], ...]:
        """Of each component the sightings that would firm up most what is weak or open in it, the best first; none
        where nothing is."""
        return tuple(
            look_next(weak, eyes_of(rows, weak.known.values)) if weak and (weak.open or weak.directions) else ()
            for weak, rows in zip(self.weak, self.tables, strict=True)
        )

    def __repr__(self) -> str:
        return f"Assessment({self.verdict!r})"


def assess(
    log: Dataset,
    submaps: Sequence[Submap],
    joined: Joined,
    at: Sequence[AtMap],
    *,
    judged: Verdict | None = None,
    stated: Sequence[Table] | None = None,
    known: Suspicions | None = None,
    seen: Suspicions | None = None,
    rejecting: bool = False,
    probability: float | None = None,
    stage: Callable[[str], None] = lambda name: None,
) -> Assessment:
    """How far the map of a log is to be believed; `at`: the log at each component's map.

    `submaps`: what it was joined of; without any (full least squares) nobody is suspected. Who lies is judged by the
    log without the mistakes that were found in it: what they explain speaks against nobody. `judged`: the verdict on
    this very log at these maps, where somebody asked before. `known`: suspicions that there were before the log was
    changed; `seen`: those of this very log, where somebody asked before. `rejecting`: wrong sightings were left out of
    the log; where not, `probability` is that one is wrong (None: by the data). `stage` hears what is looked at next.
    """
    stage("verdict on the fit")
    judged = verdict(log, joined, at, stated=stated) if judged is None else judged
    wrong = None
    if not rejecting:
        fits = not judged.gross or any(cause.is_mistake for cause in judged.causes)
        wrong = looks_wrong(log, judged.rows, fits=fits, probability=probability)
        judged = _told_by(judged, wrong)
    suspected = known
    if known is None and submaps:
        stage("suspicions")
        suspected = suspected_beside(judged.causes, log, submaps, joined, seen)
        if suspected is not None and wrong is not None and not judged.gross:
            suspected = suspected.beside(fits_of(wrong.glance), submaps)
    stage("weak directions")
    return Assessment(judged, suspected, tuple(map(_weak, at)), tuple(each.tables for each in at), wrong)


def suspected_beside(
    causes: Sequence[Cause],
    log: Dataset,
    submaps: Sequence[Submap],
    joined: Joined,
    seen: Suspicions | None = None,
) -> Suspicions | None:
    """Who and what is suspicious beside causes that explain a misfit: each that can be taken out of the log is, and the
    rest is judged. Nobody is accused of what may be left of his own cause, and that nobody can say who is wrong is not
    said: somebody could. None where nothing can be made of the rest. `seen`: what is suspicious without any cause."""
    mends = [cause.mend for cause in causes if cause.mend is not None]
    if not mends:
        return suspicions(log, submaps, joined) if seen is None else seen
    try:
        for mend in mends:
            log = mend(log)
        found = suspicions(log, [build(piece) for piece in split(log)])
    except TeamslamError:
        return None
    named = {robot for cause in causes if cause.kind not in ("landmark", "size", "outliers") for robot in cause.robots}
    return replace(
        found,
        labels=tuple(label for label in found.labels if label.change.robot not in named),
        mistaken=tuple(each for each in found.mistaken if each.by not in named),
        judgement=found.judgement if set(found.liars) - named else None,
    )


def _told_by(judged: Verdict, wrong: Wrong) -> Verdict:
    """A verdict in which wrong sightings that were found stand for what noise would explain instead."""
    found = wrong.decisions
    if found is None or any(sensor.noise >= LARGER for sensor in found.sensors):
        return judged
    robots = tuple(sorted({sensor.robot for sensor in found.sensors if sensor.rejected}))
    wrong_ones = "1 sighting is" if found.rejected == 1 else f"{found.rejected:,} sightings are"
    said = f"{wrong_ones} wrong, and noise as stated explains the others; --reject leaves them out"
    cause = Cause("outliers", said, 1.0, robots, found.without_scattered)
    return replace(judged, causes=(cause, *(c for c in judged.causes if c.kind not in ("sigma", "outliers"))))


def _weak(at: AtMap) -> Weak | None:
    try:
        return weakest_of(knowledge_at(at))
    except SolveError:
        return None
