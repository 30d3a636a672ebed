"""A map as viewers of scenes in space take it: ways of poses in space, landmarks as balls of their 95 % regions.

What lies in a plane is at height 0, and its balls are flat.
"""

import colorsys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.maps.estimate import MapEstimate
from teamslam.model import chi2_quantile, index_of, is_landmark, is_pose, robot_of

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Course:
    """One robot's way: `stamps_s` (n,), rising, and poses in space (n,)."""

    robot: str
    colour: tuple[float, float, float]
    stamps_s: Array
    poses: Pose


@dataclass(frozen=True, eq=False)
class Balls:
    """The landmarks: `places` (m, 3); half axes (m, 3) [m] and their directions (m,) as turns of the axes, which are
    (0, 3) and none where no covariance is known."""

    names: list[str]
    places: Array
    half_axes: Array
    turns: Pose


def courses(found: MapEstimate) -> Iterator[Course]:
    """The robots' ways, in order of robots."""
    keys = found.values.layout.keys
    for number, robot in enumerate(found.robots):
        own = np.sort(keys[is_pose(keys) & (robot_of(keys) == robot)])
        stamps = np.asarray(found.names.stamps_s(own), float)
        yield Course(found.names.robot(robot), hue(number), stamps, found.values.poses_of(own, 3))


def balls(found: MapEstimate) -> Balls:
    """The landmarks with their regions."""
    layout = found.values.layout
    keys = layout.keys[is_landmark(layout.keys) & (layout.keys != found.base)]
    places, names = found.values.positions(keys, 3), [found.names.landmark(n) for n in index_of(keys).tolist()]
    at = layout.index(keys)
    if found.covariances is None or not len(keys):
        return Balls(names, places, np.zeros((0, 3)), Pose.identity(3, (0,)))
    dims = 2 + layout.kinds[at] % 2
    blocks = np.zeros((len(keys), 3, 3))
    for block, place, dim in zip(blocks, at.tolist(), dims.tolist(), strict=True):
        block[:dim, :dim] = found.covariances[place][:dim, :dim]
    radii, axes = ball(blocks, dims)
    return Balls(names, places, radii, Pose(axes, np.zeros((len(keys), 3))))


def ball(covariances: Array, dims: IntArray) -> tuple[Array, Array]:
    """Half axes (..., 3) [m], rising, and axes (..., 3, 3), a rotation, of the regions of Gaussians of `dims` (...)
    dimensions."""
    squares, axes = np.linalg.eigh(covariances)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[..., None]
    return np.sqrt(np.maximum(squares, 0.0) * chi2_quantile(CONFIDENCE, dims)[..., None]), axes


def hue(number: int) -> tuple[float, float, float]:
    """A colour (red, green, blue from 0 to 1) for each robot, neighbours far apart."""
    return colorsys.hsv_to_rgb((0.58 + 0.381966 * number) % 1.0, 0.75, 0.85)
