"""Run folders: what a run leaves on disk, written whole or not at all, and read back to draw and compare."""

from teamslam.results.figures import figures_of
from teamslam.results.folder import read_run, write_run
from teamslam.results.record import Record

__all__ = ["Record", "figures_of", "read_run", "write_run"]
