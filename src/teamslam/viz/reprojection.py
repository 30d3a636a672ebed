"""A camera's calibration: what is left of every corner over the image, and the focal lengths by other lenses and by
halves of the views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.viz.frame import TITLE_LINE
from teamslam.viz.style import INK, METHOD_COLOURS, QUIET, plain, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ARROWS = 3000
LONGEST = 0.04  # of the image's width: an arrow of the usual length times three


@dataclass(frozen=True)
class FocalLengths:
    """By one lens: of all views with its standard deviation, and of both halves [pixels]; whether it fits as well as
    the best."""

    name: str
    whole: float
    sigma: float
    halves: tuple[float, float]
    alike: bool


@styled
def draw_reprojection(
    pixels: Array,
    residuals: Array,
    size: tuple[int, int],
    lenses: Sequence[FocalLengths],
    title: str = "",
    caption: str = "",
) -> "Figure":
    """Residuals (m, 2) of corners at `pixels` (m, 2) as arrows in an image of `size`, and the focal lengths of
    `lenses`, the first of which was chosen. InputError where there is no corner."""
    from matplotlib.figure import Figure

    if not len(pixels):
        raise InputError("no corners to draw: the board was seen nowhere")
    figure = Figure(figsize=(9.2, 4.2))
    figure.suptitle(plain(title, 400), x=0.01, y=0.985, ha="left")
    image, lens = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    lines = len(caption.split("\n"))
    figure.subplots_adjust(0.07, 0.12, 0.985, 0.93 - TITLE_LINE * (lines + 1) / 4.2, 0.42)
    shown = np.unique(np.linspace(0, len(pixels) - 1, min(MOST_ARROWS, len(pixels))).astype(int))
    usual = max(float(np.median(np.linalg.norm(residuals, axis=-1))), 1e-9)
    larger = LONGEST * size[0] / (3.0 * usual)
    image.quiver(
        *pixels[shown].T,
        *residuals[shown].T * larger,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.0018,
        color=METHOD_COLOURS["full"],
    )
    image.set(xlim=(0, size[0]), ylim=(size[1], 0), aspect="equal", xlabel="[pixels]", ylabel="[pixels]")
    image.set_title(plain(f"{caption}\nwhat is left of each corner, {larger:.0f} times as long", 400), fontsize=8.5,
                    fontweight="normal", color=INK)  # fmt: skip
    for row, one in enumerate(lenses):
        colour = METHOD_COLOURS["join"] if row == 0 else METHOD_COLOURS["full"] if one.alike else QUIET
        lens.errorbar(one.whole, row, xerr=one.sigma, fmt="o", ms=4.5, color=colour, capsize=3)
        lens.plot(one.halves, [row, row], "|", ms=10, color=colour)
    lens.set_yticks(range(len(lenses)), [one.name for one in lenses])
    lens.set(xlabel="focal length [pixels]", ylim=(len(lenses) - 0.5, -0.5))
    lens.set_title("all views with sigma (dot), halves (strokes)\norange: chosen; grey: fits worse", fontsize=8.5,
                   fontweight="normal", color=INK)  # fmt: skip
    return figure
