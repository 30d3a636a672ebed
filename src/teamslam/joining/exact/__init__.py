"""Joins that end at the full least squares, and how far from it a join is."""

from teamslam.joining.exact.cost import Cost, cost_of
from teamslam.joining.exact.exactness import with_exactness
from teamslam.joining.exact.full import full
from teamslam.joining.exact.gap import AtMap
from teamslam.joining.exact.rounds import exact_join

__all__ = [
    "AtMap",
    "Cost",
    "cost_of",
    "exact_join",
    "full",
    "with_exactness",
]
