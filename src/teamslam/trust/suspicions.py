"""Who and what in a team is not to be believed: names of landmarks that lie, robots that contradict the others.

labels       the names that lie, sought first: a robot that exchanged two names is no liar
judgement    the robots that contradict the others once these are put right
mended       the log without either: names as they should be, and nothing of a robot that lies
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError, TeamslamError
from teamslam.geometry import IntArray
from teamslam.joining import Joined, build, join, separators, split
from teamslam.joining.condense.condense import condense_what_pays
from teamslam.model import Dataset, Names, Submap, Table, is_pose, robot_of
from teamslam.solver import Options, side_by_side
from teamslam.trust.evidence import Fit
from teamslam.trust.influence.alone import alone, self_contradicting
from teamslam.trust.influence.liars import LEVEL, Judgement, anybody_could_lie, liars, robot
from teamslam.trust.influence.words import sentences_on_robots
from teamslam.trust.labels.constellations import renamed
from teamslam.trust.labels.renaming import names_by, table_by
from teamslam.trust.labels.robots import Mistaken, mistaken_robots, put_right
from teamslam.trust.labels.search import Finding, mislabelled
from teamslam.trust.labels.words import sentence_on_label, sentence_on_mistaken

ROUGH = Options(max_iterations=100, decrement=0.01)  # what nobody keeps needs no more


@dataclass(frozen=True, eq=False)
class Suspicions:
    """What was found: names of landmarks that lie (`labels`), robots that are taken for others (`mistaken`), and who
    contradicts the others (`judgement`); what people call things is in `names`."""

    labels: tuple[Finding, ...]
    mistaken: tuple[Mistaken, ...]
    judgement: Judgement | None
    names: Names

    @property
    def liars(self) -> tuple[int, ...]:
        """The robots that lie."""
        return () if self.judgement is None else tuple(int(str(robot)) for robot in self.judgement.accused)

    @property
    def names_a_lie(self) -> bool:
        """Whether a name or a robot is told that lies."""
        return bool(self.labels or self.mistaken or self.liars)

    def beside(self, wrong: Mapping[int, Fit], submaps: Sequence[Submap]) -> "Suspicions":
        """Without robots whose own measurements contradict each other in nothing but what looks `wrong` of them one by
        one: what that costs, by robot."""
        if self.judgement is None or not self.judgement.themselves or not wrong:
            return self
        own = {name: fit.minus(wrong.get(int(str(name)), Fit(0.0, 0))) for name, fit in alone(submaps, robot).items()}
        still = self_contradicting(own, LEVEL)
        left = {name: chance for name, chance in self.judgement.themselves.items() if name in still}
        return replace(self, judgement=replace(self.judgement, themselves=left))

    def once_put_right(self, submaps: Sequence[Submap], joined: Joined) -> "Suspicions":
        """With what is known once the noise of the log is put right, of which these are the submaps and their map:
        where robots that contradicted each other, and nobody could say who is wrong, do so no more."""
        judged = self.judgement
        if judged is None or judged.accused or not judged.contradict:
            return self
        again = _judged(submaps, joined)
        if again is None or again.contradict or again.accused or again.alternatives:
            return self
        return replace(self, judgement=replace(judged, settled=True))

    def put_out(self) -> Iterator[str]:
        """Of each robot that lies what becomes of it where the log is `mended`."""
        for liar in self.liars:
            name = self.names.robot(liar)
            yield f"robot {name} was left out by --repair, with what others saw of it: it is in no map"

    def sentences(self) -> Iterator[str]:
        """All of it in words."""
        yield from (sentence_on_label(found, self.names) for found in self.labels)
        yield from (sentence_on_mistaken(found, self.names) for found in self.mistaken)
        if self.judgement is not None:
            yield from sentences_on_robots(self.judgement, self.names)


def suspicions(log: Dataset, submaps: Sequence[Submap], joined: Joined | None = None) -> Suspicions:
    """What is suspicious in a log and the submaps that were built of it, of which `joined` is the map; None where there
    is none yet."""
    joined = _map_of(submaps) if joined is None else joined
    mistaken = mistaken_robots(log, submaps, joined) if joined is not None else []
    if mistaken:
        submaps, joined = _built_again(log, submaps, mistaken), None
    if joined is None or _anybody_could_lie(submaps, joined):
        submaps = _spared(submaps)  # what follows may join many times
    judged = _judged(submaps, joined)
    excuses = mislabelled(submaps, of=[int(str(r)) for r in judged.accused]) if judged and judged.accused else []
    right = _put_right(submaps, excuses)
    judged = _judged(right, None) if excuses else judged
    guilty = {int(str(robot)) for robot in judged.accused} if judged else set[int]()
    honest = [submap for submap in right if int(robot_of(submap.base)) not in guilty]
    labels = [
        *(found for found in excuses if found.change.robot not in guilty),
        *mislabelled(honest, None if guilty or excuses else joined),
    ]
    if len(labels) > len(excuses):
        judged = _judged(_put_right(submaps, labels), None)
    return Suspicions(tuple(labels), tuple(mistaken), judged, log.names)


def _anybody_could_lie(submaps: Sequence[Submap], joined: Joined) -> bool:
    try:
        return anybody_could_lie(submaps, joined)
    except SolveError:
        return True  # as far as anybody knows


def _map_of(submaps: Sequence[Submap]) -> Joined | None:
    try:
        return join(submaps, options=ROUGH)
    except SolveError:
        return None


def _built_again(log: Dataset, submaps: Sequence[Submap], mistaken: Sequence[Mistaken]) -> list[Submap]:
    """The submaps with those of robots that take others for others built anew, with the right names."""
    who = {found.by for found in mistaken}
    tables = [put_right(table, log, mistaken) for table in log.tables if table.robot in who]
    try:
        again = [build(piece) for piece in split(log.with_tables(t for t in tables if len(t)))]
    except TeamslamError:
        return list(submaps)
    return [*(submap for submap in submaps if int(robot_of(submap.base)) not in who), *again]


def _judged(submaps: Sequence[Submap], joined: Joined | None) -> Judgement | None:
    """Who contradicts the others; None where there is nobody to contradict, or no map to judge by."""
    if len(submaps) < 2:
        return None
    joined = _map_of(submaps) if joined is None else joined
    try:
        return None if joined is None else liars(submaps, joined)
    except SolveError:
        return None


def mended(log: Dataset, found: Suspicions) -> Dataset:
    """A log with its names put right, and without the rows of robots that lie and those on them.

    Law: putting an exchange right twice is the log itself; a log without suspicions comes back as it is.
    """
    if not found.labels and not found.mistaken and not found.liars:
        return log
    tables = [put_right(table, log, found.mistaken) for table in log.tables]
    for finding in found.labels:
        tables = [table_by(finding.change, table) for table in tables]
    names = names_by([finding.change for finding in found.labels], log.names)
    tables = [_without(table, found.liars) for table in tables]
    team = {robot: dim for robot, dim in log.robots.items() if robot not in found.liars}
    return replace(log, robots=team, tables=tuple(table for table in tables if len(table)), names=names)


def _spared(submaps: Sequence[Submap]) -> list[Submap]:
    """The submaps without what nobody else can speak of, landmarks apart: what is asked here does not need it."""
    wanted = separators(submaps, landmarks=True)
    return side_by_side(lambda submap: _without_interiors(submap, wanted[submap.id]), submaps)


def _without_interiors(submap: Submap, wanted: IntArray) -> Submap:
    try:
        return condense_what_pays(submap, ~np.isin(submap.values.layout.keys, wanted))[0]
    except SolveError:
        return submap


def _put_right(submaps: Sequence[Submap], labels: Sequence[Finding]) -> list[Submap]:
    """Submaps with the names as they should be."""
    out = list(submaps)
    for found in labels:
        out = [renamed(s, found.change.names) if int(robot_of(s.base)) == found.change.robot else s for s in out]
    return out


def _without(table: Table, robots: Collection[int]) -> Table:
    if table.robot in robots:
        return table.select(np.zeros(len(table), bool))
    on_them = (is_pose(table.keys) & np.isin(robot_of(table.keys), list(robots))).any(1)
    return table.select(np.asarray(~on_them)) if on_them.any() else table
