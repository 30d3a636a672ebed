"""LOSSES: how strongly a measurement may pull, by name. Adding a loss is adding a row.

A loss acts on the squared whitened residual s = |W e|^2 of one measurement, with a scale k in sigmas. The cost is
F = sum rho(s), without a factor 1/2; the weight w = rho'(s) multiplies the measurement's information (iteratively
reweighted least squares), and it is this weight that the information of a finished submap carries.
Source: Zhang, "Parameter estimation techniques" (1997), in the form rho(s) ~ s near 0.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array


@dataclass(frozen=True)
class LossFunction:
    """One row of LOSSES: rho(s, k) and its slope in s."""

    cost: Callable[[Array, float], Array]
    weight: Callable[[Array, float], Array]


LOSSES: dict[str, LossFunction] = {
    "squared": LossFunction(lambda s, k: s, lambda s, k: np.ones_like(s)),
    "huber": LossFunction(
        lambda s, k: np.where(s <= k * k, s, 2.0 * k * np.sqrt(s) - k * k),
        lambda s, k: np.where(s <= k * k, 1.0, k / np.sqrt(np.maximum(s, k * k))),
    ),
    "cauchy": LossFunction(lambda s, k: k * k * np.log1p(s / (k * k)), lambda s, k: 1.0 / (1.0 + s / (k * k))),
    "geman_mcclure": LossFunction(lambda s, k: k * k * s / (k * k + s), lambda s, k: (k * k / (k * k + s)) ** 2),
}


@dataclass(frozen=True)
class Loss:
    """A choice from LOSSES with its scale k [sigmas]. InputError for an unknown name or a scale not above 0."""

    name: str = "squared"
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise InputError(f"unknown loss '{self.name}'; choose one of {', '.join(LOSSES)}")
        if not 0.0 < self.scale < np.inf:
            raise InputError(f"the scale of a loss is a positive number of sigmas, found {self.scale}")

    def cost(self, s: Array) -> Array:
        """rho(s) for squared whitened residuals s."""
        return np.asarray(LOSSES[self.name].cost(s, self.scale))

    def weight(self, s: Array) -> Array:
        """rho'(s), the factor on the measurement's information; in (0, 1]."""
        return np.asarray(LOSSES[self.name].weight(s, self.scale))


SQUARED = Loss()
