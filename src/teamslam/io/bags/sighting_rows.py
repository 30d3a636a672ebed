"""A robot's tags in its images as tables of the model `corners`, of landmarks and of other robots; and what images of
depth say of them, as `relative_pose` with three numbers known (`frontend.tags.plane_rows`).

An image belongs to the last keyframe that is not after it, and a line of a rolling shutter is read a little before or
after the image's instant, which is that of its middle line. What was seen late is put where it would have been seen at
the keyframe's instant (`frontend.tags.late`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from msgspec import structs

from teamslam.frontend.moments import moved, unsure
from teamslam.frontend.stamps import keyframe_of
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.depth import planes, points_on
from teamslam.frontend.tags.late import Motion, points_at_one_instant
from teamslam.frontend.tags.plane_rows import plane_rows, standing_in
from teamslam.frontend.tags.rows import LOOKING, corner_rows
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.geometry.resection import resect
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.team_file import CameraEntry, TeamFile
from teamslam.model import Loss, Standing, Table, landmark_key, landmark_number, pose_key

SOURCES = ("landmarks", "robots")
DEPTH = "_depth"  # after a source: of its depths


def sightings_of(robot: Seen, team: Sequence[Seen], keyframes: Mapping[int, IntArray], file: TeamFile) -> list[Table]:
    """A robot's sightings, a table for each camera and source, and one of their depths where there are any. Robots are
    numbered from 1 in the order of `team`, and have keyframes [ticks] by number, by their own clocks; `robot` may be
    one of them with its tags renamed."""
    loss = Loss(file.tags.loss, file.tags.loss_scale)
    return [table for part in parts_of(robot, team, keyframes) for table in part.tables(team, loss)]


def renamed(
    tables: Sequence[Table], robot: Seen, team: Sequence[Seen], keyframes: Mapping[int, IntArray]
) -> list[Table]:
    """The tables of `sightings_of` a robot by the names that its tags have now: all else of them is as it was."""
    parts = parts_of(robot, team, keyframes)
    keys = {
        source: np.concatenate([p.keys for p in parts if p.source == source]) for source in {p.source for p in parts}
    }
    return [replace(table, keys=keys[table.source.removesuffix(DEPTH)][table.ids]) for table in tables]


@dataclass(frozen=True, eq=False)
class Part:
    """What a camera of a robot saw of one source: the robot's number, the camera's place among its views, the `mine` of
    whose sightings it is (m,), their keys (m, 2) and `ids` (m,); the keyframes of who saw and, where `carriers` (m,)
    says which robot carries a tag, of who was seen."""

    number: int
    source: str
    camera: int
    mine: BoolArray
    keys: IntArray
    ids: IntArray
    observers: IntArray
    carriers: IntArray
    targets: IntArray

    def tables(
        self, team: Sequence[Seen], loss: Loss, standing: Pose | None = None, corners: Array | None = None
    ) -> list[Table]:
        """Its rows, by the clocks and cameras of `team`, and those of depth where the camera has any, by the same ids;
        `standing` as in `corner_rows`, `corners` (m, 4, 2) [pixels] other ones than were seen."""
        view = team[self.number - 1].views[self.camera].select(self.mine)
        if corners is not None:
            view = replace(view, corners=replace(view.corners, corners=corners))
        motion = _motion(view, view.line_late_s, self, team)
        values, white, good = corner_rows(
            view.corners, view.camera, list(view.tags), view.entry.floor_px, view.entry.edge_px, motion, standing
        )
        rows = self._table("corners", view, (values, white), good, loss)
        return [rows] if view.depths is None else [rows, self._depths(view, (values, white), good, team, loss)]

    def _depths(
        self, view: View, corners: tuple[Array, Array], good: BoolArray, team: Sequence[Seen], loss: Loss
    ) -> Table:
        """The planes of tags in images of depth, each line of which was measured when the image's was read."""
        assert view.depths is not None
        points, count = points_on(view.depths, view.camera)
        plane, _, told = planes(view.depths, points, count, 0.0)
        rows = np.flatnonzero(good & told)
        seen, points, count = view.depths.select(rows), points[rows], count[rows]
        tags, R = [view.tags[row] for row in rows.tolist()], LOOKING.rotation
        standing = standing_in((corners[0][rows], corners[1][rows]), plane[rows] @ R, tags)
        motion = _motion(view, np.where(view.depths.count > 0, view.late_s(view.depths.pixels), 0.0), self, team)
        if motion is not None:
            points = points_at_one_instant(points @ R, motion.of(rows), standing) @ R.T
        plane, covariance, held = planes(seen, points, count, view.entry.depth_floor)
        values, white, kept = plane_rows(standing, (plane @ R, R.T @ covariance @ R), tags)
        all_ = np.zeros((len(good), 12)), np.zeros((len(good), 6, 6))
        all_[0][rows], all_[1][rows] = values, white
        return self._table("relative_pose", view, all_, np.isin(np.arange(len(good)), rows[held & kept]), loss)

    def _table(self, model: str, view: View, rows: tuple[Array, Array], good: BoolArray, loss: Loss) -> Table:
        """Those rows that are good; depths are a source of their own."""
        source = self.source if model == "corners" else f"{self.source}{DEPTH}"
        sensor = view.entry.pose @ LOOKING
        return Table(
            self.number, source, model, 3, self.keys[good], rows[0][good], rows[1][good], self.ids[good], sensor, loss,
            called=view.entry.name,
        )  # fmt: skip

    def differs(self, one: Sequence[Seen], other: Sequence[Seen]) -> bool:
        """Whether its rows may be others by the clocks, cameras and tags of another team."""
        here, there = (team[self.number - 1].views[self.camera] for team in (one, other))
        if here.entry != there.entry or here.camera != there.camera or self._seen_otherwise(here, there):
            return True
        seen = np.unique(self.carriers[self.carriers > 0]).tolist()
        return any(one[n - 1].clock != other[n - 1].clock for n in {self.number, *seen} if seen)

    def _seen_otherwise(self, here: View, there: View) -> bool:
        """Whether tags that it shows are others (`io.bags.unknowns` keeps the very same where they are not)."""
        if here.tags is there.tags:
            return False
        return any(one is not other for one, other in compress(zip(here.tags, there.tags, strict=True), self.mine))

    def differs_in_place(self, one: Sequence[Seen], other: Sequence[Seen]) -> bool:
        """Whether nothing of its rows but the place of the camera may differ."""
        here, there = (team[self.number - 1].views[self.camera] for team in (one, other))
        placed = replace(there, entry=here.entry) if _placed(there.entry, here.entry) == here.entry else there
        team = [*other]
        team[self.number - 1] = replace(
            other[self.number - 1], views=tuple(placed if v is there else v for v in other[self.number - 1].views)
        )
        return not self.differs(one, team)

    def moved(self, table: Table, team: Sequence[Seen]) -> Table:
        """Its rows by a camera elsewhere. How the camera moved while lines were read is as it was."""
        return replace(table, sensor=team[self.number - 1].views[self.camera].entry.pose @ LOOKING)

    def standing(self, table: Table) -> Pose:
        """How carriers stood to the eye (m,) at the keyframes of its rows, as each tells by itself; rows that
        are not in the table: anyhow."""
        rays, points = (table.values[:, part].reshape(-1, 4, 3) for part in (slice(0, 12), slice(12, 24)))
        found, rows = resect(rays, points, table.whitening).poses[:, 0], np.searchsorted(self.ids, table.ids)
        rotation, translation = np.tile(np.eye(3), (len(self.ids), 1, 1)), np.tile([1.0, 0.0, 0.0], (len(self.ids), 1))
        rotation[rows], translation[rows] = found.rotation, found.translation
        return Pose(rotation, translation)

    def expected(self, team: Sequence[Seen], standing: Pose) -> Array:
        """Where the corners (m, 4, 2) [pixels] would have been seen by the clocks and cameras of `team`, did carriers
        stand so to the eye (m,) at the keyframes; as they were seen where no image shows that."""
        view = team[self.number - 1].views[self.camera].select(self.mine)
        motion = _motion(view, view.line_late_s, self, team)
        points = np.array([tag.corners for tag in view.tags])
        there = points if motion is None else motion.body.act(points)
        there = there @ np.swapaxes(standing.rotation, -1, -2) + standing.translation[:, None]
        ahead = (there if motion is None else motion.eye.unact(there)) @ LOOKING.rotation.T
        pixels = view.camera.project(ahead)
        shown = np.all((ahead[..., 2] > 0.0) & view.camera.rays(pixels)[1], axis=-1)
        return np.where(shown[:, None, None], pixels, view.corners.corners)

    def standing_by(self, known: Standing, alone: Pose) -> Pose:
        """How carriers stood to the eye (m,) where that is known by a map; else `alone`."""
        ids, there = known.get((self.number, self.source), (self.ids[:0], alone))
        rows = np.flatnonzero(np.isin(self.ids, ids))
        at = np.searchsorted(ids, self.ids[rows])
        rotation, translation = alone.rotation.copy(), alone.translation.copy()
        rotation[rows], translation[rows] = there.rotation[at], there.translation[at]
        return Pose(rotation, translation)


def _placed(entry: CameraEntry, where: CameraEntry) -> CameraEntry:
    """A camera where another is."""
    place = {name: getattr(where, name) for name in ("xyz_m", "quaternion_wxyz", "rotation_vector")}
    return structs.replace(entry, **place)


def parts_of(robot: Seen, team: Sequence[Seen], keyframes: Mapping[int, IntArray]) -> list[Part]:
    """The parts of what a robot saw, those that are not empty."""
    numbers = {other.entry.name: k for k, other in enumerate(team, 1)}
    number = numbers[robot.entry.name]
    parts: list[Part] = []
    first = dict.fromkeys(SOURCES, 0)
    for camera, view in enumerate(robot.views):
        for source in SOURCES:
            mine = np.array([tag.is_robot == (source == "robots") for tag in view.tags], bool)
            part = view.select(mine)
            if not len(part.corners):
                continue
            observers = keyframe_of(keyframes[number], part.ticks)
            carriers = np.array([numbers[tag.carrier] if tag.is_robot else 0 for tag in part.tags])
            targets = part.ticks.copy()
            for other in np.unique(carriers[carriers > 0]).tolist():
                seen = ticks_by(team, number, other, part.ticks[carriers == other])
                targets[carriers == other] = keyframe_of(keyframes[other], seen)
            keys = np.stack([pose_key(number, observers), _keys_of(part, carriers, targets)], -1)
            ids = first[source] + np.arange(len(keys))
            first[source] += len(keys)
            parts.append(Part(number, source, camera, mine, keys, ids, observers, carriers, targets))
    return parts


def ticks_by(team: Sequence[Seen], one: int, other: int, ticks: IntArray) -> IntArray:
    """Stamps of one robot as another's clock would have them."""
    return ticks if one == other else team[other - 1].clock.own(team[one - 1].clock.team(ticks))


def _keys_of(view: View, carriers: IntArray, targets: IntArray) -> IntArray:
    """What each tag stands for: the pose of a robot at its keyframe, or a landmark."""
    return np.array([
        pose_key(other, tick) if other else landmark_key(landmark_number(tag.carrier))
        for tag, other, tick in zip(view.tags, carriers.tolist(), targets.tolist(), strict=True)
    ], np.int64)  # fmt: skip


def _motion(view: View, line_late_s: Array, part: Part, team: Sequence[Seen]) -> Motion | None:
    """How eye and carriers moved from their keyframes until lines were read, so late (m, k) in their images, as far as
    odometry says; None where all were read there."""
    number, observers, carriers, targets = part.number, part.observers, part.carriers, part.targets
    late = _late(view.ticks - observers, line_late_s, team[number - 1])
    moving = {
        other: _late(ticks_by(team, number, other, view.ticks) - targets, line_late_s, team[other - 1])
        for other in np.unique(carriers[carriers > 0]).tolist()
    }
    if not late.any() and not any(times[carriers == other].any() for other, times in moving.items()):
        return None
    body = Pose.identity(3, late.shape)
    rotation, translation, errs = body.rotation.copy(), body.translation.copy(), np.zeros((*late.shape, 6, 6))
    for other, times in moving.items():
        rows = carriers == other
        way, errs[rows] = _moved(team[other - 1], targets[rows], times[rows])
        rotation[rows], translation[rows] = way.rotation, way.translation
    sensor = view.entry.pose @ LOOKING
    mine, mine_errs = _moved(team[number - 1], observers, late)
    eye = sensor.inverse() @ mine @ sensor
    return Motion(eye, Pose(rotation, translation), sensor.inverse().adjoint() @ mine_errs, errs)


def _late(after: IntArray, line_late_s: Array, mover: Seen) -> Array:
    """How long after a mover's keyframe lines (m, k) were read [s], of images that were taken `after` it (m,) [ticks];
    0 where nothing tells how it moved meanwhile."""
    seen = after[:, None] / TICKS_PER_S + line_late_s
    return np.zeros_like(seen) if mover.track is None else np.asarray(seen)


def _moved(mover: Seen, ticks: IntArray, over_s: Array) -> tuple[Pose, Array]:
    """How a robot moved (m, k), and by how much that errs (m, k, 6, 6), as `Motion` has it; not at all without
    odometry."""
    if mover.track is None:
        return Pose.identity(3, over_s.shape), np.zeros((*over_s.shape, 6, 6))
    errs = over_s[..., None, None] * (unsure(mover.track, ticks, mover.entry.motion)[:, None, :, None] * np.eye(6))
    return moved(mover.track, ticks, over_s, mover.entry.motion), errs
