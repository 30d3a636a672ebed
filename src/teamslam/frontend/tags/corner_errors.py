"""Residuals of corners at many poses at once: what a search that tries poses asks for again and again.

The formula is that of the model `corners`; what of it belongs to a sighting is made once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, s2
from teamslam.model import Table

NEAR = 1e-12  # sine of the angle to what was seen


@dataclass(frozen=True, eq=False)
class CornerErrors:
    """Sightings (m,) of corners: `rays` (m, 4, 3) that were seen and their tangents `across` (m, 4, 2, 3), `places` of
    the corners in their bodies (m, 4, 3), `whitening` (m, 8, 8), and the sensor in the observer's body."""

    rays: Array
    across: Array
    places: Array
    whitening: Array
    sensor: Pose

    @classmethod
    def of(cls, tables: Sequence[Table]) -> "CornerErrors":
        """Those of tables of the model `corners`, one after another."""
        rows = np.concatenate([np.zeros((0, 24)), *(t.values for t in tables)])
        rays = np.ascontiguousarray(rows[:, :12]).reshape(-1, 4, 3)
        white = [np.broadcast_to(t.whitening, (len(t), 8, 8)) for t in tables]
        seats = [Pose.identity(3) if t.sensor is None else t.sensor.lift(3) for t in tables]
        turns = [np.broadcast_to(seat.rotation, (len(t), 3, 3)) for t, seat in zip(tables, seats, strict=True)]
        moves = [np.broadcast_to(seat.translation, (len(t), 3)) for t, seat in zip(tables, seats, strict=True)]
        return cls(
            rays,
            np.swapaxes(s2.direction_basis(rays), -1, -2),
            np.ascontiguousarray(rows[:, 12:]).reshape(-1, 4, 3),
            np.concatenate([np.zeros((0, 8, 8)), *white]),
            Pose(np.concatenate([np.zeros((0, 3, 3)), *turns]), np.concatenate([np.zeros((0, 3)), *moves])),
        )

    def at(self, rows: IntArray, observers: Pose, targets: Pose) -> Array:
        """Whitened residuals (c, k, 8) of some sightings (k,) at poses of both ends, (c, k), (1, k) or (c, 1) each.

        Law: as the tables have them, `whitening @ (z (-) h)`.
        """
        eye_T = (observers.rotation @ self.sensor.translation[rows, :, None])[..., 0] + observers.translation
        eye_R = observers.rotation @ self.sensor.rotation[rows]
        there = self.places[rows] @ np.swapaxes(targets.rotation, -1, -2)
        seen = (there + (targets.translation - eye_T)[..., None, :]) @ eye_R
        with np.errstate(invalid="ignore"):
            h = seen / np.sqrt(np.sum(seen * seen, -1, keepdims=True))
        off = (self.across[rows] @ h[..., None])[..., 0]
        sine, cosine = np.sqrt(np.sum(off * off, -1)), np.sum(self.rays[rows] * h, -1)
        scale = np.where(sine > NEAR, np.arctan2(sine, cosine) / np.maximum(sine, NEAR), 1.0)
        error = -scale[..., None] * off
        opposite = (cosine < 0.0) & (sine <= NEAR)
        if opposite.any():
            error[opposite] = -np.pi, 0.0
        return np.asarray((self.whitening[rows] @ error.reshape(*error.shape[:-2], 8, 1))[..., 0])
