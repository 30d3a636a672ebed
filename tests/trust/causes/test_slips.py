"""Slips are undone as they are made: what is planted and taken out again is the log as it was."""

from dataclasses import replace

import numpy as np
import pytest

import faults
from teamslam.geometry import Array, Pose
from teamslam.model import MODELS, Table, pack
from teamslam.model.sensors import pose_of
from teamslam.pipeline import run
from teamslam.sim.scenario import Options, Robot, simulate_options
from teamslam.sim.sense import Sensor, blank
from teamslam.trust.causes.slips import MEASURES, slips, without

PLANTED = {
    "axes x -y z": faults.mirrored,
    "axes y x z": faults.axes,
    "millimetres": faults.longer(1e3),
    "inverse": faults.inverted,
    "turns x -y z": faults.negated_angle,
    "places y x z": faults.swapped,
    "degrees": faults.degrees,
}


def table_of(model: str, dim: int) -> Table:
    """Measurements of any size."""
    rng = np.random.default_rng(3)
    table = blank(1, "landmarks", model, dim, np.zeros((20, 2), np.int64), np.ones(MODELS[model].residual_rows(dim)))
    eye = Pose.identity(dim, (20,))
    target = Pose.from_tangent(rng.normal(size=(20, eye.dof)), dim)
    place: Pose | Array = target if table.row.targets_pose else target.translation * 3.0
    return replace(table, values=table.row.predict(eye, place, dim))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MEASURES)
def test_every_slip_keeps_a_table_a_table(model: str, dim: int) -> None:
    """Unit vectors stay unit vectors, rotations rotations, lengths and angles finite; names are unique."""
    table = table_of(model, dim)
    found = slips(model, dim)
    assert len({slip.name for slip in found}) == len(found)
    for slip in found:
        undone = slip.undone(table)
        assert np.isfinite(undone.values).all()
        if table.row.targets_pose:
            turn = undone.values[:, dim:].reshape(-1, dim, dim)
            np.testing.assert_allclose(
                turn @ np.swapaxes(turn, 1, 2), np.broadcast_to(np.eye(dim), turn.shape), atol=1e-12
            )
            np.testing.assert_allclose(np.linalg.det(turn), 1.0)
        elif "bearing" in model and dim == 3:
            np.testing.assert_allclose(np.linalg.norm(undone.values[:, -3:], axis=-1), 1.0)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MEASURES)
def test_what_was_planted_is_undone(model: str, dim: int) -> None:
    """Each fault of the tests by the slip that stands for it."""
    table = table_of(model, dim)
    names = {slip.name for slip in slips(model, dim)}
    for name, fault in PLANTED.items():
        if name not in names or name == "axes y x z":
            continue
        again = without(fault(table), name)
        np.testing.assert_allclose(again.row.minus(again.values, table.values, dim), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["turns x -y z", "axes x -y z", "axes y x z"])
def test_the_same_slip_in_the_plane_and_in_space(name: str) -> None:
    """A planar pose lifted into space, without the slip there, is the planar one without it, lifted."""
    flat = Pose.from_xytheta(np.random.default_rng(1).normal(size=(5, 3)))
    planar, spatial = table_of("relative_pose", 2), table_of("relative_pose", 3)
    in_plane = without(replace(planar.select(np.arange(5)), values=pack(flat)), name)
    in_space = without(replace(spatial.select(np.arange(5)), values=pack(flat.lift(3))), name)
    np.testing.assert_allclose(in_space.values[:, :2], in_plane.values[:, :2])
    np.testing.assert_allclose(
        in_space.values[:, 3:].reshape(-1, 3, 3)[:, :2, :2], in_plane.values[:, 2:].reshape(-1, 2, 2)
    )


def test_nothing_is_said_of_sensors_that_people_added() -> None:
    """Nobody knows what their numbers mean."""
    assert slips("signal_strength", 2) == ()


@pytest.mark.parametrize("turn", range(1, 4))
def test_a_sensor_that_is_turned_on_one_robot_of_several_that_see_the_same_tags_is_named(turn: int) -> None:
    """The tags' own turns do not turn with it, so axes of all that the robot sees are no explanation."""
    kind = Robot(landmarks=Sensor("relative_pose", range_m=6.0))
    log = simulate_options(Options(space="2d", robots=3, poses=60, landmarks=20, team=(kind,)), turn)
    off = Pose.from_xytheta(np.array([0.0, 0.0, turn * np.pi / 2]))
    wrong = log.with_tables(
        replace(t, values=pack(off @ pose_of(t.values, 2))) if t.robot == 2 and t.source == "landmarks" else t
        for t in log.tables
    )
    told = [c for c in run(wrong).trust.verdict.mistakes if c.robots == (2,)]
    assert [c for c in told if "sightings of landmarks: their sensor is turned on its robot" in c.sentence]
    assert not any("axes are others: they fit as" in c.sentence and "odometry" not in c.sentence for c in told)
    assert not run(log).trust.verdict.mistakes
