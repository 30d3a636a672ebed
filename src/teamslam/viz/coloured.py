"""Maps coloured by a number: how far each pose and landmark is from the truth, and what measurements leave where.

From above, or in space from a side; bright is small, dark is large, and the bar names the numbers.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.viz.frame import panel
from teamslam.viz.scene import Scene
from teamslam.viz.sides import Side, turned
from teamslam.viz.style import INK, QUIET, TRUTH_COLOUR, plain, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAP = "viridis_r"
HIGH = 0.98  # of the numbers lie below the dark end: a few that are far off would leave all others bright
MOST_PIECES = 1500  # of one robot's way
WORST = 60  # sightings drawn as lines
LARGE = 3.0  # sigmas that such a sighting leaves, and more


@styled
def draw_error_map(scene: Scene, side: Side | None = None) -> "Figure":
    """Ways and landmarks coloured by their distance from the truth. InputError where it is not known."""
    dim = 2 if side is None and not scene.is_spatial else 3
    ways = {robot: _errors(scene, scene.map.trajectory_keys(robot)) for robot in scene.robots}
    marks = _errors(scene, scene.map.landmark_keys)
    known = np.concatenate([*ways.values(), marks])
    if not np.isfinite(known).any():
        raise InputError("no errors to draw: the truth of nothing in the map is known")
    title = f"{scene.title or 'Map'}: errors"
    figure, axes = _axes(title, scene.caption, dim)
    norm = _norm(known)
    for robot in scene.robots:
        axes.plot(*scene.true_path(robot, dim).T, color=TRUTH_COLOUR, lw=0.5, ls=(0, (4, 2)), alpha=0.6)
        _coloured_line(axes, scene.path(robot, dim), ways[robot], norm, dim)
    _coloured_marks(axes, scene.map.all_values.positions(scene.map.landmark_keys, dim), marks, norm)
    return _finished(figure, axes, norm, "distance from the truth [m]", side)


@styled
def draw_residual_map(
    scene: Scene, places: Array, sizes: Array, targets: IntArray, side: Side | None = None
) -> "Figure":
    """Where measurements leave how much: poses coloured by the median size of the rows taken there, landmarks by that
    of the rows that saw them, the worst sightings as lines. `places` (n, 3): where rows were taken; `sizes` (n,) of
    their residuals in sigmas; `targets` (n,): the place of the landmark seen among the map's, or -1.

    InputError where there is no row.
    """
    if not len(sizes):
        raise InputError("no residuals to draw: the verdict rests on no rows")
    dim = 2 if side is None and not scene.is_spatial else 3
    keys = scene.map.landmark_keys
    of_marks = np.array([_median(sizes[targets == n]) for n in range(len(keys))])
    where, of_places = _by_place(places, sizes, 0.012 * scene.extent(3))
    worst = np.argsort(-np.where(targets >= 0, sizes, -1.0), kind="stable")[:WORST]
    worst = worst[(targets[worst] >= 0) & (sizes[worst] > LARGE)]
    title = f"{scene.title or 'Map'}: residuals"
    figure, axes = _axes(title, "\n".join(filter(None, (scene.caption, _lines_said(sizes, targets)))), dim)
    norm = _norm(np.concatenate([of_marks, of_places]))
    for robot in scene.robots:
        axes.plot(*scene.path(robot, dim).T, color=QUIET, lw=0.4, alpha=0.6)
    flat: dict[str, Any] = {} if dim == 2 else {"depthshade": False}
    axes.scatter(*where[:, :dim].T, c=of_places, cmap=MAP, norm=norm, s=7.0, lw=0.0, **flat)
    marks = scene.map.all_values.positions(keys, dim)
    if len(worst):
        ends = np.stack([places[worst][:, :dim], marks[targets[worst]], np.full((len(worst), dim), np.nan)], 1)
        axes.plot(*ends.reshape(-1, dim).T, color=INK, lw=0.5, alpha=0.6)
    _coloured_marks(axes, marks, of_marks, norm)
    return _finished(figure, axes, norm, "median size of residuals [sigma]", side)


def _lines_said(sizes: Array, targets: IntArray) -> str:
    """What the lines are, in words."""
    large = int(np.count_nonzero((targets >= 0) & (sizes > LARGE)))
    if not large:
        return f"no sighting of a landmark leaves more than {LARGE:g} sigma"
    which = f"the {WORST} worst of {large:,}" if large > WORST else f"the {large}"
    return f"lines: {which} sightings of landmarks that leave more than {LARGE:g} sigma"


def _axes(title: str, caption: str, dim: int) -> tuple["Figure", Any]:
    if dim == 2:
        figure, axes = panel((7.4, 5.8), title, caption)
        axes.set_aspect("equal", adjustable="datalim")
        return figure, axes
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.4, 5.8), layout="constrained")
    space: Any = figure.add_subplot(projection="3d")
    figure.suptitle(plain(title, 400), x=0.01, ha="left")
    space.set_title(plain(caption, 400), loc="left", fontsize=8.5, fontweight="normal", color=INK)
    return figure, space


def _finished(figure: "Figure", axes: Any, norm: Any, label: str, side: Side | None) -> "Figure":
    """The bar, and the axes' names."""
    from matplotlib.cm import ScalarMappable

    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    spatial = hasattr(axes, "zaxis")
    if spatial:
        from teamslam.viz.space import equal_scale

        axes.set_zlabel("z [m]")
        equal_scale(axes, zoom=0.9)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.pane.fill = False
        turned(axes, side)
    figure.colorbar(
        ScalarMappable(norm, MAP), ax=axes, label=label, extend="max", shrink=0.8, pad=0.1 if spatial else 0.03
    )
    return figure


def _norm(numbers: Array) -> Any:
    from matplotlib.colors import Normalize

    known = numbers[np.isfinite(numbers)]
    return Normalize(0.0, float(np.quantile(known, HIGH)) or 1.0)


def _errors(scene: Scene, keys: IntArray) -> Array:
    """How far variables are from the truth (n,) [m], nan where it is not known."""
    out = np.full(len(keys), np.nan)
    if scene.truth is not None and len(keys):
        known = np.asarray(scene.truth.layout.contains(keys))
        off = scene.map.all_values.positions(keys[known], 3) - scene.truth.positions(keys[known], 3)
        out[known] = np.linalg.norm(off, axis=-1)
    return out


def _coloured_line(axes: Any, places: Array, numbers: Array, norm: Any, dim: int) -> None:
    step = max(1, -(-len(places) // MOST_PIECES))
    places, numbers = places[::step], numbers[::step]
    pieces = np.stack([places[:-1], places[1:]], 1)
    lines = _lines(pieces, dim)
    lines.set(cmap=MAP, norm=norm, linewidths=1.8)
    lines.set_array(np.fmax(numbers[:-1], numbers[1:]))
    (axes.add_collection if dim == 2 else axes.add_collection3d)(lines)
    axes.plot(*places.T, lw=0.0)  # so that the axes know how far it reaches


def _lines(pieces: Array, dim: int) -> Any:
    """Pieces (n, 2, dim) of a line, which are coloured one by one."""
    if dim == 2:
        from matplotlib.collections import LineCollection

        return LineCollection(list(pieces))
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

    return Line3DCollection(list(pieces))


def _coloured_marks(axes: Any, places: Array, numbers: Array, norm: Any) -> None:
    known = np.isfinite(numbers)
    look: dict[str, Any] = {"marker": "D", "s": 34.0, "edgecolors": INK, "linewidths": 0.6, "zorder": 8}
    if places.shape[-1] == 3:
        look["depthshade"] = False
    axes.scatter(*places[known].T, c=numbers[known], cmap=MAP, norm=norm, **look)
    axes.scatter(*places[~known].T, facecolors="none", **look)


def _by_place(places: Array, sizes: Array, cell_m: float) -> tuple[Array, Array]:
    """The middles of the cells that rows were taken in (k, 3), and the median size of each (k,)."""
    cells = np.floor(places / max(cell_m, 1e-12)).astype(np.int64)
    _, which = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(which.ravel()[order])) + 1)
    return np.array([places[g].mean(0) for g in groups]), np.array([np.median(sizes[g]) for g in groups])


def _median(sizes: Array) -> float:
    return float(np.median(sizes)) if len(sizes) else float("nan")
