"""What was found of clocks, cameras and tags, and what stretches of the recordings say of them by themselves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.viz.style import METHOD_COLOURS, QUIET, plain, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

A_COLUMN = 16  # panels, at most


@dataclass(frozen=True, eq=False)
class Estimated:
    """A number that was estimated: its `name` with the unit in which all is told, `value`, `sigma` and what was
    `stated`; what stretches at `stamps_s` (n,) say of it by themselves, `values` and `sigmas` (n,)."""

    name: str
    value: float
    sigma: float
    stated: float
    stamps_s: Array
    values: Array
    sigmas: Array


@styled
def draw_clocks(numbers: Sequence[Estimated], title: str = "") -> "Figure":
    """A panel for each number: its value with one sigma (band), what was stated (dashed), what each stretch of the
    recordings says (dots with one sigma). InputError where there is none."""
    from matplotlib.figure import Figure

    if not numbers:
        raise InputError("no clocks or cameras to draw: nothing was estimated")
    columns = 1 + (len(numbers) - 1) // A_COLUMN
    rows = -(-len(numbers) // columns)
    width = 7.2 if columns == 1 else 4.8 * columns
    figure = Figure(figsize=(width, 0.7 + 1.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True).T.ravel()
    for empty in panels[len(numbers) :]:
        empty.set_axis_off()
    for axes, one in zip(panels, numbers, strict=False):
        colour = METHOD_COLOURS["full"]
        axes.axhspan(one.value - one.sigma, one.value + one.sigma, color=colour, alpha=0.2, lw=0)
        axes.axhline(one.value, color=colour)
        axes.axhline(one.stated, color=QUIET, ls="--")
        axes.errorbar(one.stamps_s, one.values, yerr=one.sigmas, fmt="o", ms=3.5, color=METHOD_COLOURS["join"])
        near = np.concatenate(
            [
                [one.value, one.sigma + one.value, one.value - one.sigma],
                one.values - one.sigmas,
                one.values + one.sigmas,
            ]
        )
        room = 0.1 * max(float(np.ptp(near)), 1e-9)
        axes.set_ylim(near.min() - room, near.max() + room)
        axes.set_title(plain(f"{one.name}: {one.value:.4g} +- {one.sigma:.2g}; stated {one.stated:.4g}", 200),
                       fontsize=8.5 if columns == 1 else 7.0, fontweight="normal", loc="left")  # fmt: skip
    for axes in [*panels[rows - 1 : len(numbers) : rows], panels[len(numbers) - 1]]:
        axes.set_xlabel("time since the start [s]")
        axes.tick_params(labelbottom=True)
    figure.suptitle(plain(title or "Clocks and cameras"), x=0.01, ha="left")
    return figure
