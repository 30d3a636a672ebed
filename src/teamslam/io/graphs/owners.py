"""Whose a pose is, told by its id. Graph files have no word for a robot; teams are written in one of these ways:

    letters     GTSAM's symbols: the robot's letter in the top byte; of labelled symbols, in the second one
    blocks      robot n from n * 10,000 on, in one file or several
    one count   several files and no id twice, but for poses that one robot saw of another: each id belongs to the file
                in which it has more odometry, links to its neighbours in number
    own counts  several files, each of which counts its robot's poses for itself

Ids come in blocks where every jump from one block of 10,000 to the next is longer than any step of odometry within one:
a robot whose poses are numbered on past 9,999 steps across. In one file without blocks all poses are one robot's.

Landmarks are the team's. A pose whose letter is L is a landmark with an orientation (a tag), and so is one whose letter
is l where nothing is measured from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.io.files.records import Records
from teamslam.io.graphs.part import Part
from teamslam.io.graphs.symbols import LOWER_FIRST, landmark_numbers, split_symbols
from teamslam.model import landmark_key, pose_key
from teamslam.model.keys import MAX_INDEX, MAX_ROBOT

BLOCK = 10_000
NO_LETTER = "the letter '{0}' of a pose's id is no robot's (a to z, A to Z)"


@dataclass(frozen=True, eq=False)
class _Count:
    """The poses with plain numbers of one file: all ids, those that VERTEX lines define, and pairs that an edge links
    (lower, higher)."""

    ids: IntArray
    defined: IntArray
    links: IntArray


@dataclass(frozen=True, eq=False)
class Owners:
    """Whose the ids of some files are. `robots` are the team's numbers and names; `note` says how they were told."""

    robots: dict[int, str]
    note: str | None
    marks: dict[int, int]
    tags: BoolArray  # (256,): letters that stand for landmarks with an orientation
    plain: list[tuple[IntArray, IntArray]] = field(default_factory=list)  # of each file: ids, rising, and their robots

    def poses(self, file: int, ids: IntArray, records: Records, at: int = 0) -> IntArray:
        """The keys of poses (n,) that a file's records name in their word `at`; InputError where one is no robot's."""
        letters, counts = split_symbols(ids)
        robots = LOWER_FIRST.numbers(letters)
        lettered, is_tag = letters > 0, self.tags[letters]
        own, whose = self.plain[file]
        if len(own):
            places = np.minimum(np.searchsorted(own, ids), len(own) - 1)
            robots = np.where(lettered, robots, whose[places])
        foreign = np.flatnonzero(lettered & (robots == 0) & ~is_tag)
        if len(foreign):
            row = int(foreign[0])
            raise records.error(row, NO_LETTER.format(chr(int(letters[row]))), "id")
        beyond = np.flatnonzero((counts > MAX_INDEX) & ~is_tag)
        if len(beyond):
            row = int(beyond[0])
            raise records.error(
                row,
                f"ids run from 0 to 2^51 - 1 (behind a letter in the top byte), found {records.words[row][at]}",
                "id",
            )
        keys = np.zeros(len(ids), np.int64)
        keys[~is_tag] = pose_key(robots[~is_tag], counts[~is_tag])
        keys[is_tag] = self.points(ids[is_tag])
        return keys

    def points(self, ids: IntArray) -> IntArray:
        """The keys of landmarks (n,)."""
        found, which = np.unique(ids, return_inverse=True)
        return np.asarray(landmark_key(np.array([self.marks[n] for n in found.tolist()], np.int64))[which.ravel()])


def owners_of(parts: Sequence[Part]) -> Owners:
    """Whose the ids in some files are."""
    letters = [split_symbols(ids)[0] for part in parts for ids, _ in _pose_ids(part)]
    known = np.unique(np.concatenate([np.zeros(0, np.int64), *letters]))
    tags = _tag_letters(parts)
    counts = [_plain(part) for part in parts]
    named = {int(LOWER_FIRST.numbers(np.array([c]))[0]): chr(c) for c in known.tolist() if c and not tags[c]}
    marks = landmark_numbers(sorted(_landmark_ids(parts, tags)))
    if not any(len(count.ids) for count in counts):
        return Owners(named, None, marks, tags, [(count.ids, count.ids) for count in counts])
    if named:
        _refuse_a_mixture(parts, tags)
    names, note, robots = _numbering(parts, counts)
    return Owners(names, note, marks, tags, [(c.ids, r) for c, r in zip(counts, robots, strict=True)])


def _numbering(parts: Sequence[Part], counts: Sequence[_Count]) -> tuple[dict[int, str], str | None, list[IntArray]]:
    """The robots of plain ids: their names, how they were told, and of each file whose its ids are."""
    own_making = any(part.names is not None for part in parts)
    if not own_making and _in_blocks(counts):
        robots = [count.ids // BLOCK + 1 for count in counts]
        names = _names_of_blocks(parts, counts)
        listed = ", ".join(names.values())
        return names, f"ids come in blocks of {BLOCK}, one for each robot: {listed}", robots
    names = {number: part.path.stem for number, part in enumerate(parts, 1) if len(counts[number - 1].ids)}
    if len(parts) == 1:
        return names, None, [np.ones(len(counts[0].ids), np.int64)]
    at_home = _homes(counts)
    if at_home is not None:
        return names, None, at_home
    return names, "each file counts its own robot's poses", _own_counts(counts)


# --- blocks -----------------------------------------------------------------------------------------------------------


def _in_blocks(counts: Sequence[_Count]) -> bool:
    """Whether ids come in blocks of 10,000: every jump to the next block is longer than any odometry within one."""
    ids = np.unique(np.concatenate([count.ids for count in counts]))
    blocks = ids // BLOCK
    jumps = np.diff(ids)[np.diff(blocks) > 0]
    links = np.concatenate([count.links for count in counts])
    if not len(jumps) or not len(links) or blocks[-1] + 1 > MAX_ROBOT:
        return False
    inside = links[:, 0] // BLOCK == links[:, 1] // BLOCK
    near = np.searchsorted(ids, links[:, 1]) - np.searchsorted(ids, links[:, 0]) == 1
    steps = (links[:, 1] - links[:, 0])[inside & near]
    return len(steps) >= max(len(jumps), 1) and bool(jumps.min() > steps.max())


def _names_of_blocks(parts: Sequence[Part], counts: Sequence[_Count]) -> dict[int, str]:
    """Of one file the numbers of the blocks; of several, each block has the name of the file with most of its links."""
    blocks = np.unique(np.concatenate([count.ids for count in counts])) // BLOCK
    numbers = np.unique(blocks).tolist()
    if len(parts) == 1:
        return {number + 1: str(number) for number in numbers}
    inside = [c.links[(c.links // BLOCK == c.links[:, :1] // BLOCK).all(1)][:, 0] // BLOCK for c in counts]
    names: dict[int, str] = {}
    for number in numbers:
        shares = [int((found == number).sum()) for found in inside]
        home = parts[int(np.argmax(shares))].path.stem if max(shares) else str(number)
        names[number + 1] = home if home not in names.values() else str(number)
    return names


# --- several files ----------------------------------------------------------------------------------------------------


def _homes(counts: Sequence[_Count]) -> list[IntArray] | None:
    """The file (from 1) in which each id of each file has most odometry; None where the files count for themselves: an
    id has as much of it in two of them."""
    ids = np.unique(np.concatenate([count.ids for count in counts]))
    share = np.zeros((len(counts), len(ids)), np.int64)
    there = np.zeros((len(counts), len(ids)), bool)
    for number, count in enumerate(counts):
        there[number, np.searchsorted(ids, count.ids)] = True
        near = np.searchsorted(count.ids, count.links[:, 1]) - np.searchsorted(count.ids, count.links[:, 0]) == 1
        np.add.at(share[number], np.searchsorted(ids, count.links[near].ravel()), 1)
    best = np.sort(np.where(there, share, -1), axis=0)
    shared = there.sum(0) > 1
    if (shared & (best[-1] == best[-2])).any():
        return None
    home = np.argmax(np.where(there, share, -1), axis=0) + 1
    return [home[np.searchsorted(ids, count.ids)] for count in counts]


def _own_counts(counts: Sequence[_Count]) -> list[IntArray]:
    """Each file's ids are its own robot's, but for those that it does not define and another one does."""
    robots = []
    for number, count in enumerate(counts):
        whose = np.full(len(count.ids), number + 1)
        if len(count.defined):
            for other in reversed([k for k in range(len(counts)) if k != number]):
                there = ~np.isin(count.ids, count.defined) & np.isin(count.ids, counts[other].defined)
                whose[there] = other + 1
        robots.append(whose)
    return robots


# --- ids in parts -----------------------------------------------------------------------------------------------------


def _pose_ids(part: Part) -> list[tuple[IntArray, Records]]:
    """All ids of poses in a file, by the lines that name them."""
    found = [(vertices.ids, vertices.records) for vertices in part.vertices if vertices.kind.is_pose]
    for measured in part.measured:
        found += [(measured.ids[:, k], measured.records) for k, end in enumerate(measured.ends) if end.is_pose]
    return found


def _landmark_ids(parts: Sequence[Part], tags: BoolArray) -> set[int]:
    ids: set[int] = set()
    for part in parts:
        for vertices in (*part.vertices, *part.truth):
            if not vertices.kind.is_pose:
                ids.update(vertices.ids.tolist())
        for measured in part.measured:
            for k, end in enumerate(measured.ends):
                if not end.is_pose:
                    ids.update(measured.ids[:, k].tolist())
        for found, _ in _pose_ids(part):
            ids.update(found[tags[split_symbols(found)[0]]].tolist())
    return ids


def _tag_letters(parts: Sequence[Part]) -> BoolArray:
    """The letters whose poses are landmarks with an orientation: L, and l where nothing is measured from it."""
    tags = np.zeros(256, bool)
    tags[ord("L")] = tags[ord("l")] = True
    for part in parts:
        for measured in part.measured:
            if len(measured.ends) == 2 and (split_symbols(measured.ids[:, 0])[0] == ord("l")).any():
                tags[ord("l")] = False
    return tags


def _plain(part: Part) -> _Count:
    """The poses with plain numbers of a file."""
    ids = [np.zeros(0, np.int64), *(found for found, _ in _pose_ids(part))]
    defined = [np.zeros(0, np.int64), *(v.ids for v in part.vertices if v.kind.is_pose)]
    pairs = [np.zeros((0, 2), np.int64), *(m.ids for m in part.measured if m.model == "relative_pose")]
    links = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    links = links[(split_symbols(links)[0] == 0).all(1)]
    return _Count(_without_letters(np.concatenate(ids)), _without_letters(np.concatenate(defined)), links)


def _without_letters(ids: IntArray) -> IntArray:
    """The plain numbers among ids, rising."""
    return np.unique(ids[split_symbols(ids)[0] == 0])


def _refuse_a_mixture(parts: Sequence[Part], tags: BoolArray) -> None:
    """InputError at the first pose with a plain number among poses with letters."""
    for part in parts:
        for ids, records in _pose_ids(part):
            plain = np.flatnonzero(split_symbols(ids)[0] == 0)
            if len(plain):
                raise records.error(
                    int(plain[0]),
                    f"pose {int(ids[plain[0]])} has a plain number where other poses have their robot's letter in the "
                    f"top byte; number all of them in one way",
                    "id",
                )
