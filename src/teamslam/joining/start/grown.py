"""A start for a way whose heading dead reckoning loses: maps of short stretches, grown in pairs until one is left.

    cut:    the way, thinned to keyframes, into stretches along which the heading stays known
    solve:  all stretches at once, each in the frame of its first pose with landmarks of its own: one least squares of
            blocks that know nothing of each other, a few steps
    pair:   of each two neighbours the second begins where the first ends, corrected by the landmarks that both saw; a
            landmark of both is one from then on
    repeat: solve and pair, log2 of the number of stretches times; then the poses between keyframes follow by odometry

The heading that a stretch has lost is found before the next one adds to it, so every solve starts near its optimum. All
of it costs at most STEPS linearisations of the keyframes' rows for each level.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray, IntArray, Pose, concatenate
from teamslam.joining.start.keyframes import Keyframes
from teamslam.joining.start.seams import corrected
from teamslam.joining.start.targets import place_targets
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import Dataset, Kind, Layout, Table, Values, pose_key, pose_kind, told_by
from teamslam.solver import Options, System, convex_start, firm, optimise

STRETCH = 0.1  # [rad]: how far the heading may be lost along the shortest stretches
STEPS = 20  # of each solve at most
MARK_SIGMA = 0.1  # [m]: how far two stretches may disagree about a landmark
ORIGIN = int(pose_key(1, 0))  # the first pose of every stretch, which is its frame


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Where a way is cut: `bases` (places of keyframes). `poses` (n,) of keyframes, each in the frame of the stretch
    that it ends or lies in. Landmarks by `codes` (stretch * marks + mark, sorted), and their `places` (m, 3) there."""

    bases: IntArray
    poses: Pose
    codes: IntArray
    places: Array

    def of_rows(self) -> IntArray:
        """The stretch (n,) that rows taken from each keyframe belong to: one that it begins or lies in."""
        return np.searchsorted(self.bases, np.arange(len(self.poses)), side="right") - 1

    def of_poses(self) -> IntArray:
        """The stretch (n,) in whose frame each keyframe's pose is: one that it ends or lies in."""
        return np.maximum(np.searchsorted(self.bases, np.arange(len(self.poses))) - 1, 0)


def grown(piece: Dataset, robot: int, way: Values, kinds: Layout) -> Values:
    """The way of a robot by dead reckoning, and all landmarks of its piece that are seen, where the landmarks put them.

    `way` has every pose linked to the next by odometry; `kinds` are those of the piece's variables in the robot's own
    frame. What cannot be solved stays where it was.
    """
    frames = Keyframes.of(piece, robot, way, kinds)
    stretches = _cut(frames)
    convex = True
    while True:
        stretches = _solved(frames, stretches, convex)
        if len(stretches.bases) == 1:
            return _filled(frames, stretches, way, pose_kind(piece.robots[robot]))
        stretches, convex = _paired(frames, stretches), False


def _cut(frames: Keyframes) -> _Stretches:
    bases, since = [0], 0.0
    for place, variance in enumerate(frames.heading.tolist(), 1):
        since += variance
        if since > STRETCH**2:
            bases.append(place)
            since = 0.0
    if bases[-1] == len(frames.poses) - 1 and len(bases) > 1:
        bases.pop()
    cut = _Stretches(np.array(bases), frames.poses, np.zeros(0, np.int64), np.zeros((0, 3)))
    return replace(cut, poses=frames.poses[cut.bases[cut.of_poses()]].between(frames.poses))


def _solved(frames: Keyframes, cut: _Stretches, convex: bool) -> _Stretches:
    """All stretches nearer to their optima, apart from each other."""
    tables, codes = _apart(frames, cut)
    marks = frames.mark_kinds[codes % max(len(frames.marks), 1)]
    dim = cut.poses.dim
    keys = np.concatenate([[ORIGIN], _key(np.arange(1, len(cut.poses)))])
    start = Values.of({pose_kind(dim): (keys, concatenate([Pose.identity(dim, (1,)), cut.poses[1:]]))})
    layout = start.layout.union(Layout.of(np.arange(len(codes)), marks))
    start = triangulate(place_targets(start.update(_known(cut, codes, marks)), tables, layout), tables)
    tables = told_by(tables, start.layout)
    used = np.unique(np.concatenate([[ORIGIN], *(t.keys.ravel() for t in tables)]))
    values = start.only(used)
    system = System(values.layout, tables=tables, fixed=np.array([ORIGIN]))
    few = Options(max_iterations=STEPS, decrement=0.1 * float(np.sqrt(system.free.dof + 1.0)))
    with suppress(SolveError):  # a guess stays a guess
        first = convex_start(system, values, few) if convex else values
        values = firm(system, optimise(system, first, few)).values
    values = start.update(values)
    found = np.flatnonzero(values.layout.contains(np.arange(len(codes))))
    poses = concatenate([Pose.identity(dim, (1,)), values.poses_of(keys[1:], dim)])
    return _Stretches(cut.bases, poses, codes[found], values.positions(found, 3))


def _apart(frames: Keyframes, cut: _Stretches) -> tuple[list[Table], IntArray]:
    """The rows with variables of their stretches: keyframes or ORIGIN, and landmarks by their place among `codes`."""
    stretch, begins = cut.of_rows(), np.isin(np.arange(len(cut.poses)), cut.bases)
    steps = np.arange(len(frames.steps))
    tables = [replace(frames.steps, keys=np.stack([_observer(steps, begins), _key(steps + 1)], 1))]
    of = [stretch[s.by] * len(frames.marks) + s.mark for s in frames.sightings]
    codes = np.unique(np.concatenate([*of, np.zeros(0, np.int64)]))
    for seen, code in zip(frames.sightings, of, strict=True):
        tables.append(replace(seen.table, keys=np.stack([_observer(seen.by, begins), np.searchsorted(codes, code)], 1)))
    return tables, codes


def _key(place: IntArray) -> IntArray:
    return pose_key(1, place + 1)


def _observer(place: IntArray, begins: BoolArray) -> IntArray:
    return np.where(begins[place], ORIGIN, _key(place))


def _known(cut: _Stretches, codes: IntArray, kinds: IntArray) -> Values:
    """The landmarks that have a place already, as variables by their place among `codes`."""
    _, at, of = np.intersect1d(codes, cut.codes, assume_unique=True, return_indices=True)
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in (Kind.POINT2, Kind.POINT3):
        here = kinds[at] == kind
        if here.any():
            parts[kind] = (at[here], cut.places[of[here], : kind.dim])
    return Values.of(parts)


def _paired(frames: Keyframes, cut: _Stretches) -> _Stretches:
    """Half as many stretches: of each two neighbours one, in the frame of the first."""
    marks = len(frames.marks)
    second = np.arange(1, len(cut.bases), 2)
    seams = _frames_of_second(cut, second, marks)
    # Poses.
    stretch = cut.of_poses()
    inside = np.flatnonzero(stretch % 2 == 1)
    moved = seams[stretch[inside] // 2] @ cut.poses[inside]
    rotation, translation = cut.poses.rotation.copy(), cut.poses.translation.copy()
    rotation[inside], translation[inside] = moved.rotation, moved.translation
    rotation[cut.bases[second]], translation[cut.bases[second]] = seams.rotation, seams.translation
    # Landmarks: one that both know stays where the first puts it.
    holder, places = cut.codes // max(marks, 1), cut.places.copy()
    inside = np.flatnonzero(holder % 2 == 1)
    places[inside] = seams.lift(3)[holder[inside] // 2].act(places[inside])
    codes, first = np.unique(holder // 2 * marks + cut.codes % max(marks, 1), return_index=True)
    return _Stretches(cut.bases[::2], Pose(rotation, translation), codes, places[first])


def _frames_of_second(cut: _Stretches, second: IntArray, marks: int) -> Pose:
    seams = cut.poses[cut.bases[second]]
    if not len(cut.codes):
        return seams
    twin = np.minimum(np.searchsorted(cut.codes, cut.codes - marks), len(cut.codes) - 1)
    both = np.flatnonzero((cut.codes // marks % 2 == 1) & (cut.codes[twin] == cut.codes - marks))
    d = seams.dim
    variances = np.full(len(both), MARK_SIGMA**2)
    return corrected(seams, cut.places[both, :d], cut.places[twin[both], :d], variances, cut.codes[both] // marks // 2)


def _filled(frames: Keyframes, cut: _Stretches, way: Values, kind: Kind) -> Values:
    """The whole way, each pose hanging on the keyframe before it by odometry, and the landmarks."""
    keys = way.layout.keys
    dead = way.poses_of(keys, kind.dim)
    before = np.searchsorted(frames.places, np.arange(len(keys)), side="right") - 1
    poses = cut.poses[before] @ dead[frames.places[before]].between(dead)
    kinds = frames.mark_kinds[cut.codes]
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {kind: (keys, poses)}
    for point in (Kind.POINT2, Kind.POINT3):
        if (here := kinds == point).any():
            parts[point] = (frames.marks[cut.codes[here]], cut.places[here, : point.dim])
    return Values.of(parts)
