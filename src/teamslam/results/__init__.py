"""Run folders: what a run leaves on disk, written whole or not at all, and read back to draw and compare."""

from teamslam.results.drawing import draw_record, drawing
from teamslam.results.figures import figures_of
from teamslam.results.folder import read_run, with_residuals, write_record, write_run
from teamslam.results.plotting import plot
from teamslam.results.record import Record
from teamslam.results.whole import is_run, made_folder, refuse_to_overwrite, whole_folder

__all__ = [
    "Record",
    "draw_record",
    "drawing",
    "figures_of",
    "is_run",
    "made_folder",
    "plot",
    "read_run",
    "refuse_to_overwrite",
    "whole_folder",
    "with_residuals",
    "write_record",
    "write_run",
]
