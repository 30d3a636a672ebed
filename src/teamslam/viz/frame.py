"""What stands around the curves of a figure: titles, margins, a legend beside them, scales.

Margins are fixed, in inches. For matplotlib to find them, by measuring all that stands on the axes, takes longer than
to draw it; only a legend is measured.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.viz.style import INK, RC, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEFT, RIGHT, BOTTOM, BETWEEN = 0.72, 0.12, 0.46, 0.14
TITLE_LINE, CAPTION_LINE, ROOM = 0.18, 0.145, 0.15
DECADES = 2.0  # on a logarithmic axis: where there are more, only powers of ten are labelled
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def panel(size: tuple[float, float], title: str, caption: str) -> "tuple[Figure, Axes]":
    """A figure with one panel, and a caption above it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size)
    axes = figure.add_subplot()
    lines = len(caption.split("\n")) if caption else 0
    axes.set_title(plain(caption, 400), fontsize=8.5, fontweight="normal", color=INK)
    _margins(figure, title, ROOM + CAPTION_LINE * lines)
    return figure, axes


def panels(rows: int, headings: Sequence[str], *, row_height: float, title: str, caption: str) -> "tuple[Figure, Any]":
    """A figure with panels (rows, columns) that share the axes of their row and column; a column for each heading. To
    be `ruled` at the end."""
    from matplotlib.figure import Figure

    columns = len(headings)
    lines = [*filter(None, plain(caption, 400).split("\n")), headings[0]]
    across, above = max(min(2.3, 13.0 / columns), 3.0 / columns), ROOM + CAPTION_LINE * len(lines)
    height = 0.06 + TITLE_LINE * len(title.split("\n")) + above + rows * row_height + BOTTOM
    figure = Figure(figsize=(LEFT + across * columns + RIGHT, height))
    grid = figure.subplots(rows, columns, sharex="col", sharey="row", squeeze=False)
    for axes, heading in zip(grid[0], ("\n".join(lines), *headings[1:]), strict=True):
        axes.set_title(heading, fontsize=8.5 if columns < 6 else 6.5, fontweight="normal", color=INK)
    for axes in grid.flat:
        axes.locator_params(nbins=4)
    figure.subplots_adjust(wspace=BETWEEN / across, hspace=BETWEEN / row_height)
    _margins(figure, title, above)
    return figure, grid


def ruled(grid: Any) -> None:
    """Once all is drawn in panels that share axes: ticks at the outermost panel of each row and column that is used,
    and in the others the lines of the grid alone, as one collection. Ticks of their own, each three lines and two
    words, would take most of the time that such a figure does."""
    from matplotlib.collections import LineCollection

    lowest = [next((axes for axes in column[::-1] if axes.axison), None) for column in grid.T]
    first = [next((axes for axes in row if axes.axison), None) for row in grid]
    for (row, column), axes in np.ndenumerate(grid):
        if not axes.axison:
            continue
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        lines: list[Any] = []
        if axes is not lowest[column]:
            lines += [((x, low), (x, high)) for x in _between(axes.xaxis, left, right)]
            axes.xaxis.set_visible(False)
        if axes is not first[row]:
            lines += [((left, y), (right, y)) for y in _between(axes.yaxis, low, high)]
            axes.yaxis.set_visible(False)
        look = {"colors": RC["grid.color"], "linewidths": RC["grid.linewidth"], "zorder": 0.5}
        axes.add_collection(LineCollection(lines, **look), autolim=False)
    for axes in filter(None, lowest):
        axes.tick_params(labelbottom=True)
    for axes in filter(None, first):
        axes.tick_params(labelleft=True)


def _between(axis: Any, low: float, high: float) -> list[float]:
    """Where an axis has its ticks."""
    return [at for at in axis.get_majorticklocs().tolist() if low <= at <= high]


def _margins(figure: "Figure", title: str, above: float) -> None:
    """The title, and the margins, with so much room [inches] between it and the axes."""
    width, height = figure.get_size_inches()
    figure.suptitle(plain(title, 400), x=0.01, y=1.0 - 0.06 / height, ha="left")
    top = 0.06 + TITLE_LINE * len(title.split("\n")) + above
    figure.subplots_adjust(LEFT / width, BOTTOM / height, 1.0 - RIGHT / width, 1.0 - top / height)


def room_below(figure: "Figure", letters: int) -> None:
    """Room for labels of so many letters that stand upright below the axes."""
    figure.subplots_adjust(bottom=(BOTTOM + 0.08 * letters) / figure.get_figheight())


def legend_beside(figure: "Figure", *handles_and_labels: Any, title: str | None = None) -> None:
    """A legend to the right of the axes, which make room for it."""
    legend = figure.legend(*handles_and_labels, title=title, loc="center right", bbox_to_anchor=(1.0, 0.5))
    measured = legend.get_window_extent(pen_of(figure))
    figure.subplots_adjust(right=1.0 - measured.width / figure.bbox.width - 0.02)


def between(figure: "Figure", title: str, caption: str, *handles_and_labels: Any) -> tuple[float, float]:
    """The title and a caption above, a legend below, and the heights between which they leave room (0: the lower edge,
    1: the upper one)."""
    height = figure.get_figheight()
    said = plain(caption, 240)
    figure.suptitle(plain(title), x=0.01, y=1.0 - 0.06 / height, ha="left")
    above = 0.06 + TITLE_LINE + 0.5 * ROOM
    figure.text(0.5, 1.0 - above / height, said, fontsize=8.5, color=INK, ha="center", va="top")
    legend = figure.legend(*handles_and_labels, loc="lower center", ncols=4)
    low: float = legend.get_window_extent(pen_of(figure)).y1 / figure.bbox.height
    return low, 1.0 - (above + CAPTION_LINE * len(said.split("\n"))) / height


def pen_of(figure: "Figure") -> Any:
    """What measures letters."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    return FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]


def log_scale(axes: "Axes") -> None:
    """A logarithmic y axis whose labels are plain letters: as mathematics, each takes as long as a curve."""
    from matplotlib.ticker import LogFormatter, LogLocator

    class Powers(LogFormatter):
        """10⁻², and between powers, where there is room, 2×10⁻²."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            if not super().__call__(x, pos):
                return ""
            power = math.floor(math.log10(x) + 1e-9)
            times = f"{x / 10.0**power:g}×"
            return f"{'' if times == '1×' else times}10{str(power).translate(RAISED)}"

    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(Powers())
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0), numticks=20))
    axes.yaxis.set_minor_formatter(Powers(labelOnlyBase=False, minor_thresholds=(DECADES, DECADES)))
