"""Figures: records in, matplotlib figures out; never shown or saved here. matplotlib is imported when one is drawn."""

from teamslam.viz.convergence import draw_convergence
from teamslam.viz.errors import ErrorTrack, draw_consistency, draw_errors
from teamslam.viz.maps import draw_map, draw_maps, frame_name, plan_axes
from teamslam.viz.residuals import ResidualTrack, draw_residuals, draw_residuals_by_landmark
from teamslam.viz.scene import Scene, shape_of
from teamslam.viz.style import robot_colour, saved, styled

__all__ = [
    "ErrorTrack",
    "ResidualTrack",
    "Scene",
    "draw_consistency",
    "draw_convergence",
    "draw_errors",
    "draw_map",
    "draw_maps",
    "draw_residuals",
    "draw_residuals_by_landmark",
    "frame_name",
    "plan_axes",
    "robot_colour",
    "saved",
    "shape_of",
    "styled",
]
