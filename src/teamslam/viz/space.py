"""Maps in space: as `maps`, with 95 % ellipsoids as wire balls."""

from typing import Any

import numpy as np

from teamslam.geometry import Array
from teamslam.viz.marks import draw_landmarks, draw_sightings, explain
from teamslam.viz.scene import Scene, shape_of
from teamslam.viz.style import LANDMARK_COLOUR, TRUTH_COLOUR, name, robot_colour


def space_axes(axes: Any, scene: Scene) -> None:
    """Draw a map in space on given 3D axes."""
    draw_sightings(axes, scene, 3)
    for order, robot in enumerate(scene.robots):
        colour, path = robot_colour(order), scene.path(robot, 3)
        axes.plot(*scene.true_path(robot, 3).T, color=TRUTH_COLOUR, lw=0.7, ls=(0, (4, 2)), alpha=0.7)
        axes.plot(*path.T, color=colour, lw=1.1, label=f"robot {name(scene.map.names.robot(robot))}")
        axes.plot(*path[:1].T, ls="none", marker="o", ms=5, color=colour, mec="white", mew=0.6)
        axes.plot(*path[-1:].T, ls="none", marker="s", ms=4.5, color=colour, mec="white", mew=0.6)
    draw_landmarks(axes, scene, 3)
    for centre, covariance in scene.regions(scene.map.landmark_keys, 3):
        ball = _ellipsoid(centre, covariance, scene.magnification(3))
        axes.plot_wireframe(*ball, color=LANDMARK_COLOUR, lw=0.35, alpha=0.6)
    explain(axes, scene, 3)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("z [m]")
    _equal_scale(axes)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.fill = False


def _ellipsoid(centre: Array, covariance: Array, scale: float) -> Array:
    """A grid on the surface of the region, (3, 13, 7)."""
    u, v = np.mgrid[0 : 2 * np.pi : 13j, 0 : np.pi : 7j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1)
    radii, vectors = shape_of(covariance)
    return np.moveaxis(centre + ball @ (vectors * radii * scale).T, -1, 0)


def _equal_scale(axes: Any) -> None:
    """One scale on all three axes, filling the figure."""
    ranges = np.array([np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())])
    axes.set_box_aspect(ranges / ranges.max(), zoom=1.15)
