"""The CSV files say what the map says, in the chart that their header states."""

import csv
from pathlib import Path

import numpy as np
import pytest

from teamslam.model import Kind
from teamslam.results import Record
from teamslam.results.tables import (
    read_histories,
    write_histories,
    write_landmarks,
    write_team,
    write_trajectory_table,
)


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file by column."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def block_of(row: dict[str, str]) -> np.ndarray:
    """The covariance in a row, whole."""
    names = [c for c in row if c.startswith("cov_")]
    n = int((np.sqrt(8 * len(names) + 1) - 1) / 2)
    block = np.zeros((n, n))
    block[np.triu_indices(n)] = [float(row[c]) for c in names]
    return block + np.triu(block, 1).T


def test_trajectories_hold_every_pose_with_its_covariance(record: Record, tmp_path: Path) -> None:
    """In time order; the base pose is the frame and certain."""
    write_trajectory_table(record, tmp_path / "t.csv")
    rows, submap = rows_of(tmp_path / "t.csv"), record.maps[0]
    keys = np.concatenate([submap.trajectory_keys(r) for r in submap.robots_in_it])
    assert len(rows) == len(keys)
    for row, key in zip(rows, keys.tolist(), strict=True):
        pose = submap.all_values.pose(key)
        found = [float(row[c]) for c in ("x_m", "y_m", "z_m")[: pose.dim]]
        np.testing.assert_allclose(found, pose.translation, atol=1e-12)
        if pose.dim == 2:
            assert float(row["heading_rad"]) == pytest.approx(float(pose.heading))
        else:
            q = [float(row[c]) for c in ("qw", "qx", "qy", "qz")]
            np.testing.assert_allclose(q, pose.quaternion_wxyz(), atol=1e-12)
        expected = np.zeros((pose.dof,) * 2) if key == submap.base else record.covariances[0].of(key)
        np.testing.assert_allclose(block_of(row), expected, rtol=1e-12)


def test_landmarks_hold_every_landmark_with_its_covariance(record: Record, tmp_path: Path) -> None:
    """As many coordinates as the landmarks have."""
    write_landmarks(record, tmp_path / "l.csv")
    rows, submap = rows_of(tmp_path / "l.csv"), record.maps[0]
    assert [int(r["landmark"]) for r in rows] == submap.landmark_keys.tolist()
    for row, key in zip(rows, submap.landmark_keys.tolist(), strict=True):
        dim = Kind(int(submap.values.layout.kinds[submap.values.layout.index(key)])).dim
        place = [float(row[c]) for c in ("x_m", "y_m", "z_m")[:dim]]
        np.testing.assert_allclose(place, submap.values.positions(np.array(key), dim), atol=1e-12)
        np.testing.assert_allclose(block_of(row), record.covariances[0].of(key), rtol=1e-12)


def test_the_team_is_each_robots_first_pose(record: Record, tmp_path: Path) -> None:
    """The transforms of the team, the frame's own among them, certain."""
    write_team(record, tmp_path / "team.csv")
    rows, submap = rows_of(tmp_path / "team.csv"), record.maps[0]
    assert [int(r["robot"]) for r in rows] == list(submap.robots_in_it)
    for row, robot in zip(rows, submap.robots_in_it, strict=True):
        first = submap.all_values.pose(int(submap.trajectory_keys(robot)[0]))
        np.testing.assert_allclose([float(row["x_m"]), float(row["y_m"])], first.translation[:2], atol=1e-12)
    assert not block_of(rows[0]).any() and block_of(rows[1]).any()


def test_history_survives_its_file(record: Record, tmp_path: Path) -> None:
    """read_histories(write_histories(h)) == h, field by field (nan included), a component without steps among them."""
    histories = (record.histories[0], (), record.histories[0][:1])
    write_histories(histories, tmp_path / "h.csv")
    assert repr(read_histories(tmp_path / "h.csv", 3)) == repr(histories)
