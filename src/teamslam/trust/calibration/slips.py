"""Noise that odometry has beyond what is stated: turns and shifts that nobody measured, in proportion to time.

    C_i  =  S C_i S  +  sum_k theta_k B_ik          S: the scales of what is stated

| slip  | B of an increment over dt with displacement t                               | theta [per second]  |
|-------|------------------------------------------------------------------------------|---------------------|
| turn  | turns at a uniform rate, each swinging the rest of the way about where it is | rad^2/s             |
| shift | displacements, alike in all directions                                       | m^2/s               |

(per step where poses are only counted). A model that leaves a straight drive next to no turn noise is the kind of
mistake that this finds: scaling what is next to nothing never mends it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Table
from teamslam.model.noise import ranks
from teamslam.model.sensors import pose_of
from teamslam.trust.calibration.resting import under_way

SLIPS = ("turn", "shift")


@dataclass(frozen=True, eq=False)
class Slips:
    """The unit covariances B (slips, m, rows, rows) of an odometry table, its `stated` covariance (m, rows, rows), and
    which rows are `moving` (m,), by which slips are known (see `resting`)."""

    units: Array
    stated: Array
    moving: BoolArray

    @classmethod
    def of(cls, table: Table, lasting: Array) -> "Slips | None":
        """Those of a table; None where it is no odometry, or says nothing in some direction."""
        if not table.is_odometry or not len(table) or (ranks(table.whitening) < table.whitening.shape[-1]).any():
            return None
        back = np.linalg.inv(np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:])))
        units = np.stack([_turn(table, lasting), _shift(table, lasting)])
        return cls(units, np.asarray(back @ np.swapaxes(back, 1, 2)), under_way(table))

    @cached_property
    def beside_stated(self) -> Array:
        """sum_i tr(C_i^-1 B_ik) over rows under way (slips,): how much one unit of each is beside what is stated."""
        return self.beside(np.ones(self.stated.shape[-1]))

    def beside(self, scale: Array) -> Array:
        """The same beside what is stated, `scale` (rows,) times as large."""
        stated = (self.stated * np.outer(scale, scale))[self.moving]
        return np.asarray(np.trace(np.linalg.solve(stated[None], self.units[:, self.moving]), axis1=2, axis2=3).sum(1))

    def covariance(self, scale: Array, theta: Array) -> Array:
        """C (m, rows, rows) for scales (rows,) and theta (slips,)."""
        return np.asarray(self.stated * np.outer(scale, scale) + np.tensordot(theta, self.units, 1))


def _turn(table: Table, lasting: Array) -> Array:
    way = pose_of(table.values, table.dim).translation
    if table.dim == 2:
        lever = np.stack([-way[:, 1], way[:, 0]], -1)[:, :, None]  # what a turn of one does to the far end
    else:
        x, y, z = way.T
        zero = np.zeros_like(x)
        lever = np.stack([np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], -2)
    angles = lever.shape[-1]
    across = np.swapaxes(lever, 1, 2)
    top = np.concatenate([lever @ across / 3.0, lever / 2.0], -1)
    low = np.concatenate([across / 2.0, np.broadcast_to(np.eye(angles), (len(way), angles, angles))], -1)
    return np.asarray(lasting[:, None, None] * np.concatenate([top, low], 1))


def _shift(table: Table, lasting: Array) -> Array:
    out = np.zeros((len(table), table.row.residual_rows(table.dim), table.row.residual_rows(table.dim)))
    out[:, : table.dim, : table.dim] = np.eye(table.dim)
    return out * lasting[:, None, None]
