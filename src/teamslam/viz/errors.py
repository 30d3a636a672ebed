"""Errors along the robots' ways, and whether the covariances are honest about them.

An estimate that is honest about itself keeps its errors within the 3-sigma band (one number: 99.7 % of the time),
and its NEES, e' P^-1 e / dof of each pose, near 1 and below the 95 % bound of chi-square.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.model import chi2_quantile
from teamslam.viz.frame import legend_beside, log_scale, panel, panels, ruled
from teamslam.viz.scene import CONFIDENCE
from teamslam.viz.style import INK, NARROW, QUIET, name, robot_colour, seen, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEADING, IN_SPACE = "heading [rad]", "rz [rad]"
MOST_ROBOTS = 8  # drawn side by side, or over each other: more cannot be told apart
TIME = "time since the start [s]"


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

    @property
    def axes(self) -> dict[str, int]:
        """Which column of the error each named coordinate is, by its name with its unit."""
        return {f"{label} [{unit}]": k for k, (label, unit) in enumerate(zip(self.labels, self.units, strict=True))}

    @property
    def mark(self) -> str | None:
        """A dot where a line would have nothing to show."""
        return "o" if len(self.stamps_s) < 3 else None


@styled
def draw_errors(tracks: Sequence[ErrorTrack], title: str = "", caption: str = "", time: str = TIME) -> "Figure":
    """Errors over time with 3-sigma bands: a column a robot, a row a coordinate. InputError where there is no track.

    `time` names what the stamps are. Of many robots some are drawn, and it says which. Headings of robots in the plane
    are beside the turns about z of those in space.
    """
    if not tracks:
        raise InputError("no errors to draw: the truth of no robot is known")
    tracks = _turns_together(tracks)
    shown, some = _shown(tracks)
    rows = list(dict.fromkeys(label for track in shown for label in track.axes))
    above = "\n".join(filter(None, (caption, some)))
    most = 30 if len(shown) < 6 else 12
    headings = [f"robot {name(track.robot, most)}: {_within(track):.1%} within" for track in shown]
    head = title or "Errors along the way, with 3-sigma bands"
    figure, grid = panels(len(rows), headings, row_height=1.25, title=head, caption=above)
    for column, track in enumerate(shown):
        for axes, label in zip(grid[:, column], rows, strict=True):
            if label in track.axes:
                _error_axes(axes, track, track.axes[label], robot_colour(list(tracks).index(track)))
            else:
                axes.set_axis_off()
        last = grid[max(rows.index(label) for label in track.axes), column]
        last.set_xlabel(time)
    for axes, label in zip(grid, rows, strict=True):
        axes[0].set_ylim(*_limits([(track, track.axes[label]) for track in shown if label in track.axes]))
        first = next(column for column, track in enumerate(shown) if label in track.axes)
        axes[first].set_ylabel(label)
    ruled(grid)
    return figure


def _turns_together(tracks: Sequence[ErrorTrack]) -> list[ErrorTrack]:
    """The tracks, with headings called as the turns about z that others have."""
    if not any(IN_SPACE in track.axes for track in tracks):
        return list(tracks)
    return [replace(track, labels=("x", "y", "rz")) if HEADING in track.axes else track for track in tracks]


def _within(track: ErrorTrack) -> float:
    """The share of the errors within three of their standard deviations."""
    return float(np.mean(np.abs(track.error) <= 3.0 * track.sigma))


def _error_axes(axes: "Axes", track: ErrorTrack, number: int, colour: str) -> None:
    stamps, band = seen(track.stamps_s, 3.0 * track.sigma[:, number], NARROW)
    axes.fill_between(stamps, -band, band, color=colour, alpha=0.15, lw=0, label="3 sigma")
    for edge in (band, -band):
        axes.plot(stamps, edge, color=colour, lw=0.5, alpha=0.6, marker=track.mark, ms=2.0)
    axes.axhline(0.0, color=QUIET, lw=0.6)
    stamps, error = seen(track.stamps_s, track.error[:, number], NARROW)
    axes.plot(stamps, error, color=colour, lw=0.9, marker=track.mark, ms=4.0, label="error")


def _limits(columns: Sequence[tuple[ErrorTrack, int]]) -> tuple[float, float]:
    """What is shown of a coordinate: its errors, and of its bands up to four times as much."""
    worst = max(float(np.nanpercentile(np.abs(track.error[:, k]), 99.5)) for track, k in columns)
    widest = max(3.0 * float(np.nanpercentile(track.sigma[:, k], 99.5)) for track, k in columns)
    reach = 1.1 * max(worst, min(widest, 4.0 * worst), 1e-12)
    return -reach, reach


@styled
def draw_consistency(tracks: Sequence[ErrorTrack], title: str = "", caption: str = "", time: str = TIME) -> "Figure":
    """NEES / dof of every pose over time, with its 95 % bound. InputError where there is no track.

    `time` names what the stamps are. Of many robots some are drawn, and it says which.
    """
    if not tracks:
        raise InputError("no NEES to draw: the truth of no robot is known")
    shown, some = _shown(tracks)
    head = title or "Consistency: honest covariances keep NEES / dof near 1"
    figure, axes = panel((6.8, 3.9), head, "\n".join(filter(None, (caption, some))))
    for track in shown:
        label = f"robot {name(track.robot)}: {float(np.nanmean(track.nees)):.2f}"
        colour = robot_colour(list(tracks).index(track))
        axes.plot(*seen(track.stamps_s, track.nees), color=colour, lw=0.9, marker=track.mark, ms=4.0, label=label)
    axes.axhline(1.0, color=QUIET, lw=0.8)
    dofs = sorted({track.dof for track in shown})
    for dof, dashes in zip(dofs, ("--", ":"), strict=False):
        which = "" if len(dofs) == 1 else f" ({dof} numbers)"
        bound = chi2_quantile(CONFIDENCE, dof) / dof
        axes.axhline(bound, color=INK, lw=0.9, ls=dashes, label=f"{CONFIDENCE:.0%} bound\nof one pose{which}")
    log_scale(axes)
    axes.set_ylim(bottom=min(1e-2, max(min(float(np.nanmin(track.nees)) for track in shown), 1e-6)))
    axes.set_xlabel(time)
    axes.set_ylabel("NEES / dof")
    legend_beside(figure, title="mean")
    return figure


def _shown(tracks: Sequence[ErrorTrack]) -> tuple[list[ErrorTrack], str]:
    """The tracks that are drawn, in order, and in words which, where these are not all."""
    if len(tracks) <= MOST_ROBOTS:
        return list(tracks), ""
    worst = sorted(tracks, key=lambda track: -float(np.nanmean(track.nees)))[:MOST_ROBOTS]
    some = f"drawn: the {MOST_ROBOTS} of {len(tracks)} robots whose NEES is largest"
    return [track for track in tracks if track in worst], some
