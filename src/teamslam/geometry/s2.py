"""Directions in space: the sphere, as unit vectors (..., 3).

The sister file `s1.py` offers the same names for the plane. The difference of two is a vector of their tangent plane,
in the axes that rising azimuth and rising elevation have at the first. Laws: minus(plus(h, n), h) = n away from the
poles, and of(ray(z)) = z.
"""

import numpy as np

from teamslam.geometry import so3
from teamslam.geometry.arrays import Array

SIZE = 3  # numbers in a direction
DOF = 2  # angles in one


def direction_basis(direction: Array) -> Array:
    """Two unit tangents at unit vectors (m, 3) -> (m, 3, 2): towards rising azimuth, towards rising elevation.

    Within a hair of the poles, where azimuth has no meaning, the first tangent is that of the x axis.
    """
    x, y = direction[..., 0], direction[..., 1]
    flat = np.hypot(x, y)
    pole = flat < 1e-9
    safe = np.where(pole, 1.0, flat)
    east = np.stack([np.where(pole, 0.0, -y / safe), np.where(pole, 1.0, x / safe), np.zeros_like(x)], -1)
    return np.stack([east, np.cross(direction, east)], -1)


def of(points: Array) -> Array:
    """The directions of points (..., 3) as seen from the origin; not a number of the origin itself."""
    with np.errstate(invalid="ignore"):
        return np.asarray(points / np.linalg.norm(points, axis=-1, keepdims=True))


def minus(z: Array, h: Array) -> Array:
    """z (-) h (..., 2): minus the sphere's Log of h at z, in the axes of z; (-pi, 0) where h is opposite to z, and
    all ways are as short."""
    across = np.swapaxes(direction_basis(z), -1, -2) @ h[..., None]  # B(z)' h
    sine = np.linalg.norm(across[..., 0], axis=-1)
    cosine = np.sum(z * h, -1)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)
    opposite = (cosine < 0.0) & (sine <= 1e-12)
    return np.asarray(np.where(opposite[..., None], [-np.pi, 0.0], -scale[..., None] * across[..., 0]))


def plus(h: Array, n: Array) -> Array:
    """h (+) n: the z (m, 3) with z (-) h = n (m, 2).

    That is measured in the east and north of z, which is sought: h = c z - s (n_east east + n_north north), with
    c = cos |n|, s = sin |n| / |n|. Its third row is an equation for the elevation of z alone, the others give the
    azimuth.
    """
    size = np.linalg.norm(n, axis=-1)
    c, s = np.cos(size), np.sinc(size / np.pi)
    east, north = s * n[:, 0], s * n[:, 1]
    reach = np.hypot(c, north)
    elevation = np.arctan2(north, c) + np.arcsin(np.clip(h[:, 2] / reach, -1.0, 1.0))
    ahead = c * np.cos(elevation) + north * np.sin(elevation)
    azimuth = np.arctan2(h[:, 1], h[:, 0]) + np.arctan2(east, ahead)
    # Within |n| of a pole there may be no such z: azimuth turns too fast. There n is taken in the east and north of h.
    lost = (np.abs(h[:, 2]) > reach) | (np.cos(elevation) < 0.0)
    away = (direction_basis(h) @ n[..., None])[..., 0]
    turned = (so3.exp(np.cross(h, away)) @ h[..., None])[..., 0]
    return np.where(lost[:, None], turned, of_angles(np.stack([azimuth, elevation], -1)))


def ray(z: Array) -> Array:
    """Unit vectors (..., 3): itself."""
    return z


def angles(z: Array) -> Array:
    """Azimuth and elevation (..., 2) [rad]."""
    flat = np.hypot(z[..., 0], z[..., 1])
    return np.stack([np.arctan2(z[..., 1], z[..., 0]), np.arctan2(z[..., 2], flat)], -1)


def of_angles(angle: Array) -> Array:
    """The direction with these azimuths and elevations (..., 2)."""
    azimuth, elevation = angle[..., 0], angle[..., 1]
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)


def cone(count: int, angle: float, rng: np.random.Generator) -> Array:
    """Unit vectors (count, 3), spread evenly over the cone of a full angle [rad] about the forward axis."""
    ahead = rng.uniform(np.cos(0.5 * angle), 1.0, count)
    around = rng.uniform(-np.pi, np.pi, count)
    across = np.sqrt(1.0 - ahead**2)
    return np.stack([ahead, across * np.cos(around), across * np.sin(around)], -1)
