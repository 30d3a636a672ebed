"""What a dataset infers from its tables: which variables there are, of which kind, whose, and when."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from teamslam.errors import ModelError
from teamslam.geometry import Pose
from teamslam.joining import build, join, split
from teamslam.model import MODELS, SQUARED, Dataset, Kind, Loss, Names, Table, landmark_key, pack, pose_key
from teamslam.sim import simulate


def sightings(
    robot: int, model: str, dim: int, targets: np.ndarray, *, source: str = "landmarks", at: int = 0
) -> Table:
    """One robot sees some targets, all from its pose `at`."""
    row, m = MODELS[model], len(targets)
    keys = np.stack([np.broadcast_to(pose_key(robot, at), m), targets], -1)
    z = pack(Pose.identity(dim, (m,))) if row.targets_pose else np.ones((m, row.z_size(dim)))
    return Table(robot, source, model, dim, keys, z, np.eye(row.residual_rows(dim))[None], np.arange(m))


def odometry(robot: int, dim: int, count: int) -> Table:
    """A chain of `count` poses."""
    keys = np.stack([pose_key(robot, np.arange(count - 1)), pose_key(robot, np.arange(1, count))], -1)
    n = 3 if dim == 2 else 6
    z = pack(Pose.identity(dim, (count - 1,)))
    return Table(robot, "odometry", "relative_pose", dim, keys, z, np.eye(n)[None], np.arange(count - 1))


def kinds(dataset: Dataset) -> dict[int, Kind]:
    """The kind of each variable."""
    return {int(k): Kind(int(v)) for k, v in zip(dataset.layout.keys, dataset.layout.kinds, strict=True)}


def test_planar_robots_with_points_in_space() -> None:
    dataset = Dataset({1: 2}, (odometry(1, 2, 3), sightings(1, "point", 3, landmark_key([7, 5]))))
    assert kinds(dataset) == {
        **{int(pose_key(1, t)): Kind.POSE2 for t in range(3)},
        5: Kind.POINT3,
        7: Kind.POINT3,
    }
    assert dataset.is_planar and dataset.dim == 3
    assert dataset.dof == 2 * 3 + 2 * 3
    assert_array_equal(dataset.landmark_keys, [5, 7])
    assert_array_equal(dataset.pose_keys[1], pose_key(1, np.arange(3)))


def test_everything_in_the_plane() -> None:
    dataset = Dataset({1: 2}, (odometry(1, 2, 2), sightings(1, "range_bearing", 2, landmark_key([7]))))
    assert set(kinds(dataset).values()) == {Kind.POSE2, Kind.POINT2}
    assert dataset.is_planar and dataset.dim == 2


def test_a_mixed_team() -> None:
    dataset = Dataset({1: 2, 9: 3}, (odometry(1, 2, 2), odometry(9, 3, 2)))
    assert kinds(dataset)[int(pose_key(1, 0))] is Kind.POSE2
    assert kinds(dataset)[int(pose_key(9, 0))] is Kind.POSE3
    assert not dataset.is_planar and dataset.dim == 3


@pytest.mark.parametrize("order", [1, -1])
def test_space_beats_the_plane_and_a_pose_beats_a_point(order: int) -> None:
    tables = (
        sightings(1, "range_bearing", 2, landmark_key([1, 2, 3, 4])),
        sightings(1, "point", 3, landmark_key([2, 4])),
        sightings(1, "relative_pose", 2, landmark_key([3, 4])),
    )[::order]
    found = kinds(Dataset({1: 2}, tables))
    assert [found[k] for k in (1, 2, 3, 4)] == [Kind.POINT2, Kind.POINT3, Kind.POSE2, Kind.POSE3]


def test_a_robot_that_is_only_seen_has_poses() -> None:
    seen = sightings(1, "range_bearing", 2, pose_key(2, [4, 6]), source="robots")
    dataset = Dataset({1: 2, 2: 2, 3: 2}, (seen,))
    assert_array_equal(dataset.pose_keys[2], pose_key(2, [4, 6]))
    assert len(dataset.pose_keys[3]) == 0
    assert len(dataset.landmark_keys) == 0


def test_no_tables_no_variables() -> None:
    dataset = Dataset({1: 2}, ())
    assert len(dataset.layout) == 0 and dataset.dof == 0 and dataset.dim == 2


def test_a_stranger_is_refused_by_name() -> None:
    seen = sightings(1, "range_bearing", 2, pose_key(2, [4]), source="robots")
    with pytest.raises(ModelError, match=r"robots of robot red name robot 2, which is not in the team \(red\)"):
        Dataset({1: 2}, (seen,), Names({1: "red"}))


def test_a_robots_own_log_is_what_it_measured_itself() -> None:
    tables = (odometry(1, 2, 3), odometry(2, 2, 3), sightings(1, "point", 2, pose_key(2, [1]), source="robots"))
    own = Dataset({1: 2, 2: 2}, tables).of_robot(1)
    assert [t.source for t in own.tables] == ["odometry", "robots"]
    assert own.robots == {1: 2, 2: 2}


def test_a_loss_goes_to_sightings_and_to_odometry_only_when_asked() -> None:
    huber = Loss("huber", 2.0)
    dataset = Dataset({1: 2}, (odometry(1, 2, 2), sightings(1, "point", 2, landmark_key([1]))))
    assert [t.loss for t in dataset.with_loss(huber).tables] == [SQUARED, huber]
    assert [t.loss for t in dataset.with_loss(huber, odometry=True).tables] == [huber, huber]
    assert [t.loss for t in dataset.tables] == [SQUARED, SQUARED]


def test_what_is_printed_in_a_notebook_is_a_line() -> None:
    """However much there is: counts, not arrays."""
    log = simulate("planar")
    submaps = [build(piece) for piece in split(log)]
    for record in (log, *log.tables, log.truth, log.layout, *submaps, join(submaps).components[0].solution):
        assert len(repr(record)) < 400 and "array" not in repr(record) and "\n" not in repr(record)
    assert "3 robots, 180 poses, 30 landmarks" in repr(log) and "59 rows of relative_pose in 2D" in repr(log.tables[0])
