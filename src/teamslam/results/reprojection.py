"""How far each corner of each tag is from where a map has it in the image [pixels], by camera and tag.

reprojection.csv     robot, camera, tag, images, rms_px, median_px, worst_px (of corners)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.rows import LOOKING, Tag
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io.bags.recorded import cameras_of
from teamslam.io.bags.team_file import CameraEntry, TeamFile
from teamslam.io.files.text import write_text
from teamslam.model import Dataset, Submap, Table, index_of, robot_of


@dataclass(frozen=True, eq=False)
class Reprojected:
    """What one camera of a robot saw: when (m,), of which tags (m,), its corners (m, 4, 2) and where the map has them
    [pixels]."""

    robot: str
    entry: CameraEntry
    ticks: IntArray
    tags: IntArray
    seen: Array
    mapped: Array

    @property
    def off(self) -> Array:
        """How far each corner is off (m, 4) [pixels]."""
        return np.asarray(np.linalg.norm(self.seen - self.mapped, axis=-1))

    def select(self, rows: BoolArray | IntArray) -> "Reprojected":
        """Some sightings."""
        return Reprojected(
            self.robot, self.entry, self.ticks[rows], self.tags[rows], self.seen[rows], self.mapped[rows]
        )


def reprojected(log: Dataset, maps: Sequence[Submap], team: TeamFile, folder: Path) -> tuple[Reprojected, ...]:
    """The corners of a log that was made by a team file in `folder`, and where its maps have them. Corners that a map
    has where a camera cannot see are left out."""
    found = []
    for number, entry in enumerate(team.robot, 1):
        mine = [t for t in log.tables if t.model == "corners" and t.robot == number]
        by_camera = [_camera_of(table, entry.camera) for table in mine]
        for k, (camera, known) in enumerate(zip(entry.camera, cameras_of(entry, folder), strict=True)):
            tables = [table for table, place in zip(mine, by_camera, strict=True) if place == k]
            parts = [part for t in tables for m in maps for part in _of_table(t, m, known, team)]
            if parts:
                ticks, tags, seen, at = (np.concatenate(column) for column in zip(*parts, strict=True))
                order = np.lexsort([tags, ticks])
                found.append(Reprojected(entry.name, camera, ticks[order], tags[order], seen[order], at[order]))
    return tuple(found)


def write_reprojection(found: Sequence[Reprojected], path: Path) -> None:
    """The table of errors by camera and tag."""
    lines = ["robot,camera,tag,images,rms_px,median_px,worst_px"]
    for one in found:
        for tag in np.unique(one.tags).tolist():
            off = one.off[one.tags == tag]
            figures = np.sqrt(np.mean(off**2)), np.median(off), off.max()
            lines.append(
                ",".join([one.robot, one.entry.name, str(tag), str(len(off)), *(f"{figure:.3f}" for figure in figures)])
            )
    write_text(path, "\n".join([*lines, ""]))


def _camera_of(table: Table, cameras: Sequence[CameraEntry]) -> int:
    """Which camera a table is of: the one that it is called after; of several of one name the one nearest to where it
    has it, as a run may have put that right."""
    assert table.sensor is not None
    named = [k for k, camera in enumerate(cameras) if camera.name == table.called]
    some = named or list(range(len(cameras)))
    off = [np.linalg.norm((cameras[k].pose @ LOOKING).minus(table.sensor)) for k in some]
    return some[int(np.argmin(off))]


def _of_table(
    table: Table, submap: Submap, camera: Camera, team: TeamFile
) -> Iterator[tuple[IntArray, IntArray, Array, Array]]:
    values = submap.all_values
    part = table.select(table.told_by(values.layout))
    if not len(part):
        return
    seen, at = (_pixels(rays, camera) for rays in (part.values, part.predict(values)))
    good = np.isfinite(seen).all((-1, -2)) & np.isfinite(at).all((-1, -2))
    tags = np.array(
        [
            _number(submap.names.landmark(int(index_of(key))), False, places, team)
            if source == "landmarks"
            else _number(team.robot[int(robot_of(key)) - 1].name, True, places, team)
            for key, places, source in zip(
                part.keys[:, 1].tolist(), part.values[:, 12:], [table.source] * len(part), strict=True
            )
        ],
        np.int64,
    )
    yield index_of(part.keys[good, 0]), tags[good], seen[good], at[good]


def _pixels(values: Array, camera: Camera) -> Array:
    """Where directions (m, 12 and more) in axes that look along x appear (m, 4, 2)."""
    rays = values[:, :12].reshape(-1, 4, 3) @ LOOKING.rotation.T
    return camera.project(rays)


def _number(carrier: str, is_robot: bool, places: Array, team: TeamFile) -> int:
    """Which tag of a carrier has its corners at these places; of a tag by itself its number, which its name begins
    with."""
    tags = [tag for tag in team.carried().values() if tag.is_robot == is_robot and tag.carrier == carrier]
    if not tags:
        first = carrier.split(" ")[0]
        return int(first) if first.isdigit() else -1
    off = [float(np.abs(_corners(tag) - places).max()) for tag in tags]
    return tags[int(np.argmin(off))].number


def _corners(tag: Tag) -> Array:
    return np.asarray(tag.corners.reshape(12))
