"""Sensors that turn on their robots while these drive are found and estimated with the map; nothing else is one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import faults
import teamslam as ts
from teamslam.geometry import Array
from teamslam.joining import AtMap
from teamslam.model import Dataset, Table
from teamslam.pipeline import run
from teamslam.results import Record
from teamslam.results.figures import clocks_figure
from teamslam.sim import simulate
from teamslam.trust.cause import Cause
from teamslam.trust.turning import QUICK, turning
from teamslam.trust.unknowns import settled


def turned(log: Dataset, robot: int, angle: Callable[[Array], Array]) -> Dataset:
    """The log with a sensor of a robot that is turned to the left, by an `angle` of the share of it that is over."""
    first, last = log.names.stamps_s(log.pose_keys[robot][[0, -1]]).tolist()

    def seen(table: Table) -> Array:
        back = -angle((log.names.stamps_s(table.keys[:, 0]) - first) / (last - first))
        cos, sin = np.cos(back), np.sin(back)
        x, y = table.values[:, 0], table.values[:, 1]
        return np.column_stack([cos * x - sin * y, sin * x + cos * y, table.values[:, 2:]])

    return log.with_tables(
        replace(table, values=seen(table)) if (table.robot, table.source) == (robot, "landmarks") else table
        for table in log.tables
    )


def told(log: Dataset) -> list[Cause]:
    """What is told of a log's sensors."""
    joined = ts.full(log)
    return turning(log, [AtMap(log.tables, component.map) for component in joined.components])


SWAYS: dict[str, Callable[[Array], Array]] = {
    "a gimbal": lambda share: 0.15 * np.sin(4.0 * np.pi * share),
    "a knock": lambda share: np.where(share > 0.55, 0.35, 0.0),
    "a screw that works loose": lambda share: 0.5 * share**2,
}


@pytest.mark.parametrize(
    ("preset", "way"), [("planar", "a gimbal"), ("2d", "a knock"), ("2d", "a screw that works loose")]
)
def test_a_sensor_that_turns_is_told_with_its_turns(preset: str, way: str) -> None:
    """Whose it is, and its turns within their own uncertainty and what they bend between two moments."""
    log = turned(simulate(preset, 4), 2, SWAYS[way])
    (cause,) = told(log)
    assert cause.kind == "turning" and cause.robots == (2,) and cause.explains > 0.7 and cause.mend
    first, last = log.names.stamps_s(log.pose_keys[2][[0, -1]]).tolist()
    found = settled(cause.mend(log), QUICK)
    assert found is not None and not found.why
    for each in found.found:
        name = each.unknown.name.split()
        share = (float(name[-2]) - first) / (last - first)
        true = float(SWAYS[way](np.array(share))) if "z" in name else 0.0
        assert abs(each.value - true) < 4.0 * each.sigma + (0.05 if way == "a gimbal" else 0.01)
    assert len(found.found) == 2 or way != "a knock"


def test_the_map_is_as_if_nothing_had_turned() -> None:
    """It fits and holds what its covariances promise, and is about as near to the truth; nobody is suspected."""
    log = simulate("2d", 4)
    honest, result = run(log), run(turned(log, 2, SWAYS["a gimbal"]))
    assert [(cause.kind, cause.robots) for cause in result.apart] == [("turning", (2,))]
    assert result.verdict.level in ("fits", "loose") and not [*result.suspicions.sentences()]
    assert result.scores[0].nees_per_dof < 1.5
    assert result.scores[0].robot_position_rmse_m < 1.5 * honest.scores[0].robot_position_rmse_m
    (course,) = clocks_figure(Record.of(result))["clocks"].axes
    (line,) = (line for line in course.lines if len(line.get_xdata()) > 2 and line.get_linestyle() == "-")
    there = np.asarray(line.get_xdata()) / (honest.map.names.stamps_s(log.pose_keys[2][[0, -1]]) @ [-1.0, 1.0])
    true = np.degrees(SWAYS["a gimbal"](there))
    assert len(true) == len(result.unknowns.found) and np.corrcoef(line.get_ydata(), true)[0, 1] > 0.9


FAULTS: dict[str, Callable[[Dataset], Dataset]] = {
    "nothing": lambda log: log,
    "odometry that turns too far": lambda log: faults.plant(log, faults.longer(1.1), source="odometry", robots=(2,)),
    "odometry that is worse than stated": lambda log: faults.plant(log, faults.surer(5.0), source="odometry"),
    "one robot's odometry that is": lambda log: faults.plant(log, faults.surer(5.0), source="odometry", robots=(2,)),
    "sigmas that are too small": lambda log: faults.plant(log, faults.surer(3.0)),
    "late sightings": lambda log: faults.plant(log, faults.late(log, 1), source="landmarks", robots=(2,)),
    "a step that jumped": lambda log: faults.jumped(log, 2, 30, 300.0),
    "a landmark that moved": lambda log: faults.landmark_moved(
        log, int(log.landmark_keys[0]), np.full(2, 0.5), (1, 2, 3), after=0.5
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_no_sensor_is_said_to_turn_for_another_reason(fault: str) -> None:
    """Whatever else is wrong with a log, or nothing, is no sensor that turns."""
    assert told(FAULTS[fault](simulate("2d", 7))) == []
