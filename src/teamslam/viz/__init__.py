"""Figures: records in, matplotlib figures out; never shown or saved here. matplotlib is imported when one is drawn."""

from teamslam.viz.clocks import Estimated, draw_clocks
from teamslam.viz.coloured import draw_error_map, draw_residual_map
from teamslam.viz.compared import ErrorCloud, draw_comparison
from teamslam.viz.convergence import draw_convergence
from teamslam.viz.errors import ErrorTrack, draw_consistency, draw_errors
from teamslam.viz.experiment import View, draw_positions, draw_views
from teamslam.viz.maps import draw_map, draw_maps, frame_name, plan_axes
from teamslam.viz.plans import draw_plan
from teamslam.viz.residuals import ResidualTrack, draw_residuals, draw_residuals_by_landmark
from teamslam.viz.scene import Scene, shape_of
from teamslam.viz.sides import SIDES, Side, side_of
from teamslam.viz.style import robot_colour, saved, styled

__all__ = [
    "SIDES",
    "ErrorCloud",
    "ErrorTrack",
    "Estimated",
    "ResidualTrack",
    "Scene",
    "Side",
    "View",
    "draw_clocks",
    "draw_comparison",
    "draw_consistency",
    "draw_convergence",
    "draw_error_map",
    "draw_errors",
    "draw_map",
    "draw_maps",
    "draw_plan",
    "draw_positions",
    "draw_residual_map",
    "draw_residuals",
    "draw_residuals_by_landmark",
    "draw_views",
    "frame_name",
    "plan_axes",
    "robot_colour",
    "saved",
    "shape_of",
    "side_of",
    "styled",
]
