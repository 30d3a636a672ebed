"""Submaps made from logs, and joined into one map."""

from teamslam.joining.build import build, build_alternatives, build_choices, build_with_solution, split
from teamslam.joining.condense import Interior, condense, condense_partially, expand, separators
from teamslam.joining.exact import AtMap, Cost, cost_of, exact_join, full, with_exactness
from teamslam.joining.join import (
    ORDERS,
    Component,
    Exactness,
    Joined,
    Unbuilt,
    accounted,
    accounted_raw,
    join,
    join_by_tree,
    join_sequentially,
)
from teamslam.joining.start.from_map import from_map

__all__ = [
    "ORDERS",
    "AtMap",
    "Component",
    "Cost",
    "Exactness",
    "Interior",
    "Joined",
    "Unbuilt",
    "accounted",
    "accounted_raw",
    "build",
    "build_alternatives",
    "build_choices",
    "build_with_solution",
    "condense",
    "condense_partially",
    "cost_of",
    "exact_join",
    "expand",
    "from_map",
    "full",
    "join",
    "join_by_tree",
    "join_sequentially",
    "separators",
    "split",
    "with_exactness",
]
