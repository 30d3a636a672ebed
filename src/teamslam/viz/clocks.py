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
    """A number that was estimated: its `name` with the unit in which all is told, what was `stated`; what stretches at
    `stamps_s` (n,) say of it by themselves, `values` and `sigmas` (n,); and as `found`, with its sigma. None: it goes
    evenly from each of these values to the next."""

    name: str
    stated: float
    stamps_s: Array
    values: Array
    sigmas: Array
    found: tuple[float, float] | None


@styled
def draw_clocks(numbers: Sequence[Estimated], title: str = "") -> "Figure":
    """A panel for each number: its value with one sigma (band), what was stated (dashed), what each stretch of the
    recordings says (dots with one sigma); of what changes the values on its way. InputError where there is none."""
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
        low, high = one.values - one.sigmas, one.values + one.sigmas
        told = f"{one.name}; stated {one.stated:.4g}"
        if one.found is None:
            axes.plot(one.stamps_s, one.values, color=colour)
            low, high = np.append(low, one.stated), np.append(high, one.stated)
        else:
            value, sigma = one.found
            told = f"{one.name}: {value:.4g} +- {sigma:.2g}; stated {one.stated:.4g}"
            axes.axhspan(value - sigma, value + sigma, color=colour, alpha=0.2, lw=0)
            axes.axhline(value, color=colour)
            low, high = np.append(low, value - sigma), np.append(high, value + sigma)
        axes.axhline(one.stated, color=QUIET, ls="--")
        axes.errorbar(one.stamps_s, one.values, yerr=one.sigmas, fmt="o", ms=3.5, color=METHOD_COLOURS["join"])
        room = 0.1 * max(float(high.max() - low.min()), 1e-9)
        axes.set_ylim(low.min() - room, high.max() + room)
        axes.set_title(plain(told, 200), fontsize=8.5 if columns == 1 else 7.0, fontweight="normal", loc="left")
    for axes in [*panels[rows - 1 : len(numbers) : rows], panels[len(numbers) - 1]]:
        axes.set_xlabel("time since the start [s]")
        axes.tick_params(labelbottom=True)
    figure.suptitle(plain(title or "Clocks and cameras"), x=0.01, ha="left")
    return figure
