"""Bodies moved by twists: where they put their things, and how these go when the bodies move.

A twist [v, w] about a centre c moves a thing at p by v + w x (p - c). The first body of a truss stands still.
"""

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations


def put(frames: Pose, body: IntArray, places: Array) -> Array:
    """Where bodies see their things (n, d), under frames (s, bodies): (s, n, d)."""
    return np.asarray((frames.rotation[:, body] @ places[..., None])[..., 0] + frames.translation[:, body])


def swept(arms: Array, unit: float = 1.0) -> Array:
    """How things at `arms` (s, n, d) from the centre go with its twist: (s, n, d, unknowns of one); v in units of
    `unit`."""
    s, n, d = arms.shape
    group = rotations(d)
    out = np.zeros((s, n, d, d + group.DOF))
    out[..., :d] = unit * np.eye(d)
    for k, axis in enumerate(np.eye(group.DOF)):
        out[..., d + k] = arms @ group.hat(axis).T
    return out


def by_body(moved: Array, body: IntArray, bodies: int) -> Array:
    """The same by the twists of all bodies but the first: (s, n, d, (bodies - 1) unknowns of one)."""
    s, n, d, dof = moved.shape
    out = np.zeros((s, n, d, bodies, dof))
    out[:, np.arange(n), :, body] = np.moveaxis(moved, 1, 0)
    return out[..., 1:, :].reshape(s, n, d, (bodies - 1) * dof)
