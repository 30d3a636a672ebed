"""A run's results as CSV for spreadsheets and pandas: trajectories, landmarks, team transforms; with covariances.

All are in the frame of the map's base pose: component 1 is the map of the lowest robot. Covariances are upper
triangles, columns `cov_a_b`, of the errors [x y heading] of planar poses, [x y z rx ry rz] of spatial ones
(translation in the map's frame, rotation in the body's own), [x y] or [x y z] of points. The base pose is the frame:
its covariance is 0.
"""

import csv
from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.geometry import Array, Pose, lift_tangent
from teamslam.model import Kind, Submap, index_of
from teamslam.results.record import Record
from teamslam.solver import Covariances, Step

POSE_ERRORS = {2: ("x", "y", "heading"), 3: ("x", "y", "z", "rx", "ry", "rz")}
POSE_COLUMNS = {
    2: ("x_m", "y_m", "heading_rad"),
    3: ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"),
}


def write_trajectory_table(record: Record, path: Path) -> None:
    """All robots' poses, a row a pose, in time order."""
    dim = _pose_dim(record)
    header = ("component", "robot", "stamp_s", *POSE_COLUMNS[dim], *_triangle(POSE_ERRORS[dim]))

    def rows() -> Iterator[list[Any]]:
        for number, submap, covariances in _components(record):
            for robot in submap.robots_in_it:
                keys = submap.trajectory_keys(robot)
                stamps = submap.names.stamps_s(keys)
                poses = submap.all_values.poses_of(keys, dim)
                numbers = _pose_numbers(poses)
                for key, stamp, row in zip(keys.tolist(), stamps.tolist(), numbers.tolist(), strict=True):
                    block = _pose_covariance(submap, covariances, key, dim)
                    yield [number, submap.names.robot(robot), f"{stamp:.6f}", *row, *_upper(block)]

    _write(path, header, rows())


def write_landmarks(record: Record, path: Path) -> None:
    """All landmarks, a row a landmark; a tag's orientation is in map.npz."""
    dim = max((_landmark_dim(m) for m in record.maps), default=2)
    axes = ("x", "y", "z")[:dim]
    header = ("component", "landmark", *(f"{a}_m" for a in axes), *_triangle(axes))

    def rows() -> Iterator[list[Any]]:
        for number, submap, covariances in _components(record):
            keys = submap.landmark_keys
            places = submap.all_values.positions(keys, dim)
            for key, place in zip(keys.tolist(), places.tolist(), strict=True):
                block = np.zeros((dim, dim))
                d = min(dim, Kind(int(submap.values.layout.kinds[submap.values.layout.index(key)])).dim)
                block[:d, :d] = covariances.of(key)[:d, :d]
                yield [number, submap.names.landmark(int(index_of(key))), *place, *_upper(block)]

    _write(path, header, rows())


def write_team(record: Record, path: Path) -> None:
    """Where each robot's own frame (its first pose) lies in the map: the transforms of the team."""
    dim = _pose_dim(record)
    header = ("component", "map_frame", "robot", "stamp_s", *POSE_COLUMNS[dim], *_triangle(POSE_ERRORS[dim]))

    def rows() -> Iterator[list[Any]]:
        for number, submap, covariances in _components(record):
            for robot in submap.robots_in_it:
                key = int(submap.trajectory_keys(robot)[0])
                numbers = _pose_numbers(submap.all_values.poses_of(np.array([key]), dim))[0].tolist()
                stamp = f"{float(submap.names.stamps_s(np.array(key))):.6f}"
                block = _pose_covariance(submap, covariances, key, dim)
                frame = submap.names.describe(submap.base)
                yield [number, frame, submap.names.robot(robot), stamp, *numbers, *_upper(block)]

    _write(path, header, rows())


def write_histories(histories: Sequence[Sequence[Step]], path: Path) -> None:
    """The solver's steps, a row a step, component by component."""
    header = ("component", "step", "cost", "decrement_sigma", "step_norm", "damping", "accepted", "seconds")
    rows = (
        [number, n, s.cost, s.decrement, s.step_norm, s.damping, int(s.accepted), s.seconds]
        for number, history in enumerate(histories, start=1)
        for n, s in enumerate(history)
    )
    _write(path, header, rows)


def read_histories(path: Path, components: int) -> tuple[tuple[Step, ...], ...]:
    """The steps that `write_histories` wrote, of so many components."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    steps = [
        Step(
            cost=float(row[2]),
            decrement=float(row[3]),
            step_norm=float(row[4]),
            damping=float(row[5]),
            accepted=row[6] == "1",
            seconds=float(row[7]),
        )
        for row in rows
    ]
    owners = [int(row[0]) for row in rows]
    return tuple(
        tuple(step for step, owner in zip(steps, owners, strict=True) if owner == number)
        for number in range(1, components + 1)
    )


# --- parts of a row -------------------------------------------------------------------------------------------------


def _components(record: Record) -> Iterator[tuple[int, Submap, Covariances]]:
    for number, (submap, covariances) in enumerate(zip(record.maps, record.covariances, strict=True), start=1):
        yield number, submap, covariances


def _pose_dim(record: Record) -> int:
    """2 where every robot moves in the plane, else 3: planar poses are then written as spatial ones."""
    spatial = any((m.values.layout.kinds == Kind.POSE3).any() or m.base_dim == 3 for m in record.maps)
    return 3 if spatial else 2


def _landmark_dim(submap: Submap) -> int:
    layout = submap.values.layout
    kinds = layout.kinds[layout.index(submap.landmark_keys)]
    return 3 if (kinds % 2 == 1).any() else 2


def _pose_numbers(poses: Pose) -> Array:
    return poses.xytheta() if poses.dim == 2 else np.concatenate([poses.translation, poses.quaternion_wxyz()], -1)


def _pose_covariance(submap: Submap, covariances: Covariances, key: int, dim: int) -> Array:
    """The covariance of a pose in the chart of `dim`; a planar pose among spatial ones cannot tilt or rise."""
    dof = 3 if dim == 2 else 6
    if key == submap.base:
        return np.zeros((dof, dof))
    block = covariances.of(key)
    if len(block) == dof:
        return block
    lift = lift_tangent(2, 3)
    return np.asarray(lift @ block @ lift.T)


def _triangle(names: Sequence[str]) -> list[str]:
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]


def _upper(block: Array) -> list[float]:
    return [float(v) for v in block[np.triu_indices(len(block))]]


def _write(path: Path, header: Sequence[str], rows: Iterator[list[Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
