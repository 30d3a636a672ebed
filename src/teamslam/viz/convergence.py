"""How the objective of a solve fell, step by step."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.errors import InputError
from teamslam.viz.frame import log_scale
from teamslam.viz.style import INK, METHOD_COLOURS, METHOD_NAMES, plain, robot_colour, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {METHOD_NAMES[method]: colour for method, colour in METHOD_COLOURS.items()} | METHOD_COLOURS


@styled
def draw_convergence(
    panels: Mapping[str, Mapping[str, Sequence[float]]], title: str = "", objective: str = "objective"
) -> "Figure":
    """What was minimised before the first step and after each step taken: a panel for each title in `panels`, a line
    for each name in it. `objective` says what it is.

    Raises InputError where there is nothing to draw.
    """
    if not any(len(cost) for costs in panels.values() for cost in costs.values()):
        raise InputError("no iteration to draw: the history of the solver is empty")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.4 + 4.8 * len(panels), 3.8), layout="constrained")
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (heading, costs) in zip(grid, panels.items(), strict=True):
        _cost_axes(axes, {line: cost for line, cost in costs.items() if len(cost)})
        axes.set_title(plain(heading), fontsize=8.5, fontweight="normal", color=INK)
    grid[0].set_ylabel(objective)
    figure.suptitle(plain(title or "Convergence of the last solve"), x=0.01, ha="left")
    return figure


def _cost_axes(axes: "Axes", costs: Mapping[str, Sequence[float]]) -> None:
    """A line for each name; the scale is logarithmic where the objective falls to a third or less."""
    from matplotlib.ticker import MaxNLocator

    for order, (line, cost) in enumerate(costs.items()):
        dots, colour = "o" if len(cost) <= 40 else None, COLOURS.get(line, robot_colour(order))
        look: dict[str, Any] = {"marker": dots, "ms": 4, "color": colour, "mec": "white", "mew": 0.5}
        axes.plot(np.arange(len(cost)), cost, label=f"{plain(line, 60)}: {cost[-1]:.6g}", **look)
    values = [c for cost in costs.values() for c in cost]
    if min(values, default=0.0) > 0.0 and max(values) > 3.0 * min(values):
        log_scale(axes)
    elif max(values) >= 1e-3:  # what all ticks are multiplied with, or added to, would stand on the heading
        axes.ticklabel_format(axis="y", style="plain", useOffset=False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("iteration taken")
    axes.legend(title="at the end")
