"""Where each submap's frame lies, in closed form: the start of a join, from nothing.

    strands:  consecutive submaps of a robot share their boundary pose, so their frames compose
    clusters: grow from the first strand; in each round the one that is held most firmly by what it shares with the
    cluster
              (poses, landmarks, raw sightings of each other's robots) is attached by one rigid fit over all of it

What nothing holds starts a cluster of its own: separate components, with the reason in words. One shared pose holds a
frame; points must be two at different places in the plane, three not in line in space, else a hinge is left. How firmly
is measured, not counted: the least information on the frame's rotation [rad^-2]. The fit is robust: a wrong link among
good ones is outvoted (Cauchy weights, re-fitted until they settle).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, align, concatenate, lift_points
from teamslam.joining.start import measured_positions
from teamslam.model import Kind, Names, Submap, Values, is_landmark, is_pose, pose_kind, robot_of, unpack
from teamslam.solver import Covariances

HINGE = 16.0  # [rad^-2]: below this a frame counts as free to turn; its sigma would be a quarter of a radian


@dataclass(frozen=True)
class Cluster:
    """Submaps in one frame: `members` (places in the list, the root first) and the pose of each one's base in it."""

    members: list[int]
    frames: list[Pose]


@dataclass(frozen=True)
class Placement:
    """Clusters in the order of their lowest robot; `reasons` says why there is more than one."""

    clusters: list[Cluster]
    reasons: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Sketch:
    """What a strand or cluster shows of the world, in its own frame: per key (sorted, unique) a place (n, 3), where it
    is known an orientation (n, 3, 3), and a variance of the place (n,) [m^2]."""

    keys: IntArray
    places: Array
    turns: Array
    oriented: BoolArray
    variances: Array

    @classmethod
    def of(cls, keys: IntArray, places: Array, turns: Array, oriented: BoolArray, variances: Array) -> "Sketch":
        """A sketch from rows in any order; of rows with one key the first counts."""
        keys, first = np.unique(keys, return_index=True)
        return cls(keys, places[first], turns[first], oriented[first], variances[first])

    def move(self, frame: Pose) -> "Sketch":
        """The same things written in the frame that `frame` is written in."""
        lifted = frame.lift(3)
        return Sketch(self.keys, lifted.act(self.places), lifted.rotation @ self.turns, self.oriented, self.variances)

    def merge(self, other: "Sketch") -> "Sketch":
        """Both together; where both know a key, this one counts."""
        return Sketch.of(
            *(
                np.concatenate([a, b])
                for a, b in (
                    (self.keys, other.keys),
                    (self.places, other.places),
                    (self.turns, other.turns),
                    (self.oriented, other.oriented),
                    (self.variances, other.variances),
                )
            )
        )


@dataclass(frozen=True, eq=False)
class Link:
    """How a strand hangs on a cluster: its frame there, the information on that frame's rotation, what they share."""

    frame: Pose
    firmness: float
    shared: IntArray


def place(submaps: Sequence[Submap]) -> Placement:
    """The frames of all submaps, by clusters. Law: with noise-free submaps every frame is exact."""
    strands = [_strand(submaps, members) for members in strands_of(submaps)]
    if len(strands) == 1:
        return Placement([Cluster(list(strands[0][0]), strands[0][1])])
    names = submaps[0].names
    sketches = [_sketch_strand(submaps, members, frames) for members, frames in strands]
    planar = [submaps[members[0]].base_dim == 2 for members, _ in strands]
    # Planar robots share the ground, which must be the frame where robots of both kinds meet.
    waiting = sorted(range(len(strands)), key=lambda s: (not planar[s], submaps[strands[s][0][0]].base))
    clusters: list[Cluster] = []
    reasons: list[str] = []
    while waiting:
        root = waiting.pop(0)
        cluster, placed = sketches[root], {root: Pose.identity(2 if planar[root] else 3)}
        links: dict[int, Link] = {s: _link(cluster, sketches[s], planar[s]) for s in waiting}
        while links:
            best = max(links, key=lambda s: links[s].firmness)
            link = links.pop(best)
            if link.firmness < HINGE:
                break
            placed[best] = link.frame
            grown = sketches[best].move(link.frame)
            fresh = grown.keys[~np.isin(grown.keys, cluster.keys)]
            cluster = cluster.merge(grown)
            for s in links:
                if np.isin(sketches[s].keys, fresh).any():
                    links[s] = _link(cluster, sketches[s], planar[s])
        for s in [s for s in waiting if s not in placed]:
            reasons.append(_why(submaps[strands[s][0][0]], _link(cluster, sketches[s], planar[s]), planar[s], names))
        waiting = [s for s in waiting if s not in placed]
        members = [m for s in placed for m in strands[s][0]]
        clusters.append(Cluster(members, [placed[s] @ f for s in placed for f in strands[s][1]]))
    return Placement(clusters, reasons if len(clusters) > 1 else [])


# --- strands ------------------------------------------------------------------------------------------------------


def strands_of(submaps: Sequence[Submap]) -> list[list[int]]:
    """Submaps chained by boundary poses, each strand in an order in which every base but the first is known before."""
    home: dict[int, int] = {}
    for number, submap in enumerate(submaps):
        keys = submap.values.layout.keys
        own = keys[robot_of(keys) == robot_of(submap.base)]
        for key in own.tolist():
            home.setdefault(key, number)
    parent = [home.get(submap.base, -1) for submap in submaps]
    strands: dict[int, list[int]] = {}
    root_of: dict[int, int] = {}
    for number in sorted(range(len(submaps)), key=lambda n: submaps[n].base):
        above = parent[number]
        root = root_of.get(above, number)
        root_of[number] = root
        strands.setdefault(root, []).append(number)
    return list(strands.values())


def _strand(submaps: Sequence[Submap], members: list[int]) -> tuple[list[int], list[Pose]]:
    """The frames of a strand, in the frame of its first submap."""
    where: dict[int, tuple[int, int]] = {}
    frames: list[Pose] = []
    for place_, number in enumerate(members):
        submap = submaps[number]
        if place_ == 0:
            frames.append(Pose.identity(submap.base_dim))
        else:
            holder, _ = where[submap.base]
            frames.append(frames[holder] @ submaps[members[holder]].values.pose(submap.base))
        layout = submap.values.layout
        for key in layout.keys[robot_of(layout.keys) == robot_of(submap.base)].tolist():
            where.setdefault(key, (place_, key))
    return members, frames


# --- sketches -----------------------------------------------------------------------------------------------------


def _sketch_strand(submaps: Sequence[Submap], members: list[int], frames: list[Pose]) -> Sketch:
    whole = _sketch(submaps[members[0]])
    for number, frame in zip(members[1:], frames[1:], strict=True):
        whole = whole.merge(_sketch(submaps[number]).move(frame))
    return whole


def _sketch(submap: Submap) -> Sketch:
    """A submap's own variables, then what its raw sightings show of others."""
    values = submap.all_values
    keys = values.layout.keys
    poses = values.layout.kinds < 2
    turns = np.tile(np.eye(3), (len(keys), 1, 1))
    turns[poses] = values.poses_of(keys[poses], 3).rotation
    parts = [(keys, values.positions(keys, 3), turns, poses, _variances(submap, keys))]
    for table in submap.raw:
        if table.model not in ("point", "range_bearing") or not len(table):
            continue
        seen_by = values.layout.contains(table.keys[:, 0])
        part = table.select(seen_by)
        if not len(part):
            continue
        seen = values.poses_of(part.keys[:, 0], 3).act(lift_points(measured_positions(part), 3))
        n = len(part)
        parts.append((part.keys[:, 1], seen, np.tile(np.eye(3), (n, 1, 1)), np.zeros(n, bool), np.full(n, 0.25**2)))
    return Sketch.of(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _variances(submap: Submap, keys: IntArray) -> Array:
    """The mean variance of each variable's place; of the base, which is the frame, 0."""
    out = np.zeros(len(keys))
    blocks = Covariances.of_map(submap).all
    places = np.searchsorted(keys, submap.values.layout.keys, sorter=np.argsort(keys))
    order = np.argsort(keys)[places]
    for at, kind, block in zip(order, submap.values.layout.kinds, blocks, strict=True):
        d = Kind(int(kind)).dim
        out[at] = float(np.trace(block[:d, :d])) / d
    return out


# --- links --------------------------------------------------------------------------------------------------------


def _link(cluster: Sketch, strand: Sketch, planar: bool) -> Link:
    """The best rigid fit of a strand onto a cluster over all that they share."""
    shared, mine, theirs = np.intersect1d(cluster.keys, strand.keys, assume_unique=True, return_indices=True)
    dim = 2 if planar else 3
    if not len(shared):
        return Link(Pose.identity(dim), 0.0, shared)
    source, target = strand.places[theirs][:, :dim], cluster.places[mine][:, :dim]
    oriented = strand.oriented[theirs] & cluster.oriented[mine]
    source_turns = strand.turns[theirs][oriented][:, :dim, :dim]
    target_turns = cluster.turns[mine][oriented][:, :dim, :dim]
    sigma2 = strand.variances[theirs] + cluster.variances[mine] + 0.05**2
    weights = 1.0 / sigma2
    for _ in range(20):
        fit = align(source, target, weights, source_rotations=source_turns, target_rotations=target_turns)
        squared = np.sum((target - fit.pose.act(source)) ** 2, -1)
        # Cauchy weights about the typical misfit, so that drift is forgiven and a wrong link is not.
        scale = np.maximum(np.median(squared / sigma2), 1.0)
        new = 1.0 / (sigma2 * (1.0 + squared / (sigma2 * scale * 4.0)))
        if np.allclose(new, weights, rtol=1e-3):
            break
        weights = new
    return Link(fit.pose, _firmness(target, weights / scale, int(oriented.sum())), shared)


def _firmness(points: Array, weights: Array, oriented: int) -> float:
    """The least information on the rotation of a frame that is held at these points [rad^-2]."""
    arms = points - (weights @ points) / weights.sum()
    moment = (weights[:, None] * arms).T @ arms
    inertia = np.trace(moment) * np.eye(len(moment)) - moment
    held = float(np.trace(moment)) if points.shape[-1] == 2 else float(np.linalg.eigvalsh(inertia)[0])
    return held + oriented * 100.0  # a shared orientation is known to a tenth of a radian or better


def _why(submap: Submap, link: Link, planar: bool, names: Names) -> str:
    robot = names.robot(int(robot_of(submap.base)))
    who = f"the submaps of robot {robot} from {names.describe(submap.base)} on"
    marks = link.shared[is_landmark(link.shared)]
    if not len(link.shared):
        return (
            f"{who} share nothing with the map: no common landmark, and neither robot saw the other; "
            f"{'two' if planar else 'three'} common landmarks, or one sighting of a robot's pose, would join them"
        )
    things = [f"landmark {names.landmark(int(k))}" for k in marks[:4]] + [
        names.describe(int(k)) for k in link.shared[is_pose(link.shared)][:2]
    ]
    return (
        f"{who} share only {', '.join(things)} with the map and can still turn about it "
        f"(heading known to {1.0 / np.sqrt(max(link.firmness, 1e-9)):.2g} rad); one more common landmark elsewhere, "
        f"or one sighting of a robot's pose, would join them"
    )


# --- start values -------------------------------------------------------------------------------------------------


def spread(submaps: Sequence[Submap], frames: Sequence[Pose]) -> Values:
    """The start of a join: every variable where the first submap that knows it puts it.

    A pose that one submap holds as planar and another as spatial is planar: the robot itself knows that it is on the
    ground.
    """
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    taken = np.zeros(0, np.int64)
    for kind in Kind:
        keys, things = _all_of(submaps, frames, kind)
        rows = np.flatnonzero(~np.isin(keys, taken))
        keys, first = np.unique(keys[rows], return_index=True)
        if len(keys):
            parts[kind] = (keys, things[rows[first]])
        taken = np.concatenate([taken, keys])
    return Values.of(parts)


def _all_of(submaps: Sequence[Submap], frames: Sequence[Pose], kind: Kind) -> tuple[IntArray, Pose | Array]:
    """All variables of one kind, base poses first, written in the common frame; keys may repeat."""
    holders = [(s, f) for s, f in zip(submaps, frames, strict=True) if len(s.values.layout.keys_of(kind))]
    keys = [s.values.layout.keys_of(kind) for s, _ in holders]
    bases = [(s.base, f) for s, f in zip(submaps, frames, strict=True) if pose_kind(s.base_dim) == kind]
    all_keys = np.concatenate([np.array([b for b, _ in bases], np.int64), *keys])
    if not holders:
        return all_keys, _stack([f.lift(kind.dim) for _, f in bases]) if bases else np.zeros((0, kind.dim))
    local = unpack(np.concatenate([s.values.table(kind) for s, _ in holders]), kind)
    common = _stack([f.lift(kind.dim) for _, f in holders])[np.repeat(np.arange(len(holders)), [len(k) for k in keys])]
    if isinstance(local, Pose):
        return all_keys, concatenate([*([_stack([f for _, f in bases])] if bases else []), common @ local])
    return all_keys, common.act(local)


def _stack(poses: Sequence[Pose]) -> Pose:
    return Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
