"""Sensors that sit elsewhere than stated are found and estimated with the map, and nobody else is blamed."""

import numpy as np
import pytest

import faults
import teamslam as ts
from teamslam.geometry import Pose, so3
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.sim import simulate
from teamslam.trust import verdict
from teamslam.trust.cause import Cause
from teamslam.trust.mounts import misplaced

ASIDE = Pose.from_xytheta(np.array([0.5, 0.25, 0.0]))
"""Half a metre ahead, and to the left: a laser at the bumper."""
DOWN = Pose(so3.exp(np.array([0.0, 0.4, 0.0])), np.zeros(3))
"""A camera that looks 23 degrees down and is stated to look ahead."""


def told(log: Dataset) -> list[Cause]:
    """What is told of a log's sensors."""
    joined = ts.join([ts.build(piece) for piece in ts.split(log)])
    return misplaced(log, verdict(log, joined).rows)


@pytest.mark.parametrize("robots", [(2,), (1, 2, 3)], ids=["one", "all"])
def test_a_lever_arm_that_nobody_stated_is_found_with_the_map(robots: tuple[int, ...]) -> None:
    """Its place is found within its own uncertainty, the map fits and holds what its covariances promise, and is about
    as near to the truth as without the fault; nobody is suspected."""
    log = simulate("2d", 4)
    honest, result = run(log), run(faults.mounted(log, robots, ASIDE))
    assert [cause.kind for cause in result.apart] == ["mount"] and result.apart[0].robots == robots
    assert result.verdict.level in ("fits", "loose") and not [*result.suspicions.sentences()]
    found = result.unknowns.found if result.unknowns else ()
    for robot in robots:
        mine = {f.unknown.name: f for f in found if f.unknown.of == f"robot {robot}, sensor of landmarks"}
        for name, true in (("x", 0.5), ("y", 0.25)):
            assert abs(mine[name].value - true) < 4.0 * mine[name].sigma
    score = result.scores[0]
    assert score.nees_per_dof < 1.5
    assert score.robot_position_rmse_m < 1.5 * honest.scores[0].robot_position_rmse_m


def test_what_stays_uncertain_of_a_sensor_is_in_a_map_whose_noise_was_put_right() -> None:
    """Odometry that is worse than stated beside it: the second map holds what its covariances promise as well."""
    log = faults.plant(simulate("2d", 5), faults.surer(1.7), source="odometry")
    result = run(faults.mounted(log, (1, 2, 3), ASIDE))
    assert [cause.kind for cause in result.apart] == ["mount"] and result.calibration
    assert result.scores[0].nees_per_dof < 1.25


@pytest.mark.parametrize("preset", ["planar", "3d"])
def test_a_camera_that_looks_down_and_is_stated_level_is_found(preset: str) -> None:
    """Of points in space the angle is found, and the map is as good as that of the log without the fault."""
    result = run(faults.mounted(simulate(preset, 4), (2,), DOWN))
    assert [cause.kind for cause in result.apart] == ["mount"] and result.verdict.level in ("fits", "loose")
    turns = [f for f in (result.unknowns.found if result.unknowns else ()) if "its y" in f.unknown.name]
    assert abs(turns[1].value - 0.4) < 4.0 * turns[1].sigma
    assert result.scores[0].nees_per_dof < 1.5


def turned_halfway(log: Dataset, robot: int) -> Dataset:
    """The log with a sensor that was knocked in the middle of it."""
    there = faults.mounted(log, (robot,), Pose.from_xytheta(np.array([0.0, 0.0, 0.35])))
    middle = np.median(log.pose_keys[robot])
    both = zip(log.tables, there.tables, strict=True)
    return log.with_tables(
        part
        for a, b in both
        for part in (a.select(a.keys[:, 0] < middle), b.select(b.keys[:, 0] >= middle))
        if len(part)
    )


FAULTS = {
    "nothing": lambda log: log,
    "odometry that is too long": lambda log: faults.plant(log, faults.longer(1.1), source="odometry", robots=(2,)),
    "sigmas that are too small": lambda log: faults.plant(log, faults.surer(3.0)),
    "late sightings": lambda log: faults.plant(log, faults.late(log, 1), source="landmarks", robots=(2,)),
    "a sensor that was knocked": lambda log: turned_halfway(log, 2),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("preset", ["2d", "planar"])
def test_no_sensor_is_said_to_be_elsewhere_for_another_reason(preset: str, fault: str) -> None:
    """Whatever else is wrong with a log, or nothing, is no place of a sensor."""
    assert told(FAULTS[fault](simulate(preset, 7))) == []


def test_a_sensor_that_saw_nothing_on_the_stretch_that_is_looked_at_ends_nothing() -> None:
    """As another's that saw little: what is told is told of those that saw something there."""
    log = faults.mounted(simulate("2d", 4), (2,), ASIDE)
    few = log.with_tables(
        table.select(np.arange(len(table)) >= len(table) - 2)
        if (table.robot, table.source) == (3, "landmarks")
        else table
        for table in log.tables
    )
    assert [cause.robots for cause in told(few)] == [(2,)]
