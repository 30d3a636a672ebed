"""One map as nodes of a viser scene: what stands still, and what moves with the time."""

from typing import Any

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.maps.space import ball
from teamslam.report import Page, Part, Rows, Way

LANDMARK, TRUTH, SEEN, WRONG, WEAK = (122, 31, 92), (90, 90, 90), (150, 150, 150), (200, 30, 30), (184, 134, 11)
MOST_NAMES, MOST_LINES = 80, 4000
THIN = 0.02  # of its longest half axis: how flat a region of the plane is drawn


class Nodes:
    """The nodes of one part, by kind: ways, robots, landmarks, names, regions, truth, sightings, seen, second,
    rejected, doubted, weakest.

    Robots are so much `paler`, from 0 to 1, as tells one run from another. `moved` puts what moves where it is at a
    time, `shown` says which kinds and which robots are to be seen.
    """

    def __init__(
        self, scene: Any, path: str, page: Page, part: Part, number: int, frame: Pose, size: float, *, paler: float
    ) -> None:
        self.scene, self.path, self.page, self.part, self.size, self.paler = scene, path, page, part, size, paler
        self.rows = [rows for rows in page.rows if rows.part == number]
        self.rejected = [rows for rows in page.rejected if rows.part == number]
        self.fixed: dict[tuple[str, int], Any] = {}
        self.kinds: set[str] = set()
        self.hidden: set[int] = set()
        self.at: tuple[float, float, float] = (0.0, 1.0, 1.0)
        scene.add_frame(path, show_axes=False, wxyz=frame.quaternion_wxyz(), position=frame.translation)
        scene.add_frame(f"{path}/origin", axes_length=0.04 * size, axes_radius=0.003 * size, origin_radius=0.0)
        self._still()

    def _still(self) -> None:
        marks = self.part.marks
        for way in self.part.ways:
            self._lines("ways", way.robot, _pairs(way.places), self._colour(way.robot), 2.5)
            known = np.isfinite(way.truth).all(-1)
            if known.any():
                self._lines("truth", way.robot, _pairs(way.truth[known]), TRUTH, 1.2)
            self.fixed["robots", way.robot] = self.scene.add_mesh_simple(
                f"{self.path}/robots/{way.robot}", *_arrow(0.03 * self.size), color=self._colour(way.robot),
                flat_shading=True, side="double",
            )  # fmt: skip
            self.fixed["robots", -1 - way.robot] = self.scene.add_label(
                f"{self.path}/robots/{way.robot}/name", self.page.robots[way.robot], position=(0, 0, 0.03 * self.size)
            )
        if len(marks.places):
            self._points("landmarks", marks.places, LANDMARK, 0.006)
        if (known := np.isfinite(marks.truth).all(-1)).any():
            self._points("truth", marks.truth[known], TRUTH, 0.004)
        if marks.doubted.any():
            self._points("doubted", marks.places[marks.doubted], WRONG, 0.012)
        if (two := np.isfinite(marks.second).all(-1)).any():
            self._lines("second", -1, np.stack([marks.places[two], marks.second[two]], 1), LANDMARK, 1.0)
        if len(self.part.weakest):
            self._lines("weakest", -1, self.part.weakest, WEAK, 2.0)
        for place, name in list(zip(marks.places, marks.names, strict=True))[:MOST_NAMES]:
            key = ("names", len(self.fixed))
            self.fixed[key] = self.scene.add_label(f"{self.path}/names/{key[1]}", name, position=place)

    def shown(self, kinds: set[str], hidden: set[int]) -> None:
        """Show these kinds of things, of all robots but those hidden."""
        self.kinds, self.hidden = kinds, hidden
        for (kind, robot), node in self.fixed.items():
            owner = -1 - robot if kind == "robots" and robot < 0 else robot
            node.visible = kind in kinds and not (kind in ("ways", "robots", "truth") and owner in hidden)
        self.moved(*self.at)

    def moved(self, time: float, window: float, times: float) -> None:
        """Put everything where it is at a time, with the sightings of the `window` before, regions `times` larger."""
        self.at = (time, window, times)
        for way in self.part.ways:
            node = self.fixed["robots", way.robot]
            node.position, node.wxyz = _place(way, np.array([time]))[0], _turn(way, time)
        self._regions(time, times)
        for rows in self.rows:
            self._sightings("sightings", rows, self._colour(rows.robot), time, window)
        for rows in self.rejected:
            self._sightings("rejected", rows, WRONG, time, window)
        self._seen(time, window)

    def _regions(self, time: float, times: float) -> None:
        marks, ways = (
            self.part.marks,
            [w for w in self.part.ways if len(w.region_stamps) and w.robot not in self.hidden],
        )
        latest = [max(int(np.searchsorted(w.region_stamps, time, side="right")) - 1, 0) for w in ways]
        blocks = [*marks.covariances, *(w.regions[n] for w, n in zip(ways, latest, strict=True))]
        centres = [*marks.places, *(_place(w, np.array([time]))[0] for w in ways)]
        if not blocks:
            return
        dims = np.full(len(blocks), 3 if self.part.spatial else 2)
        half, axes = ball(np.array(blocks), dims)
        half = np.maximum(times * half, THIN * times * half.max(-1, keepdims=True) + 1e-9)
        turns = Pose(axes, np.zeros((len(blocks), 3))).quaternion_wxyz()
        colours = [LANDMARK] * len(marks.places) + [self._colour(w.robot) for w in ways]
        look = {"cast_shadow": False, "receive_shadow": False, "lod": "off", "visible": "regions" in self.kinds}
        self.fixed["regions", -1] = self.scene.add_batched_meshes_simple(
            f"{self.path}/regions", *_sphere(), batched_wxyzs=turns, batched_positions=np.array(centres, np.float32),
            batched_scales=half.astype(np.float32), batched_colors=np.array(colours, np.uint8),
            batched_opacities=np.full(len(blocks), 0.35, np.float32), **look,
        )  # fmt: skip

    def _sightings(self, kind: str, rows: Rows, colour: tuple[int, int, int], time: float, window: float) -> None:
        first, last = np.searchsorted(rows.stamps, [time - window, time], side="right")
        way = next((way for way in self.part.ways if way.robot == rows.robot), None)
        n = np.arange(first, last)[rows.target[first:last] >= 0]
        n = n[:: max(1, -(-len(n) // MOST_LINES))]
        on = kind in self.kinds and rows.robot not in self.hidden
        path = f"{self.path}/{kind}/{rows.robot}-{rows.source}"
        if way is None or not len(n) or not on:
            self._gone(path)
            return
        ends = np.stack([_place(way, rows.stamps[n]), self.part.marks.places[rows.target[n]]], 1)
        self._moving(path, ends, colour)

    def _seen(self, time: float, window: float) -> None:
        seen = self.part.sightings
        later = seen.stamps.max(-1) if len(seen.stamps) else np.zeros(0)
        first, last = np.searchsorted(later, [time - window, time], side="right")
        ways = {way.robot: way for way in self.part.ways}
        ends = [
            [_place(ways[int(robot)], stamp[None])[0] for robot, stamp in zip(pair, stamps, strict=True)]
            for pair, stamps in zip(seen.robots[first:last], seen.stamps[first:last], strict=True)
            if not self.hidden & set(pair.tolist())
        ][:MOST_LINES]
        if ends and "seen" in self.kinds:
            self._moving(f"{self.path}/seen", np.array(ends), SEEN)
        else:
            self._gone(f"{self.path}/seen")

    def _moving(self, path: str, ends: Array, colour: tuple[int, int, int]) -> None:
        self.fixed["moving", hash(path)] = self.scene.add_line_segments(
            path, ends.astype(np.float32), colour, thickness=1.2, thickness_units="screen"
        )

    def _gone(self, path: str) -> None:
        node = self.fixed.pop(("moving", hash(path)), None)
        if node is not None:
            node.remove()

    def _lines(self, kind: str, robot: int, ends: Array, colour: tuple[int, int, int], thickness: float) -> None:
        if len(ends):
            self.fixed[kind, robot] = self.scene.add_line_segments(
                f"{self.path}/{kind}/{robot}", ends.astype(np.float32), colour, thickness=thickness,
                thickness_units="screen",
            )  # fmt: skip

    def _points(self, kind: str, places: Array, colour: tuple[int, int, int], size: float) -> None:
        self.fixed[kind, -2] = self.scene.add_point_cloud(
            f"{self.path}/{kind}/points", places.astype(np.float32), colour, point_size=size * self.size,
            point_shape="diamond", precision="float32",
        )  # fmt: skip

    def _colour(self, robot: int) -> tuple[int, int, int]:
        code = self.page.colours[robot % len(self.page.colours)]
        red, green, blue = (int(code[n : n + 2], 16) for n in (1, 3, 5))
        return self._pale(red), self._pale(green), self._pale(blue)

    def _pale(self, part: int) -> int:
        return round(part + self.paler * (255 - part))


def _pairs(places: Array) -> Array:
    """A line as its pieces (n - 1, 2, 3)."""
    return np.stack([places[:-1], places[1:]], 1)


def _place(way: Way, stamps: Array) -> Array:
    """Where a robot is at stamps (n,): (n, 3)."""
    return np.stack([np.interp(stamps, way.stamps, axis) for axis in way.places.T], -1)


def _turn(way: Way, time: float) -> Array:
    """A rotation (w, x, y, z) that looks along where the robot does."""
    ahead = way.forward[max(int(np.searchsorted(way.stamps, time, side="right")) - 1, 0)]
    up = np.array([0.0, 0.0, 1.0]) if abs(ahead[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    left = np.cross(up, ahead)
    left /= np.linalg.norm(left)
    return Pose(np.stack([ahead, left, np.cross(ahead, left)], -1), np.zeros(3)).quaternion_wxyz()


def _arrow(size: float) -> tuple[Array, IntArray]:
    """A pyramid whose tip is ahead: corners and faces."""
    corners = size * np.array([[1.0, 0, 0], [-0.5, 0.5, 0], [-0.5, -0.5, 0], [-0.5, 0, 0.5]])
    return corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def _sphere(around: int = 16, down: int = 9) -> tuple[Array, IntArray]:
    """A ball of radius 1: corners and faces."""
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), np.linspace(0.0, np.pi, down))
    corners = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1).reshape(-1, 3)
    n, m = np.meshgrid(np.arange(around), np.arange(down - 1))
    a, b, c, d = (i.ravel() for i in (m * around + n, m * around + (n + 1) % around, (m + 1) * around + n,
                                      (m + 1) * around + (n + 1) % around))  # fmt: skip
    return corners.astype(np.float32), np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)])
