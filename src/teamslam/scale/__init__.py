"""Joins too large for one process: trees of joins on many workers."""

from teamslam.scale.cluster import Cluster, Processes, Workers
from teamslam.scale.tree import join_in_tree
from teamslam.scale.treemap import TreeMap, gather

__all__ = [
    "Cluster",
    "Processes",
    "TreeMap",
    "Workers",
    "gather",
    "join_in_tree",
]
