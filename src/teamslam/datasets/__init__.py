"""Public data sets: where each is, and what a download of one holds."""

from teamslam.datasets.catalogue import PublicSet, by_name, public_sets
from teamslam.datasets.checked import Found, found_in, readable_in
from teamslam.datasets.unpacked import unpack

__all__ = ["Found", "PublicSet", "by_name", "found_in", "public_sets", "readable_in", "unpack"]
