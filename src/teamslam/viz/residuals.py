"""What measurements leave at the map, over time by robot and sensor, and by landmark.

The size of a row's residual is its whitened length over the root of its numbers: about 1 where the model is right, and
less where the map follows the row (odometry between sightings).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.viz.errors import MOST_ROBOTS, TIME
from teamslam.viz.frame import legend_beside, log_scale, panel, panels, room_below, ruled
from teamslam.viz.style import INK, QUIET, name, plain, robot_colour, robot_marker, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_DOTS = 1500  # in one panel: more are thinned evenly
MOST_LANDMARKS = 40  # side by side
STRETCHES = 40  # that a median is drawn over
LEAST = 0.05  # a size that is drawn: what is smaller lies on the edge


@dataclass(frozen=True, eq=False)
class ResidualTrack:
    """One sensor of one robot: when each row was taken (m,), how large its residual is (m,), and what was seen: places
    (m,) in `targets`."""

    robot: str
    source: str
    stamps_s: Array
    size: Array
    target: IntArray
    targets: tuple[str, ...]


@styled
def draw_residuals(tracks: Sequence[ResidualTrack], title: str = "", caption: str = "", time: str = TIME) -> "Figure":
    """Sizes of residuals over time: a column a robot, a row a sensor. InputError where there is no row.

    `time` names what the stamps are. Of many robots those with the largest residuals are drawn, and it says so.
    """
    if not tracks:
        raise InputError("no residuals to draw: the verdict rests on no rows")
    robots, some = _shown(tracks)
    sources = list(dict.fromkeys(track.source for track in tracks))
    figure, grid = panels(
        len(sources),
        [f"robot {name(robot)}" for robot in robots],
        row_height=1.4,
        title=title or "Residuals over time",
        caption="\n".join(filter(None, (caption, some))),
    )
    colours = _colours(tracks)
    top = max(float(track.size.max(initial=1.0)) for track in tracks)
    for column, robot in enumerate(robots):
        grid[-1, column].set_xlabel(time)
        for axes, source in zip(grid[:, column], sources, strict=True):
            _over_time(
                axes, [t for t in tracks if (t.robot, t.source) == (robot, source)], robot_colour(colours[robot])
            )
    for axes, source in zip(grid[:, 0], sources, strict=True):
        axes.set_ylabel(f"{plain(source, 30)} [sigma]")
        log_scale(axes)
        axes.set_ylim(LEAST, 2.0 * max(top, 5.0))
    ruled(grid)
    return figure


def _over_time(axes: "Axes", tracks: Sequence[ResidualTrack], colour: str) -> None:
    """Dots, thinned, and the median of each stretch of time."""
    axes.axhline(1.0, color=QUIET, lw=0.7)
    stamps = np.concatenate([np.zeros(0), *(t.stamps_s for t in tracks)])
    size = np.maximum(np.concatenate([np.zeros(0), *(t.size for t in tracks)]), LEAST)
    timed = np.isfinite(stamps)
    stamps, size = stamps[timed], size[timed]
    if not len(stamps):
        return
    thin = slice(None, None, -(-len(stamps) // MOST_DOTS))
    axes.plot(stamps[thin], size[thin], color=colour, rasterized=True, **dots(len(stamps[thin])))
    edges = np.linspace(stamps.min(), stamps.max(), STRETCHES + 1)
    place = np.clip(np.searchsorted(edges, stamps, side="right") - 1, 0, STRETCHES - 1)
    held = np.unique(place)
    medians = [float(np.median(size[place == n])) for n in held]
    axes.plot(0.5 * (edges[held] + edges[held + 1]), medians, color=INK, lw=1.0)


def dots(count: int) -> dict[str, Any]:
    """How so many dots of one panel look: the fewer they are, the larger and the darker each."""
    few = MOST_DOTS / max(count, 1)
    size, shade = min(2.0 * few**0.25, 5.0), min(0.35 * few**0.2, 0.8)
    return {"ls": "none", "marker": ".", "ms": size, "mew": 0.0, "alpha": shade}


@styled
def draw_residuals_by_landmark(tracks: Sequence[ResidualTrack], title: str = "", caption: str = "") -> "Figure":
    """Sizes of the residuals of each landmark: the middle four fifths as a bar, each robot's median as a mark.

    `tracks` are those of sightings of landmarks. InputError where there is none. Of many landmarks those with the
    largest residuals are drawn, and it says so.
    """
    if not tracks:
        raise InputError("no residuals to draw: no landmark was seen")
    by_landmark = _sizes(tracks, [0] * len(tracks))
    order = sorted({mark for mark, _ in by_landmark}, key=lambda mark: -float(np.median(by_landmark[mark, 0])))
    shown = {mark: place for place, mark in enumerate(order[:MOST_LANDMARKS])}
    some = f"drawn: the {len(shown)} of {len(order)} landmarks whose residuals are largest"
    lines = filter(None, (caption, some if len(order) > len(shown) else ""))
    figure, axes = panel((2.8 + 0.22 * len(shown), 3.9), title or "Residuals by landmark", "\n".join(lines))
    axes.axhline(1.0, color=QUIET, lw=0.7)
    bars = np.array([np.quantile(by_landmark[mark, 0], [0.1, 0.9]) for mark in shown])
    axes.vlines(range(len(shown)), *bars.T, color=QUIET, lw=3.0, alpha=0.5)
    colours = _colours(tracks)
    of_robots = _sizes(tracks, [colours[track.robot] for track in tracks])
    for robot, colour in colours.items():
        points = [(place, np.median(of_robots[m, colour])) for m, place in shown.items() if (m, colour) in of_robots]
        look: dict[str, Any] = {"ls": "none", "ms": 4.5, "mec": "white", "mew": 0.4, "label": f"robot {name(robot)}"}
        across = np.array(points).reshape(-1, 2).T
        axes.plot(*across, marker=robot_marker(colour), color=robot_colour(colour), **look)
    log_scale(axes)
    names = [name(mark.removeprefix("landmark ")) for mark in shown]
    axes.set_xticks(range(len(shown)), names, rotation=90)
    room_below(figure, max(map(len, names)))
    axes.set_xlabel("landmark")
    axes.set_ylabel("size of residuals [sigma]")
    legend_beside(figure, title="median of")
    return figure


def _sizes(tracks: Sequence[ResidualTrack], groups: Sequence[int]) -> dict[tuple[str, int], Array]:
    """The sizes of all rows by what was seen and the group of the track."""
    found: dict[tuple[str, int], list[Array]] = {}
    for track, group in zip(tracks, groups, strict=True):
        order = np.argsort(track.target, kind="stable")
        ends = np.searchsorted(track.target[order], np.arange(len(track.targets) + 1))
        for word, start, stop in zip(track.targets, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            found.setdefault((word, group), []).append(np.maximum(track.size[order[start:stop]], LEAST))
    return {key: np.concatenate(sizes) for key, sizes in found.items()}


def _colours(tracks: Sequence[ResidualTrack]) -> dict[str, int]:
    """The place of each robot in the team's order, which is its colour's."""
    return {robot: place for place, robot in enumerate(dict.fromkeys(track.robot for track in tracks))}


def _shown(tracks: Sequence[ResidualTrack]) -> tuple[list[str], str]:
    """The robots that are drawn, and in words which, where these are not all."""
    robots = list(_colours(tracks))
    if len(robots) <= MOST_ROBOTS:
        return robots, ""
    largest = {robot: max(float(np.median(t.size)) for t in tracks if t.robot == robot) for robot in robots}
    worst = sorted(robots, key=lambda robot: -largest[robot])[:MOST_ROBOTS]
    some = f"drawn: the {MOST_ROBOTS} of {len(robots)} robots whose residuals are largest"
    return [robot for robot in robots if robot in worst], some
