"""Several runs side by side: what share of positions errs by how much, and how each robot fares in each run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.viz.errors import MOST_ROBOTS
from teamslam.viz.frame import log_scale
from teamslam.viz.style import INK, name, plain, robot_colour, seen, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class ErrorCloud:
    """One run's errors of position [m]: of each robot's poses, by name, and of the landmarks (m,)."""

    robots: Mapping[str, Array]
    landmarks: Array

    @property
    def every(self) -> Array:
        """Those of all robots' poses."""
        return np.concatenate([np.zeros(0), *self.robots.values()])


@styled
def draw_comparison(runs: Mapping[str, ErrorCloud], title: str = "", caption: str = "") -> "Figure":
    """The share of positions below each error, a line a run; and the errors of each robot, and of landmarks, a box a
    run. InputError where there is nothing to compare."""
    if not any(len(cloud.every) for cloud in runs.values()):
        raise InputError("nothing to compare: no position of a robot is known to two of them")
    from matplotlib.figure import Figure

    groups = list(dict.fromkeys(robot for cloud in runs.values() for robot in cloud.robots))[:MOST_ROBOTS]
    figure = Figure(figsize=(4.6 + 0.9 * (len(groups) + 1), 4.2), layout="constrained")
    shares, boxes = figure.subplots(1, 2, width_ratios=(3.4, 1.0 + 0.9 * (len(groups) + 1)))
    for order, (run, cloud) in enumerate(runs.items()):
        errors = np.sort(cloud.every)
        if len(errors):
            share = np.arange(1, len(errors) + 1) / len(errors)
            shares.plot(*seen(errors, share), color=robot_colour(order), label=name(run, 40))
    shares.set(xlabel="error of position [m]", ylabel="share of poses below", ylim=(0.0, 1.01), xlim=(0.0, None))
    _boxes(boxes, runs, groups)
    figure.suptitle(plain(title or "Comparison of runs", 400), x=0.01, ha="left")
    shares.set_title(plain(caption, 400), fontsize=8.5, fontweight="normal", color=INK)
    figure.legend(*shares.get_legend_handles_labels(), loc="outside lower center", ncols=min(len(runs), 3))
    return figure


def _boxes(axes: "Axes", runs: Mapping[str, ErrorCloud], robots: Sequence[str]) -> None:
    """Quartiles, and whiskers from the 5th to the 95th percentile."""
    width = 0.8 / len(runs)
    for order, cloud in enumerate(runs.values()):
        groups = [*(cloud.robots.get(robot, np.zeros(0)) for robot in robots), cloud.landmarks]
        held = [(place, errors) for place, errors in enumerate(groups) if len(errors)]
        places = [place + (order - 0.5 * (len(runs) - 1)) * width for place, _ in held]
        drawn = axes.boxplot([errors for _, errors in held], positions=places, widths=0.85 * width, whis=(5, 95),
                             showfliers=False, patch_artist=True, manage_ticks=False,
                             medianprops={"color": INK, "lw": 1.0})  # fmt: skip
        for box in drawn["boxes"]:
            box.set(facecolor=robot_colour(order), alpha=0.6, lw=0.6)
    words = [*(f"robot {name(robot, 12)}" for robot in robots), "landmarks"]
    axes.set_xticks(range(len(words)), words, rotation=30, ha="right")
    axes.set_ylabel("error of position [m]")
    log_scale(axes)
    axes.grid(axis="x", visible=False)
