"""A run folder's own CSV files against the log, by formulas written out here: no solver, no map, no chart of ours."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from teamslam.model import Dataset, Table, is_pose, robot_of

Variable = tuple[str, str, float]
"""'robot' or 'landmark', its name, and a pose's stamp [s]."""


@dataclass(frozen=True)
class Written:
    """One component as it stands in the files: rotation (3, 3) and place (3,) of poses, places of landmarks."""

    rotations: dict[Variable, np.ndarray]
    places: dict[Variable, np.ndarray]


def components(folder: Path) -> list[Written]:
    """The components of a run folder."""
    found: dict[str, Written] = {}
    for row in _rows(folder / "trajectories.csv"):
        part = found.setdefault(row["component"], Written({}, {}))
        name = ("robot", row["robot"], round(float(row["stamp_s"]), 6))
        part.places[name] = _place(row)
        if "heading_rad" in row:
            part.rotations[name] = Rotation.from_euler("z", float(row["heading_rad"])).as_matrix()
        else:
            part.rotations[name] = Rotation.from_quat([float(row[q]) for q in ("qx", "qy", "qz", "qw")]).as_matrix()
    for row in _rows(folder / "landmarks.csv"):
        found[row["component"]].places[("landmark", row["landmark"], 0.0)] = _place(row)
    return [found[number] for number in sorted(found, key=int)]


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _place(row: dict[str, str]) -> np.ndarray:
    return np.array([float(row.get(column, 0.0)) for column in ("x_m", "y_m", "z_m")])


def variable(log: Dataset, key: int) -> Variable:
    """What people call a variable of a log."""
    if is_pose(key):
        return "robot", log.names.robot(int(robot_of(key))), round(float(log.names.stamps_s(np.array(key))), 6)
    return "landmark", log.names.landmark(int(key)), 0.0


def cost(log: Dataset, part: Written) -> tuple[float, int, bool]:
    """What the measurements cost at a component (squared losses), how many numbers they are, and whether one of them is
    of the world."""
    total, numbers, absolute = 0.0, 0, False
    for table in log.tables:
        for row in range(len(table)):
            ends = [variable(log, int(key)) for key in table.keys[row]]
            if all(end in part.places for end in ends):
                weight = table.whitening[row if len(table.whitening) > 1 else 0]
                error = weight @ _residual(table, row, ends, part)
                total, numbers, absolute = (
                    total + float(error @ error),
                    numbers + len(error),
                    absolute or len(ends) == 1,
                )
    return total, numbers, absolute


def _residual(table: Table, row: int, ends: list[Variable], part: Written) -> np.ndarray:
    """z (-) h of one measurement of the models that the stories use."""
    z, d = table.values[row], table.dim
    if table.model == "position":
        return z - part.places[ends[0]][:d]
    turn, at = part.rotations[ends[0]], part.places[ends[0]]
    if table.sensor is not None:
        mount = np.zeros(3)
        mount[: len(table.sensor.translation)] = table.sensor.translation
        at = at + turn @ mount
    seen = turn.T @ (part.places[ends[1]] - at)
    if table.model == "point":
        return z - seen[:d]
    assert table.model == "relative_pose"
    turned = turn.T @ part.rotations[ends[1]]
    measured = np.eye(3)
    measured[:d, :d] = z[d:].reshape(d, d)
    off = Rotation.from_matrix(turned.T @ measured).as_rotvec()
    return np.concatenate([z[:d] - seen[:d], off[2:] if d == 2 else off])


def rmse(log: Dataset, part: Written, kind: str) -> tuple[float, int]:
    """Root mean square distance of a kind of variables after one rigid fit of all that the truth knows, by the SVD
    (Kabsch), and of how many; (nan, 0) for none. Where a robot moves in the plane, the fit does too."""
    assert log.truth is not None
    keys = [int(k) for k in log.truth.layout.keys if variable(log, int(k)) in part.places]
    names = [variable(log, key) for key in keys]
    here = np.array([part.places[name] for name in names])
    there = log.truth.positions(np.array(keys), 3)
    flat = any(dim == 2 for dim in log.robots.values())
    d = 2 if flat else 3
    u, _, vt = np.linalg.svd((here - here.mean(0))[:, :d].T @ (there - there.mean(0))[:, :d])
    turn = np.eye(3)
    turn[:d, :d] = vt.T @ np.diag([1.0] * (d - 1) + [np.linalg.det(vt.T @ u.T)]) @ u.T
    shift = there.mean(0) - turn @ here.mean(0)
    if flat:
        shift[2] = 0.0
    off = np.linalg.norm(here @ turn.T + shift - there, axis=1)[[name[0] == kind for name in names]]
    return (float(np.sqrt(np.mean(off**2))), len(off)) if len(off) else (float("nan"), 0)
