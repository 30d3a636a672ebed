"""Maps as PLY, for viewers of point clouds and meshes: poses and landmarks as coloured points, ways as edges, the 95 %
ellipsoid of each landmark as a mesh around it.

    element vertex   x y z [m], red green blue, kind: 0 pose, 1 landmark, 2 the mesh of an ellipsoid
    element face     triangles of the ellipsoids         element edge    from a pose to the next of its robot

Comments name what stands in which rows. Landmarks of the plane are discs at height 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from teamslam.errors import in_words
from teamslam.geometry import Array, IntArray
from teamslam.io.files.text import write_text
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.marks import Mark, lost, marks_in
from teamslam.io.maps.space import courses
from teamslam.model import Dropped

POSE, LANDMARK, REGION = 0, 1, 2
MARKS = (122, 31, 92)
RINGS, AROUND = 7, 12  # of the mesh of an ellipsoid


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own, as text. Law: the vertices of kind 0 and 1 are the map's places."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        write_text(file, _scene(found).text())
    poses = "orientations, stamps and covariances of poses: PLY has no place for them"
    return lost(maps, poses, "orientations of landmarks: PLY has no place for them")


@dataclass
class _Ply:
    """Vertices, faces and edges, as they come."""

    vertices: list[str] = field(default_factory=list)
    faces: list[str] = field(default_factory=list)
    edges: list[str] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)

    def add(self, points: Array, colour: tuple[int, int, int], kind: int) -> int:
        """The number of the first of some vertices."""
        first, rest = len(self.vertices), " ".join(map(str, (*colour, kind)))
        self.vertices += [f"{x!r} {y!r} {z!r} {rest}" for x, y, z in points.tolist()]
        return first

    def text(self) -> str:
        head = [
            "ply",
            "format ascii 1.0",
            *(f"comment {comment}" for comment in self.comments),
            f"element vertex {len(self.vertices)}",
            *(f"property double {axis}" for axis in "xyz"),
            *(f"property uchar {name}" for name in ("red", "green", "blue", "kind")),
            f"element face {len(self.faces)}",
            "property list uchar int vertex_indices",
            f"element edge {len(self.edges)}",
            "property int vertex1",
            "property int vertex2",
            "end_header",
        ]
        return "\n".join([*head, *self.vertices, *self.faces, *self.edges, ""])


def _scene(found: MapEstimate) -> _Ply:
    ply = _Ply()
    for course in courses(found):
        red, green, blue = (round(255 * part) for part in course.colour)
        first = ply.add(course.poses.translation, (red, green, blue), POSE)
        last = first + len(course.stamps_s) - 1
        ply.edges += [f"{n} {n + 1}" for n in range(first, last)]
        ply.comments.append(f"vertices {first} to {last}: robot {in_words(course.robot)}")
    marks = list(marks_in(found))
    for mark in marks:
        at = ply.add(mark.position[None], MARKS, LANDMARK)
        ply.comments.append(f"vertex {at}: landmark {in_words(mark.name)}")
    for mark in marks:
        if mark.covariance is not None:
            points, triangles = _ellipsoid(mark)
            first = ply.add(points, MARKS, REGION)
            ply.faces += [f"3 {a} {b} {c}" for a, b, c in (triangles + first).tolist()]
    return ply


def _ellipsoid(mark: Mark) -> tuple[Array, IntArray]:
    """The mesh of a landmark's region: points (n, 3) and triangles (m, 3)."""
    ball, triangles = _ball()
    radii, axes = mark.region(3)
    return mark.position + (ball * radii) @ axes.T, triangles


def _ball() -> tuple[Array, IntArray]:
    """The unit ball as rings between two poles."""
    up = np.pi * np.arange(1, RINGS + 1) / (RINGS + 1)
    around = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.stack(
        [
            np.outer(np.sin(up), np.cos(around)),
            np.outer(np.sin(up), np.sin(around)),
            np.outer(np.cos(up), np.ones(AROUND)),
        ],
        -1,
    ).reshape(-1, 3)
    points = np.concatenate([[[0.0, 0.0, 1.0]], ring, [[0.0, 0.0, -1.0]]])
    here = 1 + np.arange(RINGS * AROUND).reshape(RINGS, AROUND)
    beside = np.roll(here, -1, 1)
    top = np.stack([np.zeros_like(here[0]), here[0], beside[0]], -1)
    sides = np.concatenate(
        [np.stack([here[:-1], here[1:], beside[:-1]], -1), np.stack([beside[:-1], here[1:], beside[1:]], -1)]
    ).reshape(-1, 3)
    end = np.stack([np.full_like(here[-1], len(points) - 1), beside[-1], here[-1]], -1)
    return points, np.concatenate([top, sides, end])
