"""Figures 2, 3 and 4 of the paper, from our own runs of its simulation."""

from typing import TYPE_CHECKING

import numpy as np

from teamslam.joining import Joined
from teamslam.metrics import score
from teamslam.model import WORLD, Dataset, Names, Sources, Submap, Values
from teamslam.model.sparse import sp
from teamslam.paper.reproduction import Reproduction
from teamslam.results.errors import truth_by_team
from teamslam.results.record import robot_sightings
from teamslam.sim import simulate
from teamslam.solver import Covariances
from teamslam.viz import Scene, draw_convergence, draw_map, draw_maps
from teamslam.viz.style import METHOD_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figures_of_paper(found: Reproduction) -> "dict[str, Figure]":
    """New figures by name; nothing is saved. Figures 3 and 4 are left out where no run gives what they draw."""
    figures = {"figure_2": draw_map(world_scene(simulate(found.cells[-1].options)))}
    if any(found.convergence.values()):
        figures["figure_3"] = draw_convergence(
            {METHOD_NAMES[method]: costs for method, costs in found.convergence.items()},
            title="Figure 3: the objective at each iteration, by noise level",
        )
    if found.examples:
        scenes = {
            f"{scenario.capitalize()} sightings, {METHOD_NAMES[method]}": result_scene(run.dataset, joined, method)
            for scenario, run in found.examples.items()
            for method, joined in (("full", run.full), ("join", run.joined))
        }
        figures["figure_4"] = draw_maps(scenes, title="Figure 4: estimates at the highest noise")
    return figures


def world_scene(dataset: Dataset) -> Scene:
    """The truth as a map: where the robots go and where the landmarks are, in the world's own frame."""
    caption = "true paths and landmarks of our own making: the paper does not publish its own"
    return Scene(as_map(dataset.truth, dataset.names), title="Figure 2: the simulated world", caption=caption)


def result_scene(dataset: Dataset, joined: Joined, method: str) -> Scene:
    """One method's map with its 95 % regions and the truth."""
    submap, truth = joined.map, dataset.truth
    assert truth is not None  # simulations know it
    report = score(submap, truth)
    covariances = Covariances.of_map(submap)
    keys = submap.values.layout.keys
    starts = [submap.trajectory_keys(robot)[0] for robot in dataset.robots]
    shown = keys[np.isin(keys, [*submap.landmark_keys, *starts])]
    return Scene(
        map=submap,
        covariances=dict(zip(shown.tolist(), covariances.blocks(shown), strict=True)),
        truth=truth_by_team(submap, truth),
        sightings=robot_sightings(dataset),
        method=method,
        caption=f"RMSE of robots' positions {report.robot_position_rmse_m:.3f} m, of landmarks "
        f"{report.landmark_rmse_m:.3f} m",
    )


def as_map(values: Values | None, names: Names) -> Submap:
    """Values in the world's frame as a map without information."""
    values = Values.of({}) if values is None else values
    n = values.layout.dof
    return Submap("truth", 0, WORLD, 2, values, sp.csr_array((n, n)), Sources(), names)
