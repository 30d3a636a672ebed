"""Joining by a tree on many workers, for teams that no single memory holds.

    leaves:    a submap is built of each piece of log, and stays on disk
    condense:  of each submap only what others share goes on
    tree:      groups of neighbours are joined, and condensed onto what the rest of the team still shares; so upwards
    root:      the last group is joined: the places of all that it holds
    recover:   downwards, each group's interiors follow from the places of what it had passed on; last each submap's

Whoever joins holds what its group shares with others, never what is inside, so memory is bounded by the widest
separator (and by one leaf; who runs the tree knows every variable's name, eight bytes each). The tree is grown along
the team's own sharing: those who share most are joined first. With one level this is the join of all at once, exactly.
Each further level linearises once more, which differs to second order in the noise, as do all ORDERS.

Everything made lies in a folder, named by the digest of what it is made from. So a run that was killed goes on where
it stopped, a submap that is finished is not built again, and a changed log changes only what depends on it.
"""

import hashlib
import json
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from teamslam.errors import InputError, ModelError, SolveError
from teamslam.geometry import IntArray
from teamslam.io.files.whole import whole_file
from teamslam.io.submaps.arrays import SUFFIX, read_submap, write_submap
from teamslam.joining import Component, Interior, Joined, build, condense, join
from teamslam.model import Dataset, Submap
from teamslam.scale.cluster import Crew, Processes, Workers, crew
from teamslam.scale.sharing import Sharing, by_sharing
from teamslam.scale.treemap import Barren, TreeMap, read_values, write_values
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.wire.pieces import read_piece

Job = Path | Callable[[], Dataset]
"""Where a leaf comes from: the file of a piece or of a submap, or a picklable call that makes a piece (a function of a
module, or a functools.partial of one), known again by its pickled bytes."""
Progress = Callable[[str, int, int], None]

SHORT = "the last groups of the tree stopped short of an optimum, and are used as they are"
FAN = 4  # groups joined at a time: neighbours of a plane come in fours
EVERYONE = Processes()


@dataclass(frozen=True, eq=False)
class Leaf:
    """A finished submap: the digest of what it is made from, its file, its base pose, and all variables (sorted) that
    it or its raw measurements name."""

    name: str
    file: Path
    id: str
    base: int
    keys: IntArray


@dataclass(frozen=True)
class Part:
    """A condensed map that waits to be joined on: `small` its file, `whole` that of the map it was condensed from,
    `below` the parts that were joined into it."""

    small: Path
    whole: Path
    below: tuple["Part", ...] = ()

    @property
    def name(self) -> str:
        """What it is known by: the digest of all that went into it."""
        return self.small.stem


def join_in_tree(
    jobs: Sequence[Job],
    folder: Path,
    *,
    workers: Workers = EVERYONE,
    fan: int = FAN,
    options: Options = DEFAULTS,
    progress: Progress | None = None,
) -> TreeMap:
    """The map of all leaves together, in `folder`; a call that was interrupted goes on from what is there.

    Up to `fan` groups are joined at a time. Laws: with fan >= len(jobs) the estimate is that of `teamslam.join`; else
    it differs to second order in the noise. A piece that no submap can be built of is left out: `unbuilt` of the result
    says which and why. Raises as `join` does, and SolveError where nothing can be built or workers keep dying.
    """
    if fan < 2:
        raise InputError(f"a tree joins at least 2 at a time, found {fan}", field="fan")
    if not jobs:
        raise ModelError("there is nothing to join: the set of submaps is empty")
    tell = progress or (lambda stage, done, of: None)
    with crew(workers) as team:
        leaves, unbuilt = _leaves(team, jobs, folder, options, tell)
        parts, joined = _upwards(team, leaves, folder, fan, options, tell)
        estimates = _downwards(team, parts, joined, folder, tell)
    return TreeMap(joined, estimates, tuple(leaf.file for leaf in leaves), unbuilt)


# --- leaves -----------------------------------------------------------------------------------------------------------


def _leaves(
    team: Crew, jobs: Sequence[Job], folder: Path, options: Options, tell: Progress
) -> tuple[list[Leaf], tuple[Barren, ...]]:
    """All submaps, neighbours beside each other, and the jobs that none can be made of."""
    stage = "building submaps"
    tell(stage, 0, len(jobs))
    tasks = [(number, job, _name(job, options), folder, options) for number, job in enumerate(jobs)]
    made = team.each(_leaf, tasks, partial(tell, stage))
    leaves = [leaf for leaf in made if isinstance(leaf, Leaf)]
    unbuilt = tuple(barren for barren in made if isinstance(barren, Barren))
    if not leaves:
        raise SolveError(unbuilt[0].reason)
    by_id: dict[str, Leaf] = {}
    for leaf in leaves:
        if by_id.setdefault(leaf.id, leaf) is not leaf:
            raise ModelError(f"two submaps are both called {leaf.id}; each piece of a log goes in once")
    in_time = sorted(leaves, key=lambda leaf: (leaf.base, leaf.id))
    return [in_time[place] for place in by_sharing([leaf.keys for leaf in in_time])], unbuilt


def _name(job: Job, options: Options) -> str:
    return _digest(job.read_bytes() if isinstance(job, Path) else pickle.dumps(job), repr(options))


def _leaf(task: tuple[int, Job, str, Path, Options]) -> Leaf | Barren:
    """A worker builds a submap, or finds it built; or tells why none can be."""
    number, job, name, folder, options = task
    if isinstance(job, Path) and job.suffix == SUFFIX:
        return _outline(name, job, read_submap(job))
    file = folder / "submaps" / f"{name}{SUFFIX}"
    if (submap := _finished(file)) is None:
        try:
            submap = read_piece(job).submap(options) if isinstance(job, Path) else build(job(), options=options)
        except SolveError as error:
            return Barren(number, str(error))
        write_submap(submap, file)
    return _outline(name, file, submap)


def _finished(file: Path) -> Submap | None:
    """The submap in a file, None where it is absent or damaged: then it is made again."""
    try:
        return read_submap(file, prove=False)
    except InputError:
        return None


def _outline(name: str, file: Path, submap: Submap) -> Leaf:
    raw = [table.keys.ravel() for table in submap.raw]
    keys = np.unique(np.concatenate([submap.keys, *raw]))
    return Leaf(name, file, submap.id, submap.base, keys)


# --- the tree ---------------------------------------------------------------------------------------------------------


def _upwards(
    team: Crew, leaves: Sequence[Leaf], folder: Path, fan: int, options: Options, tell: Progress
) -> tuple[tuple[Part, ...], Joined]:
    """The tree from the leaves to the root: what was joined into each component of the root, and the root."""
    sharing = Sharing.of([leaf.keys for leaf in leaves])
    ids = {leaf.file: leaf.id for leaf in leaves}
    stage = "condensing"
    tell(stage, 0, len(leaves))
    tasks = [(leaf.name, leaf.file, sharing.across(n, n + 1), folder) for n, leaf in enumerate(leaves)]
    groups: list[tuple[Part, ...]] = [(part,) for part in team.each(_condensed_leaf, tasks, partial(tell, stage))]
    reach = 1
    while True:
        batches = [groups[at : at + fan] for at in range(0, len(groups), fan)]
        reach *= fan  # leaves in a group, but for the last
        stage = f"joining {len(groups)} groups by {fan}"
        tell(stage, 0, len(batches))
        root = len(batches) == 1
        joins = [
            (
                tuple(part for group in batch for part in group),
                None if root else sharing.across(n * reach, (n + 1) * reach),
                folder,
                options,
            )
            for n, batch in enumerate(batches)
        ]
        done = team.each(_joined_group, joins, partial(tell, stage))
        groups = [group.parts for group in done]
        if root:
            components = (Component(read_submap(p.whole, prove=False), None, tuple(_ids(p, ids))) for p in groups[0])
            remarks = () if done[0].converged else (SHORT,)
            return groups[0], Joined(tuple(components), done[0].reasons, remarks=remarks)


def _condensed_leaf(task: tuple[str, Path, IntArray, Path]) -> Part:
    """A worker condenses a submap onto what others share."""
    name, whole, shared, folder = task
    file = folder / "tree" / f"{_digest(name, shared.tobytes())}{SUFFIX}"
    if _finished(file) is None:
        submap = read_submap(whole, prove=False)
        write_submap(condense(submap, _to_keep(submap, shared))[0], file)
    return Part(file, whole)


def _to_keep(submap: Submap, shared: IntArray) -> IntArray:
    """What stays of a submap: what others share, what its raw measurements name, its first pose; never nothing."""
    keys = submap.values.layout.keys
    raw = [table.keys.ravel() for table in submap.raw]
    keep = keys[np.isin(keys, np.concatenate([shared, [submap.first_pose], *raw]))]
    return keep if len(keep) else keys[-1:]


@dataclass(frozen=True)
class Group:
    """What joining some parts gave: a part for each component, why there are several, and whether each is an
    optimum."""

    parts: tuple[Part, ...]
    reasons: tuple[str, ...]
    converged: bool


def _joined_group(task: tuple[tuple[Part, ...], IntArray | None, Path, Options]) -> Group:
    """A worker joins some parts, and condenses each component onto what the rest of the team shares (the root: not)."""
    parts, shared, folder, options = task
    name = _digest(*(p.name for p in parts), b"root" if shared is None else shared.tobytes(), repr(options))
    note = folder / "tree" / f"{name}.json"
    if (found := _noted(note, parts)) is not None:
        return found
    maps = {part: read_submap(part.small, prove=False) for part in parts}
    of_id = {submap.id: part for part, submap in maps.items()}
    try:
        joined = join(maps.values(), options=options)
    except SolveError:
        if shared is None:
            raise
        return Group(parts, (), False)  # nothing is joined yet: perhaps what holds them comes with the next group
    out = []
    for number, (whole_map, members) in enumerate(settled(joined, maps, of_id, root=shared is None)):
        whole = small = folder / "tree" / f"{name}-{number}-whole{SUFFIX}"
        write_submap(whole_map, whole)
        if shared is not None:
            small = folder / "tree" / f"{name}-{number}{SUFFIX}"
            write_submap(condense(whole_map, _to_keep(whole_map, shared))[0], small)
        out.append(Part(small, whole, members))
    group = Group(tuple(out), joined.reasons, joined.converged)
    _write_note(note, group, parts)
    return group


def settled(
    joined: Joined, maps: Mapping[Part, Submap], of_id: Mapping[str, Part], *, root: bool
) -> list[tuple[Submap, tuple[Part, ...]]]:
    """The maps of a group, each with the parts in it. What found no optimum yet goes on unjoined: perhaps what holds it
    comes with the next group."""
    out: list[tuple[Submap, tuple[Part, ...]]] = []
    for component in joined.components:
        members = tuple(of_id[id_] for id_ in component.members)
        if root or component.solution is None or component.solution.converged:
            out.append((component.map, members))
        else:
            out += [(maps[part], (part,)) for part in members]
    return out


def _write_note(note: Path, group: Group, parts: tuple[Part, ...]) -> None:
    """Written last: where it is, the group is finished."""
    content = [
        {"small": p.small.name, "whole": p.whole.name, "below": [parts.index(b) for b in p.below]} for p in group.parts
    ]
    text = json.dumps({"parts": content, "reasons": group.reasons, "converged": group.converged})
    with whole_file(note) as file:
        file.write(text.encode())


def _noted(note: Path, parts: tuple[Part, ...]) -> Group | None:
    """What a worker that had finished this group has left; None where nothing, or not all."""
    if not note.exists():
        return None
    content = json.loads(note.read_text())
    out = []
    for entry in content["parts"]:
        small, whole = note.parent / entry["small"], note.parent / entry["whole"]
        if _finished(small) is None or _finished(whole) is None:
            return None
        out.append(Part(small, whole, tuple(parts[number] for number in entry["below"])))
    return Group(tuple(out), tuple(content["reasons"]), content["converged"])


# --- back down --------------------------------------------------------------------------------------------------------


def _downwards(
    team: Crew, parts: tuple[Part, ...], joined: Joined, folder: Path, tell: Progress
) -> tuple[tuple[Path, ...], ...]:
    """Everybody's places, from the root down; by component the files that hold them."""
    found: list[list[Path]] = [[] for _ in parts]
    level: list[tuple[Part, Path, int]] = []
    for number, (part, component) in enumerate(zip(parts, joined.components, strict=True)):
        file = folder / "estimates" / f"{_digest(part.name)}.npz"
        write_values(component.map.all_values, file)
        found[number].append(file)
        level += [(below, file, number) for below in part.below]
    depth = 1
    while level:
        stage = f"recovering, level {depth}"
        tell(stage, 0, len(level))
        tasks = [(part, above, folder) for part, above, _ in level]
        files = team.each(_recovered, tasks, partial(tell, stage))
        following = []
        for (part, _, number), file in zip(level, files, strict=True):
            found[number].append(file)
            following += [(below, file, number) for below in part.below]
        level, depth = following, depth + 1
    return tuple(map(tuple, found))


def _recovered(task: tuple[Part, Path, Path]) -> Path:
    """A worker finds where the interiors of a part lie, now that what it had passed on has its place."""
    part, above, folder = task
    file = folder / "estimates" / f"{_digest(part.name, above.stem)}.npz"
    if not file.exists():
        known = read_values(above)
        whole = read_submap(part.whole, prove=False)
        kept = read_submap(part.small, prove=False).values.layout.keys
        layout = whole.values.layout
        inner = Interior(whole, layout.keys[~np.isin(layout.keys, kept)])
        held = np.append(kept, whole.base)
        values = known.only(held[known.layout.contains(held)])
        write_values(values.update(inner.recover_from(known)), file)
    return file


def _ids(part: Part, leaves: Mapping[Path, str]) -> list[str]:
    """The ids of the submaps below a part, sorted."""
    if not part.below:
        return [leaves[part.whole]]
    return sorted(id_ for below in part.below for id_ in _ids(below, leaves))


def _digest(*parts: bytes | str) -> str:
    """A name for what is made from these parts."""
    sums = (hashlib.blake2b(p.encode() if isinstance(p, str) else p, digest_size=16).digest() for p in parts)
    return hashlib.blake2b(b"".join(sums), digest_size=16).hexdigest()
