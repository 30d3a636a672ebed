"""The noise of one table as it is taken to be: what calibration moves, and all that is asked of it.

C_i  =  S C_i S + slips         S: scales of the deviations that are stated, part by part
C_i  =  L_i L_i' ,  W_i = L_i^-1
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Table
from teamslam.model.noise import ranks
from teamslam.trust.calibration.products import by_rows, inverse_of_lower
from teamslam.trust.calibration.slips import Slips


@dataclass(frozen=True, eq=False)
class Noise:
    """`whitening` W (m, r, r) of the rows of a `table`, `root` L and the `deviation` (m, r) of each number; any m may
    be 1, for all rows alike. What a row does not measure is in none."""

    table: Table
    whitening: Array
    root: Array
    deviation: Array

    @classmethod
    def stated(cls, table: Table) -> "Noise":
        """The noise that the log states."""
        whitening = np.asarray(table.whitening)
        whole = (ranks(whitening) == whitening.shape[-1]).all()
        root = np.asarray(np.linalg.inv(whitening) if whole else np.linalg.pinv(whitening), float)
        return cls(table, whitening, root, _deviation(root))

    def scaled(self, scale: Array, slips: Slips | None, theta: Array) -> "Noise":
        """The same with deviations `scale` (r,) times as large, and with slips."""
        if slips is not None and theta.any():
            root = np.asarray(np.linalg.cholesky(slips.covariance(scale, theta)), float)
            return Noise(self.table, inverse_of_lower(root), root, _deviation(root))
        return Noise(self.table, self.whitening / scale, scale[:, None] * self.root, scale * self.deviation)

    @property
    def all_whitening(self) -> Array:
        """W of every row (m, r, r)."""
        return np.broadcast_to(self.whitening, (len(self.table), *self.whitening.shape[1:]))

    def errors(self, white: Array) -> Array:
        """Errors (m, r, draws) of white noise."""
        return by_rows(self.root, white)

    def weights(self, errors: Array) -> Array:
        """What the loss weighs rows by (m, draws), with errors (m, r, draws)."""
        if self.table.loss.name == "squared":
            return np.ones((len(errors), errors.shape[-1]))
        whitened = by_rows(self.whitening, errors)
        return self.table.loss.weight(np.einsum("mrk,mrk->mk", whitened, whitened))

    def sizes(self, errors: Array) -> Array:
        """Errors (m, r, draws) in their deviations, weighed by the loss, each draw by its own size."""
        counted = np.where(self.deviation > 0.0, 1.0 / np.where(self.deviation > 0.0, self.deviation, 1.0), 0.0)
        sizes: Array = errors * counted[..., None]
        if self.table.loss.name != "squared":
            sizes *= np.sqrt(self.weights(errors))[:, None]
        return sizes

    def squares(self, errors: Array, rows: BoolArray) -> Array:
        """The mean squares (r, draws) of their sizes over some of the rows."""
        sizes = self.sizes(errors)
        sizes = sizes if rows.all() else sizes[rows]
        return np.asarray(np.einsum("mrk,mrk->rk", sizes, sizes) / len(sizes))


def _deviation(root: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(root**2, -1)))
