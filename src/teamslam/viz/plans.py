"""What a team will know: planned ways and landmarks, with the 95 % regions that they will have."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import is_landmark, robot_of
from teamslam.viz.frame import legend_beside, panel
from teamslam.viz.maps import draw_regions, frame_name, legend_entries
from teamslam.viz.marks import draw_landmarks, explain
from teamslam.viz.scene import Scene
from teamslam.viz.style import LANDMARK_COLOUR, QUIET, name, robot_colour, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REGIONS = 12  # along a way: more would hide it


@styled
def draw_plan(scene: Scene, tags: Mapping[str, Array] | None = None) -> "Figure":
    """A plan seen from above: ways with regions along them, landmarks with theirs; a way that has no covariance in the
    scene is grey, since nothing ties it to the frame. `tags`: places (dim,) where one more landmark would help, by what
    is said of them. A new Figure, neither shown nor saved."""
    figure, axes = panel((7.4, 5.8), scene.title or "What the team will know", "\n".join(
        filter(None, (scene.caption, frame_name(scene)))))  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    for order, robot in enumerate(scene.robots):
        keys = scene.map.trajectory_keys(robot)
        known = np.array([int(key) in scene.covariances for key in keys])
        colour = robot_colour(order) if known.any() else QUIET
        path = scene.path(robot, 2)
        label = f"robot {name(scene.map.names.robot(robot))}" + ("" if known.any() else ", not tied")
        axes.plot(*path.T, color=colour, lw=1.1, ls="-" if known.any() else (0, (4, 2)), zorder=3, label=label)
        axes.plot(*path[0], marker="o", ms=5, color=colour, mec="white", mew=0.8, ls="none", zorder=7)
        axes.plot(*path[-1], marker="s", ms=4.5, color=colour, mec="white", mew=0.6, ls="none", zorder=5)
        draw_regions(axes, scene, _some(keys), colour)
    marks = scene.map.keys[is_landmark(scene.map.keys) & (robot_of(scene.map.keys) == 0)]
    draw_regions(axes, scene, marks, LANDMARK_COLOUR)
    draw_landmarks(axes, scene, 2)
    for number, (said, place) in enumerate((tags or {}).items()):
        label = "one more landmark would help" if number == 0 else "_more"
        axes.plot(*place[:2], marker="+", ms=10, mew=1.8, color="#D55E00", ls="none", zorder=9, label=label)
        axes.annotate(
            name(said),
            (float(place[0]), float(place[1])),
            xytext=(7, -10),
            textcoords="offset points",
            fontsize=7.5,
            zorder=9,
        )
    explain(axes, scene, 2)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(0.06)
    legend_beside(figure, *legend_entries(axes))
    return figure


def _some(keys: IntArray) -> IntArray:
    """Poses spread evenly along a way, its ends among them."""
    return np.asarray(keys[np.unique(np.linspace(0, len(keys) - 1, min(len(keys), REGIONS)).round().astype(int))])
