"""What maps in the plane and in space have in common: sightings of robots, landmarks, the legend."""

from typing import Any

import numpy as np

from teamslam.viz.scene import CONFIDENCE, Scene
from teamslam.viz.style import INK, LANDMARK_COLOUR, QUIET, TRUTH_COLOUR, WEAK_COLOUR, name

MOST_SIGHTINGS = 120  # lines drawn: more are thinned evenly, as they would hide the map
MOST_LABELS = 40  # landmarks named: more would write over each other


def draw_sightings(axes: Any, scene: Scene, dim: int) -> None:
    """Thin lines between robots that saw each other; the label says where only some are drawn."""
    pairs, step = scene.visible_sightings(MOST_SIGHTINGS)
    if not len(pairs):
        return
    ends = scene.map.all_values.positions(pairs, dim)  # (n, 2, dim)
    broken = np.concatenate([ends, np.full((len(ends), 1, dim), np.nan)], 1).reshape(-1, dim)
    some = f"\n(1 in {step} drawn)" if step > 1 else ""
    axes.plot(*broken.T, color=QUIET, lw=0.5, alpha=0.5, zorder=1, label=f"sighting of a robot{some}")


def draw_landmarks(axes: Any, scene: Scene, dim: int) -> None:
    """Landmarks as diamonds, the true ones hollow; named where there are few."""
    keys = scene.map.landmark_keys
    if not len(keys):
        return
    many = len(keys) > MOST_LABELS
    places = scene.map.all_values.positions(keys, dim)
    axes.plot(*places.T, ls="none", marker="D", ms=3.0 if many else 4.6, color=LANDMARK_COLOUR, mec="white", mew=0.5,
              zorder=8, label="landmark")  # fmt: skip
    if scene.truth is not None and (there := scene.truth.layout.contains(keys)).any():
        true = scene.truth.positions(keys[there], dim)
        axes.plot(*true.T, ls="none", marker="D", ms=5.0 if many else 8.0, mfc="none", mec=TRUTH_COLOUR, mew=0.8,
                  zorder=7, label="landmark, truth")  # fmt: skip
    second = scene.second_places(keys)[:, :dim]
    if (two := np.isfinite(second).all(-1)).any():
        ties = np.stack([places[two], second[two], np.full((int(two.sum()), dim), np.nan)], 1).reshape(-1, dim)
        axes.plot(*ties.T, color=LANDMARK_COLOUR, lw=0.6, ls=(0, (1, 2)), zorder=6)
        axes.plot(*second[two].T, ls="none", marker="D", ms=5.5, mfc="none", mec=LANDMARK_COLOUR, mew=0.9,
                  zorder=7, label="landmark, second place")  # fmt: skip
    if not many and dim == 2:
        for key, place in zip(keys, places, strict=True):
            axes.annotate(name(scene.map.names.landmark(int(key))), place, xytext=(7, 6), textcoords="offset points",
                          fontsize=7.5, color=LANDMARK_COLOUR, zorder=9)  # fmt: skip


def draw_weakest(axes: Any, scene: Scene, dim: int) -> None:
    """The weakest direction of the map: lines on the part that it moves, one sigma to either side."""
    lines, times = scene.weakest(dim)
    if len(lines):
        broken = np.concatenate([lines, np.full((len(lines), 1, dim), np.nan)], 1).reshape(-1, dim)
        longer = f",\ndrawn {times} times longer" if times > 1 else ""
        axes.plot(*broken.T, color=WEAK_COLOUR, lw=1.6, zorder=5, label=f"weakest, ± 1 sigma{longer}")


def explain(axes: Any, scene: Scene, dim: int) -> None:
    """Legend entries for what is not a labelled line."""

    def entry(label: str, **look: Any) -> None:
        axes.plot(*np.zeros((dim, 0)), label=label, **look)

    if any(len(scene.true_path(robot, dim)) for robot in scene.robots):
        entry("true path", color=TRUTH_COLOUR, lw=0.8, ls=(0, (4, 2)))
    if scene.has_regions(dim):
        times = scene.magnification(dim)
        enlarged = f",\ndrawn {times} times larger" if times > 1 else ""
        entry(f"{CONFIDENCE:.0%} region{enlarged}", ls="none", marker="o", ms=9, mfc="none", mec=LANDMARK_COLOUR)
    entry("start, with its axes" if dim == 2 else "start", ls="none", marker="o", ms=5, color=INK, mec="white")
    entry("end", ls="none", marker="s", ms=4.5, color=INK, mec="white")
