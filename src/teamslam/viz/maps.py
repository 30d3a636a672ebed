"""Maps: where the robots went, where the landmarks are, how sure we are, and where they truly were.

What is drawn, and how:

    estimate   lines in robot colours, landmarks as diamonds, all in the frame of the map's base pose
    regions    95 % ellipses of landmarks and of the robots' starts, from the marginal covariances
    truth      dark dashes and hollow diamonds, brought into the frame of the map
    sightings  thin lines between robots that saw each other
    frames     each robot's first pose as a pair of axes: what the team did not know before
"""

import textwrap
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.model import WORLD
from teamslam.viz.frame import between, legend_beside, panel
from teamslam.viz.marks import MOST_SIGHTINGS, draw_landmarks, draw_sightings, draw_weakest, explain
from teamslam.viz.scene import CONFIDENCE, Scene, shape_of
from teamslam.viz.sides import Side, turned
from teamslam.viz.style import INK, LANDMARK_COLOUR, METHOD_NAMES, TRUTH_COLOUR, name, plain, robot_colour, styled

WIDEST = 62  # letters above one of several maps
MOST_NAMED = 12  # robots in a legend: more would not fit beside the map

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled
def draw_map(scene: Scene, side: Side | None = None) -> "Figure":
    """A map of the whole team, from above or in space as the robots move, from a `side` where one is named; a new
    Figure, neither shown nor saved."""
    method = METHOD_NAMES.get(scene.method, scene.method)
    who = f"{len(scene.robots)} robot" + "s" * (len(scene.robots) != 1)
    title = scene.title or f"Map of {who} by {method}"
    caption = "\n".join(filter(None, (scene.caption, frame_name(scene))))
    spatial = scene.is_spatial or side is not None
    return _in_space(scene, title, caption, side) if spatial else _from_above(scene, title, caption)


def _from_above(scene: Scene, title: str, caption: str) -> "Figure":
    figure, axes = panel((7.4, 5.8), title, caption)
    plan_axes(axes, scene)
    legend_beside(figure, *legend_entries(axes))
    return figure


def _in_space(scene: Scene, title: str, caption: str, side: Side | None) -> "Figure":
    from matplotlib.figure import Figure

    from teamslam.viz.space import filled, space_axes

    figure = Figure(figsize=(7.4, 5.8))
    axes: Any = figure.add_subplot(projection="3d")
    space_axes(axes, scene)
    turned(axes, side)
    filled(axes, *between(figure, title, caption, *legend_entries(axes)))
    return figure


@styled
def draw_maps(scenes: Mapping[str, Scene], title: str, *, columns: int = 2) -> "Figure":
    """Several maps seen from above in one figure: a panel for each title in `scenes`, with the scene's caption.

    Raises InputError where there is no scene to draw.
    """
    if not scenes:
        raise InputError("no map to draw")
    from matplotlib.figure import Figure

    columns = min(columns, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(0.4 + 4.6 * columns, 0.7 + 5.2 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    kinds: dict[str, Any] = {}
    for axes, (heading, scene) in zip(grid, scenes.items(), strict=False):
        plan_axes(axes, scene)
        lines = list(_beside(scene))
        axes.set_title(plain("\n".join(lines), 240), fontsize=8.0, fontweight="normal", color=INK)
        axes.annotate(plain(heading), (0, 1), xycoords="axes fraction", xytext=(0, 9 + 11 * len(lines)),
                      fontweight="bold", textcoords="offset points", fontsize=9.5)  # fmt: skip
        handles, labels = legend_entries(axes)
        common = zip(labels, handles, strict=True)
        kinds |= {
            label.split("\n")[0].rstrip(","): handle for label, handle in common if not label.startswith("robot ")
        }
    for axes in grid[len(scenes) :]:
        axes.set_visible(False)
    figure.suptitle(plain(title), x=0.01, ha="left")
    figure.legend(kinds.values(), kinds.keys(), loc="outside lower center", ncols=min(len(kinds), 6))
    return figure


def _beside(scene: Scene) -> Iterator[str]:
    """What stands above one of several maps, in lines no longer than it is wide: its caption, and what holds for it."""
    lines = [scene.caption]
    if scene.covariances and (times := scene.magnification(2)) > 1:
        lines.append(f"{CONFIDENCE:.0%} regions drawn {times} times larger")
    if (step := scene.visible_sightings(MOST_SIGHTINGS)[1]) > 1:
        lines.append(f"1 in {step} sightings of robots drawn")
    for line in lines:
        yield from textwrap.wrap(line, WIDEST) or [""]


def plan_axes(axes: "Axes", scene: Scene) -> None:
    """Draw a map seen from above on given axes, for figures of several panels."""
    axes.set_aspect("equal", adjustable="datalim")
    draw_sightings(axes, scene, 2)
    for order, robot in enumerate(scene.robots):
        colour, path = robot_colour(order), scene.path(robot, 2)
        few = len(path) <= 40
        axes.plot(*scene.true_path(robot, 2).T, color=TRUTH_COLOUR, lw=0.7, ls=(0, (4, 2)), alpha=0.7, zorder=2)
        axes.plot(*path.T, color=colour, lw=1.3 if few else 0.9, marker="o" if few else None, ms=3.2, alpha=0.9,
                  zorder=3, label=f"robot {name(scene.map.names.robot(robot))}")  # fmt: skip
        axes.plot(*path[-1], marker="s", ms=4.5, color=colour, mec="white", mew=0.6, zorder=5)
        _frame(axes, scene, robot, colour)
        draw_regions(axes, scene, scene.map.trajectory_keys(robot)[:1], colour)
    draw_regions(axes, scene, scene.map.landmark_keys, LANDMARK_COLOUR)
    draw_landmarks(axes, scene, 2)
    draw_weakest(axes, scene, 2)
    explain(axes, scene, 2)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.margins(0.06)


def frame_name(scene: Scene) -> str:
    """Whose frame a map is written in, in words."""
    if scene.map.base == WORLD:
        return "in the world frame"
    return f"in the frame of {scene.map.names.describe(scene.map.base)}"


# --- parts of a map, in the plane and in space ----------------------------------------------------------------------


def legend_entries(axes: Any) -> tuple[list[Any], list[str]]:
    """Legend entries, the robots first; of many robots some, and how many more there are."""
    entries = list(zip(*axes.get_legend_handles_labels(), strict=True))
    robots = [entry for entry in entries if entry[1].startswith("robot ")]
    if len(robots) > MOST_NAMED:
        more = len(robots) - MOST_NAMED
        robots = [*robots[:MOST_NAMED], (robots[-1][0], f"... and {more} more robots")]
    rest = [entry for entry in entries if not entry[1].startswith("robot ")]
    handles, labels = zip(*robots, *rest, strict=True)
    return list(handles), list(labels)


# --- parts of a plan ------------------------------------------------------------------------------------------------


def _frame(axes: "Axes", scene: Scene, robot: int, colour: str) -> None:
    """A robot's first pose: forward as an arrow, left as a bar."""
    pose = scene.map.all_values.pose(int(scene.map.trajectory_keys(robot)[0]))
    start, length = pose.translation[:2], 0.045 * scene.extent(2)
    for axis, head in enumerate(("-|>", "-")):
        look = {"arrowstyle": head, "color": INK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xy=tuple(start + length * pose.rotation[:2, axis]), xytext=tuple(start), zorder=6,
                      arrowprops=look)  # fmt: skip
    axes.plot(*start, marker="o", ms=5, color=colour, mec="white", mew=0.8, zorder=7)


def draw_regions(axes: "Axes", scene: Scene, keys: IntArray, colour: str) -> None:
    """The 95 % regions of those variables whose covariance is known, seen from above."""
    from matplotlib.collections import EllipseCollection

    centres, covariances = scene.regions(keys, 2)
    radii, vectors = shape_of(covariances)
    minor, major = 2.0 * scene.magnification(2) * radii.T
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    axes.add_collection(
        EllipseCollection(major, minor, angles, units="xy", offsets=centres, offset_transform=axes.transData,
                          facecolors=(colour, 0.16), edgecolors=colour, linewidths=0.9, zorder=4),
        autolim=False,
    )  # fmt: skip
    reach = 0.5 * np.sqrt(np.square(vectors) @ np.square(np.stack([minor, major], -1))[..., None])[..., 0]
    axes.update_datalim(np.concatenate([centres - reach, centres + reach]))
