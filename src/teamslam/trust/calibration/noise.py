"""The noise of one table as it is taken to be: what calibration moves, and all that is asked of it.

C_i  =  S C_i S + slips         S: scales of the deviations that are stated, part by part
C_i  =  L_i L_i' ,  W_i = L_i^-1
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.model import Table
from teamslam.model.noise import ranks
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
            return Noise(self.table, np.linalg.inv(root), root, _deviation(root))
        return Noise(self.table, self.whitening / scale, scale[:, None] * self.root, scale * self.deviation)

    @property
    def all_whitening(self) -> Array:
        """W of every row (m, r, r)."""
        return np.broadcast_to(self.whitening, (len(self.table), *self.whitening.shape[1:]))

    def errors(self, white: Array) -> Array:
        """Errors (m, r, draws) of white noise."""
        return np.asarray(self.root @ white)

    def weights(self, errors: Array) -> Array:
        """What the loss weighs rows by (m, draws), with errors (m, r, draws)."""
        if self.table.loss.name == "squared":
            return np.ones((len(errors), errors.shape[-1]))
        return self.table.loss.weight(np.sum((self.whitening @ errors) ** 2, 1))

    def sizes(self, errors: Array) -> Array:
        """Errors (m, r, draws) in their deviations, weighed by the loss, each draw by its own size."""
        counted = np.where(self.deviation > 0.0, 1.0 / np.where(self.deviation > 0.0, self.deviation, 1.0), 0.0)
        return np.asarray(np.sqrt(self.weights(errors))[:, None] * errors * counted[..., None])


def _deviation(root: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(root**2, -1)))
