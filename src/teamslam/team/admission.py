"""Which submaps may be joined: bad ones are refused with the reason, the rest goes on.

    alone      damaged files, unknown versions, indefinite information, no base frame, numbers that are not finite
    together   two contents under one id and version, a landmark of two dimensions, names or clocks that contradict,
               and whatever would be counted twice: rows of a log in two submaps, one surveyed prior in several

Of submaps that exclude each other the one that excludes most goes first, so that one bad submap does not cost the
team its good ones; among equals, the one with fewer measurements, then the later. The answer depends on the set alone.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from teamslam.errors import InputError, TeamslamError
from teamslam.io import read_submaps
from teamslam.io.submaps.arrays import SUFFIX, read_submap
from teamslam.joining.join.double_counting import Conflict, priors_in_several, rows_in_two
from teamslam.model import Submap, is_landmark
from teamslam.wire.messages import canonical, check


@dataclass(frozen=True)
class Refusal:
    """A submap or file that is left out, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Admission:
    """The submaps that go together, by base and id, those that do not, and the ids of those that nobody wanted."""

    good: tuple[Submap, ...]
    refused: tuple[Refusal, ...]
    left_out: tuple[str, ...] = ()


def admit(candidates: Iterable[Submap | str | Path], *, without: Collection[str] = ()) -> Admission:
    """Sort submaps, submap files, folders of them and local maps of other programs (io.SUBMAP_FORMATS) into those that
    can be joined and those that are refused.

    Of several versions of one id the newest is taken, which is no refusal. `without`: ids of submaps, and names of
    robots whose submaps are all meant: as if these had never been there. Never raises for a bad submap; InputError for
    a name in `without` that none of them bears.
    """
    sound: list[Submap] = []
    refused: list[Refusal] = []
    for candidate in _each_file(candidates):
        try:
            sound.extend(_opened(candidate))
        except TeamslamError as error:
            name = candidate.id if isinstance(candidate, Submap) else str(candidate)
            refused.append(Refusal(name, error.problem if isinstance(error, InputError) else str(error)))
    wanted, left_out = _wanted(sound, without)
    newest, torn = _newest(wanted)
    found = without_conflicts(newest)
    refused = sorted([*refused, *torn, *found.refused], key=lambda r: (r.name, r.reason))
    return Admission(found.good, tuple(refused), left_out)


def _wanted(submaps: Sequence[Submap], without: Collection[str]) -> tuple[list[Submap], tuple[str, ...]]:
    """The submaps that bear none of these names, and the ids of the others."""
    names_of = [{s.id, *map(s.names.robot, s.robots)} for s in submaps]
    known = sorted(set().union(*names_of))
    for name in without:
        if name not in known:
            raise InputError(f"no submap and no robot is called '{name}'; there are: {', '.join(known)}")
    gone = [not names.isdisjoint(without) for names in names_of]
    left_out = {s.id for s, out in zip(submaps, gone, strict=True) if out}
    return [s for s, out in zip(submaps, gone, strict=True) if not out], tuple(sorted(left_out))


def _opened(candidate: Submap | Path) -> list[Submap]:
    """The submaps of one candidate: one of our files holds one, local maps of other programs come together."""
    if isinstance(candidate, Submap):
        check(candidate)
        return [candidate]
    return [read_submap(candidate)] if candidate.suffix == SUFFIX else read_submaps(candidate)


def _each_file(candidates: Iterable[Submap | str | Path]) -> Iterable[Submap | Path]:
    for candidate in candidates:
        if isinstance(candidate, Submap):
            yield candidate
        elif (path := Path(candidate)).is_dir():
            files = sorted(path.glob(f"*{SUFFIX}"))
            yield from files or [path]
        else:
            yield path


def _newest(submaps: Iterable[Submap]) -> tuple[list[Submap], list[Refusal]]:
    """The newest version of each id, in order; ids whose newest version has several contents are refused."""
    by_id: dict[str, list[Submap]] = {}
    for submap in submaps:
        by_id.setdefault(submap.id, []).append(submap)
    kept, refused = [], []
    for id_, namesakes in by_id.items():
        version = max(s.version for s in namesakes)
        latest = _different([s for s in namesakes if s.version == version])
        if len(latest) > 1:
            refused.append(Refusal(id_, torn_reason(id_, version, len(latest))))
        else:
            kept.append(latest[0])
    return kept, refused


def _different(submaps: Sequence[Submap]) -> list[Submap]:
    """The first of each content."""
    if len(submaps) == 1:
        return list(submaps)
    contents: dict[bytes, Submap] = {}
    for submap in submaps:
        contents.setdefault(canonical(submap), submap)
    return list(contents.values())


def torn_reason(id_: str, version: int, contents: int) -> str:
    """Why an id with several contents is left out."""
    return (
        f"{contents} different submaps are all called {id_}, version {version}; which is right cannot be told: "
        f"whoever made them should send one under a higher version; where they are of two drives of one robot, it "
        f"needs a name and a number of its own in the second log"
    )


# --- submaps that exclude each other -----------------------------------------------------------------------------


def without_conflicts(sound: Iterable[Submap]) -> Admission:
    """Sort submaps, each sound in itself and no two of one id, into those that go together and those that do not."""
    submaps = sorted(sound, key=lambda s: (s.base, s.id))
    against: list[dict[int, str]] = [{} for _ in submaps]
    for rule in RULES:
        for a, b, why in rule(submaps):
            against[a].setdefault(b, why)
            against[b].setdefault(a, why)
    left = set(range(len(submaps)))
    refused = []
    while left:
        worst = max(left, key=lambda n: (len(against[n].keys() & left), -submaps[n].rows, n))
        opponents = sorted(against[worst].keys() & left)
        if not opponents:
            break
        left.discard(worst)
        refused.append(Refusal(submaps[worst].id, against[worst][opponents[0]]))
    return Admission(tuple(submaps[n] for n in sorted(left)), tuple(refused))


def _two_dimensions(submaps: Sequence[Submap]) -> Iterable[Conflict]:
    def kinds_of(submap: Submap) -> dict[int, object]:
        layout = submap.values.layout
        marks = is_landmark(layout.keys)
        return dict(zip(layout.keys[marks].tolist(), layout.kinds[marks].tolist(), strict=True))

    yield from _disagreements(
        submaps, kinds_of, lambda s, key: f"{s.names.describe(key)} has another dimension or kind"
    )


def _clocks(submaps: Sequence[Submap]) -> Iterable[Conflict]:
    yield from _disagreements(submaps, lambda s: {0: s.names.tick_s}, lambda s, _: "a tick lasts another time")


def _names(submaps: Sequence[Submap]) -> Iterable[Conflict]:
    yield from _disagreements(
        submaps, lambda s: dict(s.names.robots), lambda s, n: f"robot number {n} is called {s.names.robot(n)}"
    )
    yield from _disagreements(
        submaps, lambda s: dict(s.names.landmarks), lambda s, n: f"landmark number {n} is called {s.names.landmark(n)}"
    )


def _disagreements(
    submaps: Sequence[Submap],
    says: Callable[[Submap], dict[int, object]],
    words: Callable[[Submap, int], str],
) -> Iterable[Conflict]:
    """Pairs of submaps that say different things of one number."""
    held: dict[int, dict[object, list[int]]] = {}
    for number, submap in enumerate(submaps):
        for key, value in says(submap).items():
            held.setdefault(key, {}).setdefault(value, []).append(number)
    for key, camps in held.items():
        for mine, theirs in itertools.combinations(camps.values(), 2):
            for a, b in itertools.product(mine, theirs):
                low, high = sorted((a, b))
                yield (
                    low,
                    high,
                    f"in submap {submaps[high].id} {words(submaps[high], key)} than in submap {submaps[low].id}; "
                    f"both cannot be right"
                    if "another" in words(submaps[high], key)
                    else f"in submap {submaps[high].id} {words(submaps[high], key)}, in submap {submaps[low].id} "
                    f"otherwise; give it one name for the whole team",
                )


RULES: tuple[Callable[[Sequence[Submap]], Iterable[Conflict]], ...] = (
    rows_in_two,
    priors_in_several,
    _two_dimensions,
    _clocks,
    _names,
)
