"""Maps in space: as `maps`, with 95 % ellipsoids as wire balls; of many, the great circles about their axes."""

from typing import Any

import numpy as np

from teamslam.geometry import Array
from teamslam.viz.frame import pen_of
from teamslam.viz.marks import draw_landmarks, draw_sightings, draw_weakest, explain
from teamslam.viz.scene import Scene, shape_of
from teamslam.viz.style import LANDMARK_COLOUR, TRUTH_COLOUR, name, robot_colour

MOST_BALLS = 200  # drawn with meridians and parallels: of more, these would be one grey
FLAT, LOW = 0.01, 0.08  # of the longest side: no box is flatter, and on one that is lower there is room for no tick
TICKS = 8  # on the longest side
MARGIN, FITTED = 6.0, 4  # dots about a box with its words; times that its size is fitted to them


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
    draw_weakest(axes, scene, 3)
    wires = region_wires(*scene.regions(scene.map.landmark_keys, 3), scene.magnification(3))
    axes.plot(*wires.T, color=LANDMARK_COLOUR, lw=0.35, alpha=0.6)
    explain(axes, scene, 3)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("z [m]")
    equal_scale(axes)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.fill = False


def region_wires(centres: Array, covariances: Array, scale: float) -> Array:
    """Lines on the surfaces of regions, one after another with a break (nan) after each: (points, 3)."""
    radii, axes = shape_of(covariances)
    lines = _meridians_and_parallels() if len(centres) <= MOST_BALLS else _great_circles()
    ends = np.cumsum([len(line) for line in lines])
    points = centres[:, None] + np.concatenate(lines) @ np.swapaxes(axes * radii[:, None] * scale, -1, -2)
    return np.insert(points, ends, np.nan, axis=1).reshape(-1, 3)


def _meridians_and_parallels() -> list[Array]:
    u, v = np.mgrid[0 : 2 * np.pi : 13j, 0 : np.pi : 7j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1)
    return [*ball, *np.swapaxes(ball, 0, 1)]


def _great_circles() -> list[Array]:
    u = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], -1)
    return [np.roll(circle, axis, -1) for axis in range(3)]


def filled(axes: Any, low: float, high: float) -> None:
    """The box of 3D axes, with all its words, as large as fits between two heights of its figure, in the middle."""
    width, height = size = axes.figure.bbox.size
    middle, room = 0.5 * size * [1.0, low + high], size * [1.0, high - low] - 2 * MARGIN
    side = (high - low) * height  # of the square by which the distances of words from the box are measured
    for part in axes.get_children():
        part.set_clip_on(False)  # the box may reach beyond it

    def centred(at: Array) -> None:
        axes.set_position([*((at - 0.5 * side) / size), side / width, side / height])

    shares, zoom = box_shares(axes), 0.5
    centred(middle)
    for _ in range(FITTED):  # words are as large as they are, whatever the zoom
        axes.set_box_aspect(shares, zoom=zoom)
        zoom *= float(np.min(room / np.ptp(_drawn(axes), axis=0)))
    axes.set_box_aspect(shares, zoom=zoom)
    stand = _drawn(axes)
    centred(2.0 * middle - 0.5 * (stand.min(0) + stand.max(0)))


def _drawn(axes: Any) -> Array:
    """Where the corners of a box and of all words at it are drawn, (n, 2) [dots]."""
    from itertools import product

    pen = pen_of(axes.figure)
    axes.apply_aspect()
    axes.M = axes.get_proj()
    axes.invM = np.linalg.inv(axes.M)
    corners = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())))
    seen = np.insert(corners, 3, 1.0, axis=1) @ axes.M.T
    stand = [axes.transData.transform(seen[:, :2] / seen[:, 3:])]
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        shown = [tick.label1 for tick in axis._update_ticks()] + [axis.label]
        axis.draw(pen)  # puts its words where they belong
        stand += [text.get_window_extent(pen).get_points() for text in shown if text.get_visible() and text.get_text()]
    return np.concatenate(stand)


def box_shares(axes: Any) -> Array:
    """How long the three sides of a box are, the longest 1, none shorter than FLAT."""
    ranges = np.array([np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())])
    return np.asarray(np.maximum(ranges / ranges.max(), FLAT))


def equal_scale(axes: Any, zoom: float = 1.15) -> None:
    """One scale on all three axes, filling the figure; as many ticks on each as there is room for."""
    from matplotlib.ticker import MaxNLocator

    shares = box_shares(axes)
    axes.set_box_aspect(shares, zoom=zoom)
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shares.tolist(), strict=True):
        axis.labelpad = 5.0
        if share < LOW:
            axis.set_ticks([])
            axis.label.set_visible(False)
        else:
            axis.set_major_locator(MaxNLocator(max(round(TICKS * share), 2), steps=[1, 2, 5, 10]))
