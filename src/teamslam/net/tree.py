"""Joining by a tree on many workers, for teams that no single memory holds.

    leaves:    a submap is built of each piece of log, and stays on disk
    condense:  of each submap only what others share goes on
    tree:      groups of neighbours are joined, and condensed onto what the rest of the team still shares; so upwards
    root:      the last group is joined: the places of all that it holds
    recover:   downwards, each group's interiors follow from the places of what it had passed on; last each submap's

Whoever joins holds what its group shares with others, never what is inside, so memory is bounded by the widest
separator. The tree is grown along the team's own sharing: those who share most are joined first. With one level this
is the join of all at once, exactly. Each further level linearises once more, which differs to second order in the
noise, as do all ORDERS.

Everything made lies in a folder, named by the digest of what it is made from. So a run that was killed goes on where
it stopped, a submap that is finished is not built again, and a changed log changes only what depends on it.
"""

import hashlib
import json
import os
import pickle
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from teamslam.errors import InputError, ModelError, SolveError
from teamslam.geometry import Array, IntArray
from teamslam.io.arrays import SUFFIX, read_submap, write_submap
from teamslam.io.tum import write_trajectory
from teamslam.joining import Component, Interior, Joined, build, condense, join
from teamslam.joining.carry import Carrier
from teamslam.joining.join import joined_map, usable_rows
from teamslam.model import (
    WORLD,
    Dataset,
    Layout,
    Names,
    Submap,
    Values,
    is_landmark,
    is_pose,
    robot_of,
)
from teamslam.net.cluster import Crew, Processes, Workers, crew
from teamslam.net.pieces import SUFFIX as PIECE
from teamslam.net.pieces import read_piece
from teamslam.solver import Options, SubmapTerm, System, optimise
from teamslam.solver.optimise import DEFAULTS

Job = Path | Callable[[], Dataset]
"""Where a leaf comes from: the file of a piece or of a submap, or a picklable call that makes a piece (a function of a
module, or a functools.partial of one), known again by its pickled bytes."""
Progress = Callable[[str, int, int], None]

FAN = 4  # groups joined at a time: neighbours of a plane come in fours
SPECTRAL = 1500  # leaves up to which sharing is cut by eigenvectors; beyond, the order given is halved first


@dataclass(frozen=True, eq=False)
class Leaf:
    """A finished submap: its file, and all variables (sorted) that it or its raw measurements name."""

    name: str
    file: Path
    id: str
    base: int
    keys: IntArray
    names: Names


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


@dataclass(frozen=True, eq=False)
class TreeMap:
    """A team's map in a folder. `joined` holds the last group's variables, one component for each part of the team that
    hangs together; `estimates` are the files that hold all variables, in the frame of their component's map, by
    component; `leaves` the submaps."""

    folder: Path
    joined: Joined
    leaves: tuple[Leaf, ...]
    estimates: tuple[tuple[Path, ...], ...]
    members: tuple[tuple[str, ...], ...]

    def values(self, component: int = 0) -> Values:
        """The estimate of all variables of a component, in memory; its frame is among them."""
        return _together([read_values(file) for file in self.estimates[component]])

    @property
    def dof(self) -> tuple[int, ...]:
        """For each component the numbers measured less the unknowns: what its chi2 should be near."""
        return tuple(c.map.rows - c.map.dof for c in self.joined.components)


def join_in_tree(
    jobs: Sequence[Job],
    folder: Path,
    *,
    workers: Workers = Processes(),
    fan: int = FAN,
    options: Options = DEFAULTS,
    progress: Progress | None = None,
) -> TreeMap:
    """The map of all leaves together, in `folder`; a call that was interrupted goes on from what is there.

    Up to `fan` groups are joined at a time. Laws: with fan >= len(jobs) the estimate is that of `teamslam.join`; else it
    differs to second order in the noise. Raises as `build` and `join` do, and SolveError where workers keep dying.
    """
    if fan < 2:
        raise InputError(f"a tree joins at least 2 at a time, found {fan}", field="fan")
    if not jobs:
        raise ModelError("there is nothing to join: the set of submaps is empty")
    tell = progress or (lambda stage, done, of: None)
    with crew(workers) as team:
        leaves = _leaves(team, jobs, folder, options, tell)
        order = by_sharing([leaf.keys for leaf in leaves])
        leaves = [leaves[place] for place in order]
        parts, joined = _upwards(team, leaves, folder, fan, options, tell)
        estimates = _downwards(team, parts, joined, folder, tell)
    members = tuple(tuple(_ids(part, {leaf.file: leaf.id for leaf in leaves})) for part in parts)
    return TreeMap(folder, joined, tuple(leaves), estimates, members)


# --- leaves -----------------------------------------------------------------------------------------------------------


def _leaves(team: Crew, jobs: Sequence[Job], folder: Path, options: Options, tell: Progress) -> list[Leaf]:
    stage = "building submaps"
    tell(stage, 0, len(jobs))
    tasks = [(job, folder, options) for job in jobs]
    leaves = team.each(_leaf, tasks, lambda done, of: tell(stage, done, of))
    by_id: dict[str, Leaf] = {}
    for leaf in leaves:
        if by_id.setdefault(leaf.id, leaf) is not leaf:
            raise ModelError(f"two submaps are both called {leaf.id}; each piece of a log goes in once")
    return sorted(leaves, key=lambda leaf: (leaf.base, leaf.id))


def _leaf(task: tuple[Job, Path, Options]) -> Leaf:
    """A worker builds a submap, or finds it built."""
    job, folder, options = task
    if isinstance(job, Path) and job.suffix == SUFFIX:
        return _outline(job, read_submap(job))
    content = job.read_bytes() if isinstance(job, Path) else pickle.dumps(job)
    file = folder / "submaps" / f"{_digest(content, repr(options))}{SUFFIX}"
    if (submap := _finished(file)) is None:
        if isinstance(job, Path):
            submap = read_piece(job).submap(options)
        else:
            submap = build(job(), options=options)
        write_submap(submap, file)
    return _outline(file, submap)


def _finished(file: Path) -> Submap | None:
    """The submap in a file, None where it is absent or damaged: then it is made again."""
    try:
        return read_submap(file)
    except InputError:
        return None


def _outline(file: Path, submap: Submap) -> Leaf:
    raw = [table.keys.ravel() for table in submap.raw]
    keys = np.unique(np.concatenate([submap.keys, *raw]))
    return Leaf(file.stem, file, submap.id, submap.base, keys, submap.names)


# --- the tree ---------------------------------------------------------------------------------------------------------


def _upwards(
    team: Crew, leaves: Sequence[Leaf], folder: Path, fan: int, options: Options, tell: Progress
) -> tuple[tuple[Part, ...], Joined]:
    """The tree from the leaves to the root: what was joined into each component of the root, and the root."""
    first, last = _spans(leaves)
    span = [(number, number) for number in range(len(leaves))]
    stage = "condensing"
    tell(stage, 0, len(leaves))
    tasks = [(leaf, _shared(leaf.keys, (n, n), first, last), folder) for n, leaf in enumerate(leaves)]
    groups = [(part,) for part in team.each(_condensed_leaf, tasks, lambda done, of: tell(stage, done, of))]
    level = 1
    while True:
        batches = [slice(at, at + fan) for at in range(0, len(groups), fan)]
        span = [(span[b][0][0], span[b][-1][1]) for b in batches]
        stage = f"joining, level {level}"
        tell(stage, 0, len(batches))
        root = len(batches) == 1
        keys = [
            None if root else _shared(np.concatenate([leaf.keys for leaf in leaves[a : b + 1]]), (a, b), first, last)
            for a, b in span
        ]
        joins = [
            (tuple(p for group in groups[b] for p in group), keep, folder, options)
            for b, keep in zip(batches, keys, strict=True)
        ]
        groups = team.each(_joined_group, joins, lambda done, of, s=stage: tell(s, done, of))  # type: ignore[misc]
        if root:
            break
        level += 1
    reasons = json.loads((folder / "tree" / f"{_group_name(joins[0])}.json").read_text())["reasons"]
    components = tuple(Component(read_submap(part.whole), None, ()) for part in groups[0])
    return groups[0], Joined(components, tuple(reasons))


def _spans(leaves: Sequence[Leaf]) -> tuple[dict[int, int], dict[int, int]]:
    """For each variable that several leaves name, the first and the last of them."""
    keys = np.concatenate([leaf.keys for leaf in leaves])
    holder = np.repeat(np.arange(len(leaves)), [len(leaf.keys) for leaf in leaves])
    order = np.argsort(keys, kind="stable")
    keys, holder = keys[order], holder[order]
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    ends = np.append(starts[1:], len(keys)) - 1
    several = ends > starts
    named = keys[starts[several]].tolist()
    return (
        dict(zip(named, holder[starts[several]].tolist(), strict=True)),
        dict(zip(named, holder[ends[several]].tolist(), strict=True)),
    )


def _shared(keys: IntArray, span: tuple[int, int], first: dict[int, int], last: dict[int, int]) -> IntArray:
    """Those of the keys that leaves outside the span name too, sorted."""
    wanted = {k for k in keys.tolist() if k in first and (first[k] < span[0] or last[k] > span[1])}
    return np.array(sorted(wanted), np.int64)


def _condensed_leaf(task: tuple[Leaf, IntArray, Path]) -> Part:
    """A worker condenses a submap onto what others share."""
    leaf, shared, folder = task
    file = folder / "tree" / f"{_digest(leaf.name, shared.tobytes())}{SUFFIX}"
    if _finished(file) is None:
        submap = read_submap(leaf.file)
        write_submap(condense(submap, _to_keep(submap, shared))[0], file)
    return Part(file, leaf.file)


def _to_keep(submap: Submap, shared: IntArray) -> IntArray:
    """What stays of a submap: what others share, what its raw measurements name; never nothing."""
    keys = submap.values.layout.keys
    raw = [table.keys.ravel() for table in submap.raw]
    keep = keys[np.isin(keys, np.concatenate([shared, *raw]))]
    return keep if len(keep) else keys[-1:]


GroupTask = tuple[tuple[Part, ...], IntArray | None, Path, Options]


def _group_name(task: GroupTask) -> str:
    parts, shared, _, options = task
    return _digest(*(part.name for part in parts), b"root" if shared is None else shared.tobytes(), repr(options))


def _joined_group(task: GroupTask) -> tuple[Part, ...]:
    """A worker joins some parts, and condenses each component onto what the rest of the team shares (the root: not)."""
    parts, shared, folder, options = task
    name = _group_name(task)
    note = folder / "tree" / f"{name}.json"
    if (known := _noted(note, parts)) is not None:
        return known
    maps = {(m := read_submap(part.small)).id: (m, part) for part in parts}
    joined = join([m for m, _ in maps.values()], options=options)
    if not joined.converged:
        raise SolveError(f"a group of {len(parts)} submaps did not converge; allow more iterations, or join fewer")
    out = []
    for number, component in enumerate(joined.components):
        whole = folder / "tree" / f"{name}-{number}-whole{SUFFIX}"
        write_submap(component.map, whole)
        small = whole
        if shared is not None:
            small = folder / "tree" / f"{name}-{number}{SUFFIX}"
            beyond = component.map.values.layout.keys
            foreign = beyond[beyond < 0]  # a frame of the world: nobody's own
            keep = _to_keep(component.map, np.concatenate([shared, foreign]))
            write_submap(condense(component.map, keep)[0], small)
        out.append(Part(small, whole, tuple(maps[id_][1] for id_ in component.members)))
    where = {part.small.name: number for number, part in enumerate(parts)}
    content = [
        {"small": p.small.name, "whole": p.whole.name, "below": [where[b.small.name] for b in p.below]} for p in out
    ]
    _write_whole(note, json.dumps({"parts": content, "reasons": list(joined.reasons)}).encode())
    return tuple(out)


def _noted(note: Path, parts: tuple[Part, ...]) -> tuple[Part, ...] | None:
    """What a worker that had finished this group has left; None where nothing, or not all."""
    if not note.exists():
        return None
    out = []
    for entry in json.loads(note.read_text())["parts"]:
        small, whole = note.parent / entry["small"], note.parent / entry["whole"]
        if _finished(small) is None or _finished(whole) is None:
            return None
        out.append(Part(small, whole, tuple(parts[number] for number in entry["below"])))
    return tuple(out)


# --- back down --------------------------------------------------------------------------------------------------------


def _downwards(
    team: Crew, parts: tuple[Part, ...], joined: Joined, folder: Path, tell: Progress
) -> tuple[tuple[Path, ...], ...]:
    """Everybody's places, from the root down; by component the files that hold them."""
    found: list[list[Path]] = [[] for _ in parts]
    level: list[tuple[Part, Path, int]] = []
    for number, (part, component) in enumerate(zip(parts, joined.components, strict=True)):
        file = folder / "estimates" / f"{_digest(part.name)}.npz"
        # The frame of the world is no variable.
        write_values(component.map.values if component.map.base == WORLD else component.map.all_values, file)
        found[number].append(file)
        level += [(below, file, number) for below in part.below]
    depth = 1
    while level:
        stage = f"recovering, level {depth}"
        tell(stage, 0, len(level))
        tasks = [(part, above, folder) for part, above, _ in level]
        files = team.each(_recovered, tasks, lambda done, of, s=stage: tell(s, done, of))  # type: ignore[misc]
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
        whole, kept = read_submap(part.whole), read_submap(part.small).values.layout.keys
        layout = whole.values.layout
        inner = Interior(whole, layout.keys[~np.isin(layout.keys, kept)])
        held = np.append(kept, whole.base)
        values = known.only(held[known.layout.contains(held)])
        write_values(values.update(inner.recover_from(known)), file)
    return file


def _ids(part: Part, leaves: dict[Path, str]) -> list[str]:
    if not part.below:
        return [leaves[part.whole]]
    return sorted(id_ for below in part.below for id_ in _ids(below, leaves))


# --- results ----------------------------------------------------------------------------------------------------------


def write_trajectories(result: TreeMap, folder: Path) -> list[Path]:
    """Each robot's way in a file of its own, `<component>/<robot>.tum` where there are several components, one robot in
    memory at a time."""
    files = []
    for number, estimates in enumerate(result.estimates):
        where: dict[int, list[Path]] = {}
        own = {leaf.file.stem: int(robot_of(leaf.base)) for leaf in result.leaves}
        for file in estimates:
            for robot in _robots_in(file):
                where.setdefault(robot, []).append(file)
        place = folder if len(result.estimates) == 1 else folder / f"part_{number + 1}"
        names = result.leaves[0].names.merge(leaf.names for leaf in result.leaves)
        for robot in sorted(set(where) & set(own.values())):
            values = _together([_of_robot(read_values(file), robot) for file in where[robot]])
            keys = np.sort(values.layout.keys)
            dim = 2 + int(values.layout.kinds.max() % 2)
            files.append(place / f"{names.robot(robot)}.tum")
            write_trajectory(files[-1], names.stamps_s(keys), values.poses_of(keys, dim))
    return files


def _robots_in(file: Path) -> list[int]:
    keys = read_values(file).layout.keys
    return [int(r) for r in np.unique(robot_of(keys[is_pose(keys)]))]


def _of_robot(values: Values, robot: int) -> Values:
    return values.select(np.asarray(robot_of(values.layout.keys) == robot))


def write_values(values: Values, file: Path) -> None:
    """An estimate as arrays keys, kinds, state: whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, draft = tempfile.mkstemp(dir=file.parent, suffix=".part")
    with os.fdopen(handle, "wb") as out:
        np.savez(out, keys=values.layout.keys, kinds=values.layout.kinds, state=values.state)
    os.replace(draft, file)


def read_values(file: Path) -> Values:
    """What `write_values` wrote."""
    with np.load(file, allow_pickle=False) as arrays:
        return Values(Layout(arrays["keys"], arrays["kinds"]), arrays["state"])


def _together(parts: Sequence[Values]) -> Values:
    """Estimates that agree where they overlap, as one."""
    keys = np.concatenate([p.layout.keys for p in parts])
    kinds = np.concatenate([p.layout.kinds for p in parts])
    layout = Layout.of(keys, kinds)
    state = np.zeros(int(layout.state_start[-1]))
    for part in parts:
        at = layout.index(part.layout.keys)
        starts, sizes = layout.state_start[at], np.diff(part.layout.state_start)
        within = np.arange(len(part.state)) - np.repeat(part.layout.state_start[:-1], sizes)
        state[np.repeat(starts, sizes) + within] = part.state
    return Values(layout, state)
