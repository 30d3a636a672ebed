"""Windows of published logs, half a minute of a team: maps of little data are maps of it, or say why not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.io import read
from teamslam.metrics import score
from teamslam.model import Dataset, Loss, index_of, is_pose, robot_of
from teamslam.pipeline import run

AS_STATED = Config(calibrate=False)


def window(log: Dataset, first: int, last: int, robots: tuple[int, ...] = (1, 2, 3, 4, 5)) -> Dataset:
    """What some robots of a log measured of each other and of landmarks in a stretch of time [us]."""
    tables = []
    for table in log.tables:
        poses, index = is_pose(table.keys), index_of(table.keys)
        inside = (index >= first) & (index <= last) & np.isin(robot_of(table.keys), robots)
        tables.append(table.select((inside | ~poses).all(1)))
    dims = {robot: dim for robot, dim in log.robots.items() if robot in robots}
    return Dataset(dims, tuple(t for t in tables if len(t)), log.names, truth=log.truth)


def test_a_join_that_is_far_from_full_least_squares_goes_on_to_it(data: Callable[[str], Path]) -> None:
    """Submaps of a few seconds are no Gaussians: the join of three robots' cost fourteen times what the optimum does,
    and put landmarks 0.3 m from where they are."""
    log = window(read(data("mrclam_9")), 1288972027251000, 1288972064386000, (2, 3, 4)).with_loss(Loss("huber", 6.0))
    found, full = run(log, AS_STATED), run(log, Config(method="full", calibrate=False))
    assert found.map.cost == pytest.approx(full.map.cost, rel=1e-6)
    assert any("joined in rounds" in remark for remark in found.joined.remarks)
    (report,) = found.scores
    (best,) = (score(component.map, log.truth) for component in full.joined.components)
    assert report.landmark_rmse_m < 1.01 * best.landmark_rmse_m < 0.1


def test_who_lies_is_asked_of_no_more_than_there_is(data: Callable[[str], Path]) -> None:
    """Without what a loss expects to be wrong a landmark was open, and the whole run ended in that."""
    log = window(read(data("mrclam_9")), 1288972217501000, 1288972231963000).with_loss(Loss("geman_mcclure", 3.0))
    found = run(log, AS_STATED)
    assert found.joined.converged and len(found.joined.maps) == 2
