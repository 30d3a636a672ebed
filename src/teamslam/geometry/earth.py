"""Places on the Earth from a map: an anchor says where its frame lies on the ellipsoid of WGS 84.

A map's frame is flat; laid tangent to the ellipsoid at the anchor, its z axis is up, and its x axis points `turn_deg`
anticlockwise from east. Positions go over Earth-centred coordinates, so the Earth's curvature is not neglected.

Source: National Imagery and Mapping Agency, "Department of Defense World Geodetic System 1984", TR8350.2.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry.arrays import Array

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
ROUNDS = 8  # each leaves a thousandth of the error, or less


@dataclass(frozen=True)
class Anchor:
    """Where the origin of a map lies [degrees, metres above the ellipsoid], and how far its x axis is turned
    anticlockwise from east. Raises InputError for what is nowhere on the Earth."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0
    turn_deg: float = 0.0

    def __post_init__(self) -> None:
        numbers = (self.latitude_deg, self.longitude_deg, self.height_m, self.turn_deg)
        if not (np.isfinite(numbers).all() and abs(self.latitude_deg) < 90.0 and abs(self.longitude_deg) <= 180.0):
            raise InputError(
                f"an anchor is a latitude within 90 degrees, a longitude within 180, a height [m], a turn [degrees]; "
                f"found {', '.join(f'{number:g}' for number in numbers)}",
                field="anchor",
            )

    def geodetic(self, positions: Array) -> Array:
        """Positions (..., 2 or 3) [m] of the map as latitude, longitude [degrees] and height [m], (..., 3)."""
        flat = np.zeros((*positions.shape[:-1], 3))
        flat[..., : positions.shape[-1]] = positions
        return _to_geodetic(self._origin + flat @ self._axes.T)

    def local(self, geodetic: Array) -> Array:
        """Positions (..., 3) [m] in the map. Law: local(geodetic(p)) = p."""
        return np.asarray((_to_centred(np.asarray(geodetic, float)) - self._origin) @ self._axes)

    @property
    def _origin(self) -> Array:
        return _to_centred(np.array([self.latitude_deg, self.longitude_deg, self.height_m]))

    @property
    def _axes(self) -> Array:
        """The axes of the map in Earth-centred coordinates, as columns."""
        latitude, longitude, turn = np.radians([self.latitude_deg, self.longitude_deg, self.turn_deg])
        east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
        up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        north = np.cross(up, east)
        forward, left = np.cos(turn) * east + np.sin(turn) * north, np.cos(turn) * north - np.sin(turn) * east
        return np.stack([forward, left, up], -1)


def _to_centred(geodetic: Array) -> Array:
    """Earth-centred coordinates (..., 3) [m]."""
    latitude, longitude = np.radians(geodetic[..., 0]), np.radians(geodetic[..., 1])
    height = geodetic[..., 2]
    across = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    level = (across + height) * np.cos(latitude)
    up = (across * (1.0 - ECCENTRICITY_2) + height) * np.sin(latitude)
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), up], -1)


def _to_geodetic(centred: Array) -> Array:
    """Latitude, longitude [degrees] and height [m]: fixed-point rounds on the latitude."""
    level = np.hypot(centred[..., 0], centred[..., 1])
    latitude = np.arctan2(centred[..., 2], level * (1.0 - ECCENTRICITY_2))
    for _ in range(ROUNDS):
        across = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(centred[..., 2] + ECCENTRICITY_2 * across * np.sin(latitude), level)
    across = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    height = level * np.cos(latitude) + centred[..., 2] * np.sin(latitude) - SEMI_MAJOR_M**2 / across
    longitude = np.arctan2(centred[..., 1], centred[..., 0])
    return np.stack([np.degrees(latitude), np.degrees(longitude), height], -1)
