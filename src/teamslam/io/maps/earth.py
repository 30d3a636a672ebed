"""A map laid on the Earth by an anchor: its ways as lines, its landmarks as points, their 95 % regions as outlines.

Coordinates are longitude, latitude [degrees, WGS 84] and height above the ellipsoid [m], as GeoJSON and KML have them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teamslam.geometry import Anchor, Array
from teamslam.io.maps.estimate import MapEstimate
from teamslam.io.maps.marks import Mark, marks_in
from teamslam.io.maps.space import courses

DEGREES, METRES = 10, 4  # digits: a hundredth of a millimetre
CORNERS = 36
TURNED = "orientations of landmarks: points on the Earth have none"
POSES = "orientations and covariances of poses: lines on the Earth have places only"

Coordinates = list[list[float]]


@dataclass(frozen=True)
class Feature:
    """One thing on the Earth: its `kind` ('robot', 'landmark' or 'region'), its name, where it is; `known` is what else
    is to be said of it; `colour` of robots, red, green and blue from 0 to 1."""

    kind: str
    name: str
    coordinates: Coordinates
    known: dict[str, Any] = field(default_factory=dict)
    colour: tuple[float, float, float] = (0.48, 0.12, 0.36)


def features(found: MapEstimate, anchor: Anchor) -> Iterator[Feature]:
    """Robots, then landmarks, each with its region where its covariance is known."""
    for course in courses(found):
        line = _coordinates(anchor.geodetic(course.poses.translation))
        line = line if len(line) > 1 else line * 2  # a line has two places or more
        yield Feature("robot", course.robot, line, {"stamps_s": course.stamps_s.tolist()}, course.colour)
    for mark in marks_in(found):
        place = _coordinates(anchor.geodetic(mark.position[None]))
        sigmas = {} if mark.covariance is None else {"sigma_m": np.sqrt(np.diag(mark.covariance)).tolist()}
        yield Feature("landmark", mark.name, place, sigmas)
        if mark.covariance is not None:
            yield Feature("region", mark.name, _coordinates(anchor.geodetic(_outline(mark))))


def _outline(mark: Mark) -> Array:
    """The outline (n, 3) of a landmark's region seen from above, closed, anticlockwise."""
    radii, axes = mark.region(2)
    angles = 2.0 * np.pi * (np.arange(CORNERS + 1) % CORNERS) / CORNERS
    ring = (np.stack([np.cos(angles), np.sin(angles)], -1) * radii) @ axes.T
    return np.concatenate([mark.position[:2] + ring, np.full((len(ring), 1), mark.position[2])], -1)


def _coordinates(geodetic: Array) -> Coordinates:
    digits = np.round(geodetic[:, [1, 0, 2]], DEGREES)
    digits[:, 2] = np.round(digits[:, 2], METRES)
    return [[float(number) for number in row] for row in digits.tolist()]
