"""Streams: what a recording holds on one topic, as arrays with a tick (a microsecond) for each message.

A stream is what a reader of recordings, or a live robot, hands over; rows of tables are made of it.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import AnyArray, Array, IntArray, Pose

TICKS_PER_S = 1_000_000


@dataclass(frozen=True, eq=False)
class Track:
    """Where a frame was: `poses` (n,) of `child` in `parent` at `ticks` (n,), in the order in which they were recorded.

    `covariances` (n, 6, 6) as [x, y, z, rotation about the parent's x, y, z], as ROS has them; None where none came.
    """

    ticks: IntArray
    poses: Pose
    parent: str = ""
    child: str = ""
    covariances: Array | None = None

    def __len__(self) -> int:
        return len(self.ticks)

    def select(self, index: AnyArray) -> "Track":
        """The messages at a mask or index."""
        rows = np.arange(len(self))[index]
        noise = None if self.covariances is None else self.covariances[rows]
        return Track(self.ticks[rows], self.poses[rows], self.parent, self.child, noise)


@dataclass(frozen=True, eq=False)
class TagCorners:
    """Tags in images: `frames` (k,) are the ticks of all images, those without a tag included; tag `ids` (m,) was seen
    in the image number `frame` (m,), with its corners (m, 4, 2) [pixels].

    Corners run bottom left, bottom right, top right, top left of the tag as it is printed upright, and pixel (0, 0) is
    the centre of the first pixel. `families` (m,) are names ('' where the recording says none), `hamming` (m,) the bits
    that were mended. `widths` (m, 4) [pixels] are those of their edges, from each corner to the next; None where a
    detector said nothing of them.
    """

    frames: IntArray
    frame: IntArray
    ids: IntArray
    corners: Array
    hamming: IntArray
    families: tuple[str, ...]
    widths: Array | None = None

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def ticks(self) -> IntArray:
        """When each was seen (m,)."""
        return self.frames[self.frame]

    def select(self, index: AnyArray) -> "TagCorners":
        """The detections at a mask or index; the images stay."""
        rows = np.arange(len(self))[index]
        families = tuple(self.families[row] for row in rows.tolist())
        widths = None if self.widths is None else self.widths[rows]
        return TagCorners(
            self.frames, self.frame[rows], self.ids[rows], self.corners[rows], self.hamming[rows], families, widths
        )
