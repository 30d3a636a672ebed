"""The landmarks of a map, one by one, with what is known of each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.io.maps.estimate import MapEstimate
from teamslam.io.maps.space import CONFIDENCE
from teamslam.model import Dropped, index_of, is_landmark, is_pose, region_of


@dataclass(frozen=True, eq=False)
class Mark:
    """A landmark: its position (3,) [m], of which `dim` numbers are its own, its covariance (dim, dim) where that is
    known, and its pose where its orientation is."""

    name: str
    position: Array
    dim: int
    covariance: Array | None
    pose: Pose | None

    def region(self, dim: int) -> tuple[Array, Array]:
        """Half axes (dim,) [m] and their directions (dim, dim), in columns, of the region of 95 %; seen from above in
        two dimensions, flat in three where the landmark is of the plane. Half axes of 0 where nothing is known."""
        radii, axes = np.zeros(dim), np.eye(dim)
        own = min(dim, self.dim)
        if self.covariance is not None:
            radii[:own], axes[:own, :own] = region_of(self.covariance[:own, :own], CONFIDENCE)
            axes[:, 0] *= np.sign(np.linalg.det(axes))
        return radii, axes


def marks_in(found: MapEstimate) -> Iterator[Mark]:
    """The landmarks, in the order of their numbers."""
    layout = found.values.layout
    for key in np.sort(layout.keys[is_landmark(layout.keys)]).tolist():
        place = int(layout.index(key))
        dim, turned = 2 + int(layout.kinds[place]) % 2, bool(layout.kinds[place] < 2)
        yield Mark(
            name=found.names.landmark(int(index_of(key))),
            position=found.values.positions(np.array(key), 3),
            dim=dim,
            covariance=None if found.covariances is None else found.covariances[place][:dim, :dim],
            pose=found.values.pose(key) if turned else None,
        )


def lost(maps: Sequence[MapEstimate], poses: str, landmarks: str = "") -> tuple[Dropped, ...]:
    """What a format has no place for: of all poses, and of landmarks that are poses."""
    counts = [
        (sum(int(is_pose(found.values.layout.keys).sum()) for found in maps), poses),
        (sum(mark.pose is not None for found in maps for mark in marks_in(found)) if landmarks else 0, landmarks),
    ]
    return tuple(Dropped(count, reason) for count, reason in counts if count)
