"""What the map knows of the landmarks about the pose at which a filter begins: told when one is seen.

    y_j | y_s = m_j + G (y_s - m_s)      G = S_js S_ss^-1      left over: S_jj - G S_sj

of the map's Gaussian (m, S) over the pose where the filter begins and the landmarks about it; s are those that the
filter holds already, j one that it sees now for the first time. The filter that takes it in then holds what it would
hold if it had carried it from the start, to first order and at a cost that goes with what it has seen, not with what
may be seen. The arithmetic is one call of the native kernel (cpp/telling.hpp).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array
from teamslam.model import Kind
from teamslam.robot.order import Order
from teamslam.solver import Gaussian


@dataclass(frozen=True, eq=False)
class Ahead:
    """The map's Gaussian: `frame`, the key of the pose (or WORLD) that it is written in; `order`, the pose and then
    landmarks, none of which turns; `state`, `covariance` (n, n)."""

    frame: int
    order: Order
    state: Array
    covariance: Array

    @cached_property
    def numbers(self) -> Gaussian:
        """As the kernel takes it."""
        dim = Kind(int(self.order.kinds[0])).dim
        return Gaussian(self.order.natively, self.order.turns, np.zeros(dim), self.state, self.covariance)
