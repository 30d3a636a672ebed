"""What a map costs: F over the raw measurements themselves, at the map as it is.

A join minimises sum_i |S^_i (-) H_i(G)|^2 in place of F = sum_i f_i(h_i(G)), so what it says of itself is not what its
map costs, and may lie below the least that F can be. This is F.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from teamslam.joining.exact.gap import point_of, rows_in
from teamslam.model import Submap, Table
from teamslam.solver import System


@dataclass(frozen=True)
class Cost:
    """`cost` F, the sum of losses; `chi2`, the sum of squared whitened residuals; both over `rows` numbers measured."""

    cost: float
    chi2: float
    rows: int


def cost_of(map: Submap, tables: Iterable[Table]) -> Cost:
    """What measurements cost at a map: those that are in it (see `rows_in`).

    Law: at the map of `full` it is the least there is, whoever made the map.
    """
    values = point_of(map)
    tables = rows_in(map, tables)
    system = System(values.layout, tables=tables, names=map.names)
    squared = [np.sum(system.whitened(number, values) ** 2, -1) for number in range(len(tables))]
    cost = sum(float(table.loss.cost(s).sum()) for table, s in zip(tables, squared, strict=True))
    return Cost(cost, sum(float(s.sum()) for s in squared), system.rows)
