"""The figures of the paper's experiment: what there was to see, positions beside motion capture, how each method came
to its map.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import AnyArray, Array
from teamslam.viz.frame import legend_beside, panel
from teamslam.viz.marks import MOST_LABELS
from teamslam.viz.scene import Scene
from teamslam.viz.style import INK, LANDMARK_COLOUR, ROBOT_MARKERS, name, plain, robot_colour, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_POSITIONS = 150  # of each robot: more would hide each other


@dataclass(frozen=True, eq=False)
class View:
    """An image (h, w) of grey values, and the corners (m, 4, 2) [pixels] of the tags in it, with their names and what
    carries each ('': they are landmarks)."""

    image: AnyArray
    corners: Array
    tags: tuple[str, ...]
    on: tuple[str, ...]


@styled
def draw_views(views: Mapping[str, View], title: str = "", caption: str = "") -> "Figure":
    """What cameras saw, an image for each heading, its tags outlined and named. InputError where there is none."""
    if not views:
        raise InputError("no image to draw")
    from matplotlib.figure import Figure

    columns = min(2, len(views))
    rows = -(-len(views) // columns)
    figure = Figure(figsize=(0.4 + 5.0 * columns, 0.7 + 3.9 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, (heading, view) in zip(grid, views.items(), strict=False):
        axes.imshow(view.image, cmap="gray", vmin=0, vmax=255)
        for corners, tag, carrier in zip(view.corners, view.tags, view.on, strict=True):
            colour = robot_colour(0) if carrier else robot_colour(1)
            axes.plot(*np.concatenate([corners, corners[:1]]).T, color=colour, lw=1.2)
            axes.annotate(name(tag), (corners[:, 0].mean(), corners[:, 1].min()), xytext=(0, 4), ha="center",
                          textcoords="offset points", fontsize=8, color="white",
                          bbox={"facecolor": INK, "alpha": 0.75, "lw": 0, "pad": 1.5})  # fmt: skip
        carriers = [c for c in dict.fromkeys(view.on) if c]
        heading += f"; blue: tags on {', '.join(carriers)}" if carriers else ""
        axes.set_title(plain(heading), fontsize=8.5, fontweight="normal", color=INK)
    head = title or "What the robots saw"
    figure.suptitle(plain(f"{head}\n{caption}" if caption else head, 400), x=0.01, ha="left")
    return figure


@styled
def draw_positions(scene: Scene, title: str = "") -> "Figure":
    """Positions beside the truth from above, as the paper draws them: hollow as estimated, filled as they were. Where
    there are many, every n-th."""
    figure, axes = panel((7.4, 5.8), title or "Positions, estimated and true", scene.caption)
    axes.set_aspect("equal", adjustable="datalim")
    markers = [marker for marker in ROBOT_MARKERS if marker != "D"]
    for order, robot in enumerate(scene.robots):
        colour, marker = robot_colour(order), markers[order % len(markers)]
        keys = scene.map.trajectory_keys(robot)
        keys = keys[:: max(1, -(-len(keys) // MOST_POSITIONS))]
        called = f"robot {name(scene.map.names.robot(robot))}"
        if scene.truth is not None and (known := scene.truth.layout.contains(keys)).any():
            axes.plot(*scene.truth.positions(keys[known], 2).T, ls="none", marker=marker, ms=3.0, color=colour,
                      mew=0, zorder=3, label=f"{called}, truth")  # fmt: skip
        axes.plot(*scene.map.all_values.positions(keys, 2).T, ls="none", marker=marker, ms=6.5, mfc="none",
                  mec=colour, mew=0.8, zorder=4, label=called)  # fmt: skip
    landmarks = scene.map.landmark_keys
    if len(landmarks):
        if scene.truth is not None and (known := scene.truth.layout.contains(landmarks)).any():
            axes.plot(*scene.truth.positions(landmarks[known], 2).T, ls="none", marker="D", ms=4.0, mew=0,
                      color=LANDMARK_COLOUR, zorder=3, label="landmark, truth")  # fmt: skip
        places = scene.map.all_values.positions(landmarks, 2)
        axes.plot(*places.T, ls="none", marker="D", ms=8.5, mfc="none", mec=LANDMARK_COLOUR, mew=1.0,
                  zorder=4, label="landmark")  # fmt: skip
        for key, place in zip(landmarks[:MOST_LABELS].tolist(), places, strict=False):
            axes.annotate(name(scene.map.names.landmark(key)), place, xytext=(8, 6), textcoords="offset points",
                          fontsize=7.5, color=LANDMARK_COLOUR)  # fmt: skip
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(0.1)
    legend_beside(figure, *axes.get_legend_handles_labels())
    return figure
