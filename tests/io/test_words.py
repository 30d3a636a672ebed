"""Every kind of measurement into every format: it is written, in other words if need be, or the advice works."""

import re
from pathlib import Path

import numpy as np
import pytest

from logs import measured
from strategies import random_poses
from teamslam.errors import InputError
from teamslam.io import FORMATS, read, write
from teamslam.model import MODELS, Dataset, Names, Table, landmark_key, pack, pose_key
from worlds import team

WRITTEN = [name for name, row in FORMATS.items() if row.writes]
NATIVE = [name for name, row in MODELS.items() if row.native]


def dataset(model: str, dim: int, *, target: str, sensor: bool) -> Dataset:
    """One robot's odometry and its measurements of a model: of landmarks, another robot or itself in the world."""
    rng = np.random.default_rng(0)
    poses, others, marks = pose_key(1, np.arange(4)), pose_key(2, np.arange(4)), landmark_key(np.arange(7, 11))
    step = pack(random_poses(rng, dim, 3))
    noise = np.eye(MODELS["relative_pose"].residual_rows(dim))[None]
    links = [
        Table(r, "odometry", "relative_pose", dim, np.stack([k[:-1], k[1:]], -1), step, noise, np.arange(3))
        for r, k in ((1, poses), (2, others))
    ]
    seen = {"landmarks": marks, "robots": others, "world": poses}[target]
    keys = seen[:, None] if MODELS[model].unary else np.stack([poses, seen], -1)
    rows = MODELS[model].residual_rows(dim)
    root = rng.normal(size=(4, rows, rows)) + 3 * np.eye(rows)
    eye = random_poses(rng, dim, spread=0.3) if sensor else None
    table = Table(1, target, model, dim, keys, measured(rng, model, dim, 4), root, np.arange(4), eye)
    return Dataset({1: dim, 2: dim}, (*links, table), Names(tick_s=1.0))


CASES = [
    (model, dim, target, sensor)
    for model in NATIVE
    for dim in (2, 3)
    if MODELS[model].z_size(dim)
    for target in (("world", "landmarks") if MODELS[model].unary else ("landmarks", "robots"))
    for sensor in ((False,) if MODELS[model].unary else (False, True))
]


@pytest.mark.parametrize(("model", "dim", "target", "sensor"), CASES)
def test_every_measurement_finds_its_way(model: str, dim: int, target: str, sensor: bool, tmp_path: Path) -> None:
    log = dataset(model, dim, target=target, sensor=sensor)
    able = 0
    for name in WRITTEN:
        path = tmp_path / name
        try:
            said = write(log, path, name)
        except InputError as error:
            advice = re.search(r"of the formats that teamslam writes, (.*) can hold all of this log", str(error))
            assert advice, error
            for other in advice[1].split(" and "):  # the advice, followed
                write(log, tmp_path / f"{name}-{other}", other)
                assert _rows(read(tmp_path / f"{name}-{other}", format=other)) == _rows(log)
            continue
        able += 1
        found = read(path, format=name)
        assert _rows(found) == _rows(log), name
        others = [t for t in found.tables if (t.model, t.sensor is None) != (model, not sensor) and t.source == target]
        told = [drop for drop in said if drop.reason.endswith(("first order", "exactly"))]
        assert sum(map(len, others)) == max([drop.count for drop in told], default=0), name  # it is told
    assert able >= 1


def _rows(log: Dataset) -> int:
    return sum(len(table) for table in log.tables)


@pytest.mark.parametrize("preset", ["2d", "planar", "3d"])
def test_a_simulated_team_goes_through_every_format(preset: str, tmp_path: Path) -> None:
    log = team(preset, poses=4)
    for name in WRITTEN:
        try:
            write(log, tmp_path / name, name)
        except InputError as error:
            assert "plain" in str(error).split("of the formats")[1]
            continue
        assert _rows(read(tmp_path / name, format=name)) == _rows(log)
