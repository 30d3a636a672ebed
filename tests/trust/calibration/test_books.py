"""The map of a log that was put right has books of its own: what went in is in one map or left out, and no more."""

from collections import Counter

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.model import Dataset, is_parameter
from teamslam.pipeline import run
from trust.calibration.faulty import misstated, team

METHODS = {"join": Config(), "full": Config(method="full")}


def _seen_once_from_nowhere(log: Dataset) -> Dataset:
    """A team of which robot 1 had no odometry for a while, and measured one range from each place there."""
    (steps,) = (t for t in log.tables if t.robot == 1 and t.source == "odometry")
    lost = steps.keys[40:42, 1]
    tables = []
    for table in log.tables:
        about = np.isin(table.keys, lost).any(1)
        if table.robot == 1 and table.source == "landmarks":
            _, first = np.unique(table.keys[:, 0], return_index=True)
            about[first] = False
        tables.append(table.select(~about))
    return log.with_tables(tables)


@pytest.mark.parametrize("method", METHODS)
def test_poses_that_no_map_could_hold_are_left_out_once(method: str) -> None:
    log = misstated(_seen_once_from_nowhere(team(1, "range", poses=60)), 2.0)
    found = run(log, METHODS[method])
    assert found.calibration and not any(is_parameter(out.keys).any() for out in found.joined.left_out)
    known = [submap.keys[~is_parameter(submap.keys)] for submap in found.joined.maps]
    counts = Counter(np.concatenate([*known, *(out.keys for out in found.joined.left_out)]).tolist())
    assert counts == Counter(log.layout.keys.tolist())
    held = sum(int(submap.rows_of(table).sum()) for submap in found.joined.maps for table in log.tables)
    assert held + sum(out.count for out in found.joined.left_out) == sum(map(len, log.tables))
    assert all(component.map.dof for component in found.joined.components)


def test_residuals_of_a_run_are_those_of_every_row() -> None:
    log = misstated(team(1, poses=60), 2.0)
    found = run(log)
    assert found.calibration and len(found.residuals()) == sum(map(len, log.tables))


def test_what_was_in_no_map_is_in_none_of_the_log_put_right_for_the_same_reasons() -> None:
    log = misstated(_seen_once_from_nowhere(team(1, "range", poses=60)), 2.0)
    before, after = (run(log, Config(calibrate=calibrate)).joined for calibrate in (False, True))
    assert len(before.left_out) == 2
    assert [(out.what, out.count, out.reason) for out in before.left_out] == [
        (out.what, out.count, out.reason) for out in after.left_out
    ]
    assert not after.searched  # its submaps lie where the map before had them
