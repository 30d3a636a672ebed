"""Runs looked at in the browser, in space and over time: the only room that knows viser (extra `view`)."""

from teamslam.viewer.placed import Placed, placed
from teamslam.viewer.served import Viewer

__all__ = ["Placed", "Viewer", "placed"]
