"""Figures 5 to 7 of the paper, of a run of recordings: what there was to see, positions beside the truth, and how the
objective of each method fell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.io.bags.team_file import TeamFile
from teamslam.joining import Joined
from teamslam.results.by_methods import ByMethods
from teamslam.results.figures import headline, scene_of
from teamslam.results.frames import pictures_at
from teamslam.results.record import Record
from teamslam.results.reprojection import Reprojected
from teamslam.viz import View, draw_convergence, draw_positions, draw_views
from teamslam.viz.style import METHOD_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 4  # cameras in figure 5


def figures_of_experiment(
    record: Record, maps: ByMethods | None, found: Sequence[Reprojected], team: TeamFile, folder: Path
) -> "dict[str, Figure]":
    """New figures by name, those for which there is something to draw: images, a truth, the maps of several methods."""
    figures = {}
    source = headline(record).partition(":")[0]
    if views := views_of(found, team, folder):
        figures["figure_5"] = draw_views(views, f"{source}: what was to be seen")
    if record.truth is not None:
        for n in range(len(record.maps)):
            drawn = draw_positions(replace(scene_of(record, n), weak=None), f"{headline(record, n)}, beside the truth")
            figures[f"figure_6_{n + 1}" if n else "figure_6"] = drawn
    if maps is not None and (lines := _objectives(maps.maps)):
        figures["figure_7"] = draw_convergence(
            lines, f"{source}: the objective in the last solve of each method", "objective"
        )
    return figures


def views_of(found: Sequence[Reprojected], team: TeamFile, folder: Path) -> dict[str, View]:
    """Of each camera with images the one that shows most tags, those on other robots before others."""
    carried = team.carried()
    wanted: set[tuple[int, int]] = set()
    for number, one in enumerate(found):
        if one.entry.images and len(wanted) < MOST:
            ticks, of = np.unique(one.ticks, return_inverse=True)
            on_robots = np.array([(c := carried.get(tag)) is not None and c.is_robot for tag in one.tags.tolist()])
            shown = np.bincount(of) + 0.5 * np.bincount(of, on_robots)
            wanted.add((number, int(ticks[np.argmax(shown)])))
    views = {}
    for number, tick, image in pictures_at(found, wanted, team, folder):
        one = found[number]
        mine = one.select(one.ticks == tick)
        tags = mine.tags.tolist()
        carriers = tuple(carried[tag].carrier if tag in carried else "" for tag in tags)
        start_s = (tick - int(one.ticks.min())) / TICKS_PER_S
        views[f"{one.robot}, {one.entry.name}, {start_s:.1f} s after its first tag"] = View(
            image, mine.seen, tuple(map(str, tags)), carriers
        )
    return views


def _objectives(maps: Mapping[str, Joined]) -> dict[str, dict[str, list[float]]]:
    """Of the first map that full least squares and joining gave; the objective of a join is what it adds to the cost
    of the submaps."""
    sides = {"the cost of all measurements": "full", "what joining adds to the cost of submaps": "join"}
    panels = {}
    for side, method in sides.items():
        solution = maps[method].components[0].solution if method in maps else None
        if solution is not None and (taken := [step.cost for step in solution.history if step.accepted]):
            panels[side] = {METHOD_NAMES[method]: [*taken, solution.cost]}
    return panels
