"""Planes of tags become rows of the model `relative_pose` that say three numbers: how far off the tag is along its
normal, and how it is tilted. Along the plane, and about its normal, their information is zero.

    z         of the two poses that the corners tell, the one that lies more nearly in the plane m . P = 1, tilted and
              moved along its line of sight until it lies in it
    h         m_h = n / (n . p),   n = R a,   p = R c + T,   with a the tag's normal and c its middle in the body (R, T)
    J e       m - m_h to first order in e = z (-) h:   T = zT - e_T,   R = zR (1 - [e_w])
    W         L^-1 J in three rows, LL' the plane's covariance; the others are zero

What the corners lend to z are the directions in which the row says nothing, so nothing is counted twice.
"""

import numpy as np

from teamslam.frontend.tags.rows import Tag
from teamslam.geometry import Array, BoolArray, Pose, concatenate, so3
from teamslam.geometry.resection import resect
from teamslam.model import pack


def standing_in(corners: tuple[Array, Array], plane: Array, tags: list[Tag]) -> Pose:
    """How bodies stood to the eye (m,): of the two poses that corners tell, the one whose tag lies more nearly in its
    plane m (m, 3). `corners` are values and whitening of rows of the model `corners`, in the same axes."""
    values, whitening = corners
    rays, points = (values[:, part].reshape(-1, 4, 3) for part in (slice(0, 12), slice(12, 24)))
    both = resect(rays, points, whitening)
    unit = plane / np.linalg.norm(plane, axis=-1, keepdims=True)
    normals = both.poses.rotation @ _seats(tags).rotation[:, None, :, 2:]
    tilted = np.sum(normals[..., 0] * unit[:, None], -1)  # -1: as the plane, and seen from its front
    second = np.isfinite(both.costs[:, 1]) & (tilted[:, 1] < tilted[:, 0])
    each, which = np.arange(len(values)), second.astype(np.int64)
    return Pose(both.poses.rotation[each, which], both.poses.translation[each, which])


def plane_rows(standing: Pose, planes: tuple[Array, Array], tags: list[Tag]) -> tuple[Array, Array, BoolArray]:
    """Values (m, 12) and whitening (m, 6, 6) of the model `relative_pose`, and which rows (m,) hold: a plane behind the
    eye, or that a tag's line of sight lies in, says nothing. `standing` (m,) is how bodies stood to the eye as corners
    tell (`standing_in`), `planes` m (m, 3) and their covariances in the same axes, at the same instant."""
    plane, covariance = planes
    seats = _seats(tags)
    seen = standing @ seats
    reach = np.sum(plane * seen.translation, -1)
    good = reach > 0.1  # of the way that the corners tell, at most ten times
    unit = plane / np.linalg.norm(plane, axis=-1, keepdims=True)
    lain = Pose(_turned(seen.rotation, -unit), seen.translation / np.where(good, reach, 1.0)[:, None])
    z = lain @ seats.inverse()
    root = np.linalg.cholesky(np.where(good[:, None, None], covariance, np.eye(3)))
    W = np.zeros((len(tags), 6, 6))
    W[:, :3] = np.linalg.solve(root, _slopes(z, seats))
    return pack(z), W, good


def _seats(tags: list[Tag]) -> Pose:
    """Where tags sit on what carries them (m,)."""
    origin = Pose.identity(3)
    return concatenate([Pose.identity(3, (0,)), *((origin if t.pose is None else t.pose)[None] for t in tags)])


def _turned(rotation: Array, normal: Array) -> Array:
    """Rotations (m, 3, 3) turned by the shortest way so that their z is along unit vectors (m, 3)."""
    axis = np.cross(rotation[..., 2], normal)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.sum(rotation[..., 2] * normal, -1, keepdims=True))
    return np.asarray(so3.exp(axis / np.maximum(sine, 1e-12) * angle) @ rotation)


def _slopes(z: Pose, seats: Pose) -> Array:
    """J (m, 3, 6) of m - m_h by z (-) h."""
    n = (z.rotation @ seats.rotation[..., 2:])[..., 0]
    p = z.act(seats.translation)
    s = np.sum(n * p, -1)[:, None, None]
    zero = np.zeros((len(z), 3, 3))
    dn = np.concatenate([zero, z.rotation @ so3.hat(seats.rotation[..., 2])], -1)
    dp = np.concatenate([zero - np.eye(3), z.rotation @ so3.hat(seats.translation)], -1)
    ds = p[:, None] @ dn + n[:, None] @ dp
    return np.asarray(-(dn / s - n[..., None] @ ds / s**2))
