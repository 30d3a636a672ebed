"""Cameras calibrated by views of a flat board.

board        boards of ChArUco and AprilGrid: where their corners are
find         corners of a board in images; by OpenCV
bundle       a camera and the board's poses from many views, by least squares
determined   what these views leave open, by other models and by halves of the views
"""

from teamslam.frontend.boards.board import AprilGrid, Board, Charuco
from teamslam.frontend.boards.bundle import Fit, fit
from teamslam.frontend.boards.determined import Calibration, Candidate, calibrate
from teamslam.frontend.boards.find import Finder, Views

__all__ = [
    "AprilGrid",
    "Board",
    "Calibration",
    "Candidate",
    "Charuco",
    "Finder",
    "Fit",
    "Views",
    "calibrate",
    "fit",
]
