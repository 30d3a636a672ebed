"""Algorithm 2: submaps joined into one map, at once or in another order."""

from teamslam.joining.join.account import Unbuilt, accounted, accounted_raw
from teamslam.joining.join.join import Component, Exactness, Joined, join
from teamslam.joining.join.orders import ORDERS, join_by_tree, join_sequentially

__all__ = [
    "ORDERS",
    "Component",
    "Exactness",
    "Joined",
    "Unbuilt",
    "accounted",
    "accounted_raw",
    "join",
    "join_by_tree",
    "join_sequentially",
]
