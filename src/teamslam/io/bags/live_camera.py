"""A camera that films now, as rows: what `recordings` makes of a film, image by image as they come.

    image -> tags -> of each stretch of `image_every_s` the image with most tags -> corners, and a tie to before

All goes through the code of recordings; what only a finished film tells is not there: no image is used because its
tags are seen seldom, a tag counts from the `fewest`-th image on that shows it, numbers are taken for names, and an
image is tied to the last one before it that shares tags with it, or with others that do. Other robots that are seen
are left out, since their keyframes are not known here, and so are depths.
"""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from msgspec import structs

from teamslam.errors import InputError
from teamslam.frontend.streams import TICKS_PER_S, TagCorners
from teamslam.frontend.tags.bent import straightened
from teamslam.frontend.tags.detect import Detector, Found
from teamslam.frontend.tags.rows import LOOKING
from teamslam.frontend.way import diagonal, standing
from teamslam.geometry import IntArray
from teamslam.io.bags.calibration import read_camera
from teamslam.io.bags.looked import refuse_other_size
from teamslam.io.bags.pictures import Picture
from teamslam.io.bags.seen import Book, Seen, View
from teamslam.io.bags.sighting_rows import parts_of
from teamslam.io.bags.team_file import RobotEntry, TeamFile, read_team_file
from teamslam.io.bags.videos import filmed_now
from teamslam.model import Dataset, Loss, Names, Table, landmark_number, pack, pose_key, whitening

Rows = Iterator[tuple[float, list[Table]]]


class LiveCamera:
    """The one camera of a robot without odometry of a team file, filming now. `head` are its channels, `robot` its
    number. InputError where the file describes no such robot."""

    def __init__(self, path: Path, device: str, robot: str | None = None) -> None:
        self.file = read_team_file(path)
        self.robot, self._entry = _robot_of(self.file, robot, path)
        entry = self._entry.camera[0]
        self.device, self._view = device, View(entry, read_camera(path.parent / entry.calibration), _tags([], []))
        self._loss = Loss(self.file.tags.loss, self.file.tags.loss_scale)
        names = Names(
            {} if self._entry.name == str(self.robot) else {self.robot: self._entry.name},
            {landmark_number(landmark.name): landmark.name for landmark in self.file.landmark},
        )
        none, keys = np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
        way = Table(self.robot, "odometry", "relative_pose", 3, keys, np.zeros((0, 12)), np.zeros((0, 6, 6)), none)
        seen = Table(
            self.robot, "landmarks", "corners", 3, keys, np.zeros((0, 24)), np.zeros((0, 8, 8)), none,
            entry.pose @ LOOKING, self._loss,
        )  # fmt: skip
        self.head = Dataset({self.robot: 3}, (way, seen), names, origin=str(path))
        self._next = {"odometry": 0, "landmarks": 0}
        self._shown = dict[int, int]()
        self._parts = list[tuple[set[str], int]]()  # tags that images tie together, and the last keyframe of them

    def goes_on_after(self, tables: Iterable[Table]) -> None:
        """Count rows on from those that were taken before; the camera may have been carried elsewhere since."""
        for table in tables:
            self._next[table.source] = max(self._next[table.source], int(table.ids.max(initial=-1)) + 1)

    def rows(self) -> Rows:
        """The rows of each image that is used, with its stamp [s]. InputError where there is no camera to film with, or
        its images are not of the size for which it is calibrated."""
        every, first, best = max(round(self._entry.image_every_s * TICKS_PER_S), 1), None, None
        looking = Detector(self.file.tags.looking())
        with closing(filmed_now(self.device, self._view.entry.rate_hz)) as film:
            for picture in film:
                found = looking(picture.grey())
                refuse_other_size(found.size, self._view.camera.size, self._view.entry.name)
                told = self._told(picture, found)
                if not len(told.tags):
                    continue
                tick = int(told.ticks[0])
                first = tick if first is None else first
                if best is not None and (tick - first) // every > (int(best.ticks[0]) - first) // every:
                    yield self._rows_of(best)
                    best = None
                best = told if best is None or len(told.tags) > len(best.tags) else best
        if best is not None:
            yield self._rows_of(best)

    def _told(self, picture: Picture, found: Found) -> View:
        """The detections in an image that count, each with its tag."""
        fewest = self.file.tags.fewest
        for number in np.unique(found.ids).tolist():
            self._shown[number] = self._shown.get(number, 0) + 1
        once = structs.replace(self.file.tags, fewest=1)
        corners = straightened(_tags([picture.tick], [found]), self._view.camera)
        seen = Seen(self._entry, None, None, (replace(self._view, corners=corners),), ())
        view = seen.with_tags(structs.replace(self.file, tags=once), Book()).views[0]
        counts = [not tag.is_robot and self._shown[tag.number] >= fewest for tag in view.tags]
        return view.select(np.array(counts, bool))

    def _rows_of(self, view: View) -> tuple[float, list[Table]]:
        """An image as rows, and the way to it from the image before that it hangs together with."""
        tick = int(view.ticks[0])
        seen = Seen(self._entry, None, None, (view,), ())
        alone = [structs.replace(self._entry, camera=[], name=other.name) for other in self.file.robot]
        team = [Seen(other, None, None, (), ()) for other in alone]
        team[self.robot - 1] = seen
        keyframes: dict[int, IntArray] = {self.robot: np.array([tick], np.int64)}
        tables = [self._tie(tick, {tag.carrier for tag in view.tags})]
        tables += [table for part in parts_of(seen, team, keyframes) for table in part.tables(team, self._loss)]
        counted = [self._counted(table) for table in tables if table is not None and len(table)]
        return tick / TICKS_PER_S, counted

    def _tie(self, tick: int, tags: set[str]) -> Table | None:
        """By the motion model; None for an image that shares tags with none before."""
        mine = [part for part in self._parts if part[0] & tags]
        self._parts = [part for part in self._parts if not part[0] & tags]
        self._parts.append((tags.union(*(known for known, _ in mine)), tick))
        if not mine:
            return None
        before = max(last for _, last in mine)
        pose, spread = standing(np.array([(tick - before) / TICKS_PER_S]), self._entry.motion)
        keys = pose_key(self.robot, np.array([[before, tick]]))
        noise = whitening(diagonal(spread))
        return Table(self.robot, "odometry", "relative_pose", 3, keys, pack(pose), noise, np.zeros(1, np.int64))

    def _counted(self, table: Table) -> Table:
        start = self._next[table.source]
        self._next[table.source] += len(table)
        return replace(table, ids=start + np.arange(len(table)))


def _tags(ticks: list[int], found: list[Found]) -> TagCorners:
    """The tags of images, as a recording has them."""
    none = Found(np.zeros(0, np.int64), np.zeros((0, 4, 2)), np.zeros(0, np.int64), (), np.zeros((0, 4)), (0, 0))
    one = found[0] if found else none
    frame = np.zeros(len(one.ids), np.int64)
    return TagCorners(np.array(ticks, np.int64), frame, one.ids, one.corners, one.hamming, one.families, one.widths)


def _robot_of(file: TeamFile, name: str | None, path: Path) -> tuple[int, RobotEntry]:
    known = {entry.name: (number, entry) for number, entry in enumerate(file.robot, 1)}
    if name is None and len(known) == 1:
        name = next(iter(known))
    if name not in known:
        raise InputError(f"say which robot this is, one of {', '.join(known)}; found {name or 'none'}", path=path)
    number, entry = known[name]
    if len(entry.camera) != 1 or entry.odometry is not None or entry.dim != 3:
        raise InputError(
            f"robot {name}: a camera that films now is the one camera of a robot in space without odometry; rows of "
            f"others come as lines",
            path=path,
            field="robot.camera",
        )
    return number, entry
