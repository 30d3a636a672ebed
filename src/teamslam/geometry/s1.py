"""Directions in the plane: the circle, as one angle (..., 1) [rad], anticlockwise from the forward axis.

The sister file `s2.py` offers the same names for space. Laws: minus(plus(h, n), h) = n for |n| < pi, and
of(ray(z)) = z.
"""

import numpy as np

from teamslam.geometry.arrays import Array

SIZE = 1  # numbers in a direction
DOF = 1  # angles in one


def direction_basis(direction: Array) -> Array:
    """The unit tangent at unit vectors (..., 2) -> (..., 2, 1): towards rising angles."""
    return np.stack([-direction[..., 1], direction[..., 0]], -1)[..., None]


def of(points: Array) -> Array:
    """The directions of points (..., 2) as seen from the origin."""
    return np.asarray(np.arctan2(points[..., 1], points[..., 0]))[..., None]


def minus(z: Array, h: Array) -> Array:
    """z (-) h (..., 1): the turn from h to z, in [-pi, pi)."""
    return np.asarray((z - h + np.pi) % (2.0 * np.pi) - np.pi)


def plus(h: Array, n: Array) -> Array:
    """h (+) n: the z with z (-) h = n."""
    return np.asarray((h + n + np.pi) % (2.0 * np.pi) - np.pi)


def ray(z: Array) -> Array:
    """Unit vectors (..., 2)."""
    return np.stack([np.cos(z[..., 0]), np.sin(z[..., 0])], -1)


def angles(z: Array) -> Array:
    """As many angles (..., 1) as a direction has degrees of freedom: itself."""
    return z


def of_angles(angle: Array) -> Array:
    """The direction with these angles."""
    return angle


def cone(count: int, angle: float, rng: np.random.Generator) -> Array:
    """Unit vectors (count, 2), spread evenly over the full angle [rad] about the forward axis."""
    return ray(rng.uniform(-0.5, 0.5, (count, 1)) * angle)
