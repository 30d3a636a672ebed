"""Curves: how the cost fell, how the errors ran, whether the covariances are honest.

An estimate that is honest about itself keeps its errors within the 3-sigma band (one number: 99.7 % of the time),
and its NEES, e' P^-1 e / dof of each pose, near 1 and below the 95 % bound of chi-square.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.model import chi2_quantile
from teamslam.viz.scene import CONFIDENCE
from teamslam.viz.style import INK, METHOD_COLOURS, QUIET, robot_colour, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class ErrorTrack:
    """One robot's errors along its way: `error` and `sigma` (n, k) in `units`, `nees` (n,) divided by its dof."""

    robot: str
    stamps_s: Array
    error: Array
    sigma: Array
    nees: Array
    labels: tuple[str, ...] = ("x", "y", "heading")
    units: tuple[str, ...] = ("m", "m", "rad")

    @property
    def dof(self) -> int:
        """Numbers in one error."""
        return int(self.error.shape[-1])


@styled
def draw_convergence(
    panels: Mapping[str, Mapping[str, Sequence[float]]], title: str = "", caption: str = ""
) -> "Figure":
    """The objective against the iteration: a panel for each title in `panels`, a line for each name in it.

    Raises InputError where there is nothing to draw.
    """
    if not any(len(cost) for costs in panels.values() for cost in costs.values()):
        raise InputError("no iteration to draw: the history of the solver is empty")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.4 + 4.8 * len(panels), 3.8), layout="constrained")
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (name, costs) in zip(grid, panels.items(), strict=True):
        _cost_axes(axes, costs)
        axes.set_title("\n".join(filter(None, (name, caption))), fontsize=8.5, fontweight="normal", color=INK)
    grid[0].set_ylabel("objective (sum of losses)")
    figure.suptitle(title or "Convergence of the objective", x=0.01, ha="left")
    return figure


def _cost_axes(axes: "Axes", costs: Mapping[str, Sequence[float]]) -> None:
    """A line for each name; the scale is logarithmic where the objective falls to a third or less."""
    from matplotlib.ticker import MaxNLocator

    for order, (name, cost) in enumerate(costs.items()):
        dots, colour = "o" if len(cost) <= 40 else None, METHOD_COLOURS.get(name, robot_colour(order))
        look: dict[str, Any] = {"marker": dots, "ms": 4, "color": colour, "mec": "white", "mew": 0.5}
        axes.plot(np.arange(len(cost)), cost, label=f"{name}: {cost[-1]:.6g}", **look)
    positive = [c for cost in costs.values() for c in cost if c > 0.0]
    if positive and max(positive) > 3.0 * min(positive):
        axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("iteration")
    axes.legend(title="final objective")


@styled
def draw_errors(tracks: Sequence[ErrorTrack], title: str = "", caption: str = "") -> "Figure":
    """Errors over time with 3-sigma bands: a column a robot, a row a coordinate. InputError where there is no track."""
    if not tracks:
        raise InputError("no errors to draw: the truth of no robot is known")
    from matplotlib.figure import Figure

    rows = tracks[0].dof
    size = (min(1.6 + 2.3 * len(tracks), 14.0), 0.9 + 1.35 * rows)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, len(tracks), sharex="col", sharey="row", squeeze=False)
    for column, track in enumerate(tracks):
        colour = robot_colour(column)
        for row in range(rows):
            axes = grid[row, column]
            band = 3.0 * track.sigma[:, row]
            axes.fill_between(track.stamps_s, -band, band, color=colour, alpha=0.15, lw=0, label="3 sigma")
            axes.plot(track.stamps_s, band, color=colour, lw=0.5, alpha=0.6)
            axes.plot(track.stamps_s, -band, color=colour, lw=0.5, alpha=0.6)
            axes.axhline(0.0, color=QUIET, lw=0.6)
            axes.plot(track.stamps_s, track.error[:, row], color=colour, lw=0.9, label="error")
            if column == 0:
                axes.set_ylabel(f"{track.labels[row]} [{track.units[row]}]")
        inside = float(np.mean(np.abs(track.error) <= 3.0 * track.sigma))
        grid[0, column].set_title(f"robot {track.robot}: {inside:.1%} within", fontsize=8.5)
        grid[-1, column].set_xlabel("time since the start [s]")
    for row in range(rows):
        worst = max(float(np.nanpercentile(np.abs(t.error[:, row]), 99.5)) for t in tracks)
        widest = max(3.0 * float(np.nanpercentile(t.sigma[:, row], 99.5)) for t in tracks)
        grid[row, 0].set_ylim(*(np.array([-1.1, 1.1]) * max(worst, min(widest, 4.0 * worst), 1e-12)))
    first = title or "Errors over time, with 3-sigma bands"
    figure.suptitle(f"{first}\n{caption}" if caption else first, x=0.01, ha="left")
    return figure


@styled
def draw_consistency(tracks: Sequence[ErrorTrack], title: str = "", caption: str = "") -> "Figure":
    """NEES / dof of every pose over time, with its 95 % bound. InputError where there is no track."""
    if not tracks:
        raise InputError("no NEES to draw: the truth of no robot is known")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.8, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for order, track in enumerate(tracks):
        mean = float(np.nanmean(track.nees))
        axes.plot(track.stamps_s, track.nees, color=robot_colour(order), lw=0.9, label=f"{track.robot}: {mean:.2f}")
    bound = chi2_quantile(CONFIDENCE, tracks[0].dof) / tracks[0].dof
    axes.axhline(1.0, color=QUIET, lw=0.8)
    axes.axhline(bound, color=INK, lw=0.9, ls="--", label=f"{CONFIDENCE:.0%} bound\nof one pose")
    axes.set_yscale("log")
    axes.set_ylim(bottom=1e-2)
    axes.set_xlabel("time since the start [s]")
    axes.set_ylabel("NEES / dof")
    axes.set_title(caption, fontsize=8.5, fontweight="normal", color=INK)
    figure.legend(title="robot: mean", loc="outside right center")
    figure.suptitle(title or "Consistency: honest covariances keep NEES / dof near 1", x=0.01, ha="left")
    return figure
