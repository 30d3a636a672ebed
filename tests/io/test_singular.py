"""Measurements that say nothing in some direction go through the formats that can hold them; others name these."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import dims, generators, random_poses
from teamslam.errors import InputError
from teamslam.io import read, write
from teamslam.io.graphs.information import information_of_whitening
from teamslam.model import Dataset, Names, Table, landmark_key, pack, pose_key, whitening_of_information


def log(rng: np.random.Generator, dim: int, rank: int) -> Dataset:
    """Odometry, and landmarks of which every other sighting has a lower rank."""
    poses, rows = pose_key(1, np.arange(5)), 3 * dim - 3
    steps = Table(1, "odometry", "relative_pose", dim, np.stack([poses[:-1], poses[1:]], -1),
                  pack(random_poses(rng, dim, 4)), _noise(rng, 4, rows, rank), np.arange(4))  # fmt: skip
    keys = np.stack([poses, np.repeat(landmark_key(7), 5)], -1)
    seen = Table(1, "landmarks", "point", dim, keys, rng.normal(size=(5, dim)), _noise(rng, 5, dim, 1), np.arange(5))
    return Dataset({1: dim}, (steps, seen), Names({1: "a"}, {}, 1.0))


def _noise(rng: np.random.Generator, count: int, rows: int, rank: int) -> np.ndarray:
    root = rng.normal(size=(count, rows, rows)) * 10.0 ** rng.uniform(-0.5, 0.5, rows)
    root[::2, min(rank, rows - 1) :] = 0.0
    return whitening_of_information(np.swapaxes(root, 1, 2) @ root)


@pytest.mark.parametrize("name", ["plain", "g2o"])
@given(generators, dims, st.integers(1, 5))
def test_it_reads_back_as_it_was(name: str, rng: np.random.Generator, dim: int, rank: int) -> None:
    expected = log(rng, dim, rank)
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("log.g2o" if name == "g2o" else "log")
        assert not [drop for drop in write(expected, path, name) if "estimate" not in drop.reason]
        found = read(path)
    for mine, theirs in zip(found.tables, expected.tables, strict=True):
        a, b = (information_of_whitening(t.whitening) for t in (mine, theirs))
        size = np.abs(b).max((1, 2), keepdims=True)
        assert (np.abs(a - b) <= 1e-7 * size).all()
        assert mine.ranks.tolist() == theirs.ranks.tolist()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("rank", [1, 2])
def test_scales_that_lie_far_apart_leave_the_rank(rank: int, dim: int, tmp_path: Path) -> None:
    """g2o counts errors in other axes; turned into these and back, what is weak stays what it is."""
    rows = 3 * dim - 3
    rng = np.random.default_rng([dim, rank])
    root = np.zeros((100, rows, rows))
    root[:, rows - rank :] = rng.normal(size=(100, rank, rows)) * 10.0 ** rng.uniform(-3.0, 0.0, (100, 1, rows))
    whitening = whitening_of_information(np.swapaxes(root, 1, 2) @ root)
    poses = pose_key(1, np.arange(101))
    steps = Table(1, "odometry", "relative_pose", dim, np.stack([poses[:-1], poses[1:]], -1),
                  pack(random_poses(rng, dim, 100)), whitening, np.arange(100))  # fmt: skip
    write(Dataset({1: dim}, (steps,), Names({1: "a"}, {}, 1.0)), tmp_path / "log.g2o", "g2o")
    assert (read(tmp_path / "log.g2o").tables[0].ranks == rank).all()


@pytest.mark.parametrize("name", ["pyfg", "jrl"])
def test_formats_of_covariances_name_the_others(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="of the formats that teamslam writes, plain and g2o can hold all of this log"):
        write(log(np.random.default_rng(0), 2, 1), tmp_path / "log", name)


def test_columns_of_information_in_a_table(tmp_path: Path) -> None:
    (tmp_path / "team.toml").write_text(
        '[[robot]]\nname = "red"\n[[log]]\nfile = "a.csv"\nmodel = "point"\nrobot = "red"\n'
    )
    text = "stamp,landmark,x,y,inf_x_x,inf_x_y,inf_y_y\n0,7,2,0.5,4,0,0\n1,7,2,0.5,1,0,9\n"
    (tmp_path / "a.csv").write_text(text)
    (found,) = read(tmp_path).tables
    assert information_of_whitening(found.whitening).tolist() == [[[4, 0], [0, 0]], [[1, 0], [0, 9]]]
    for change, problem in (
        (("4,0,0\n", "4,9,1\n"), "line 2: the information has a negative eigenvalue"),
        (("inf_x_y,", "x_y,"), "unknown column"),
    ):
        (tmp_path / "a.csv").write_text(text.replace(*change))
        with pytest.raises(InputError, match=problem):
            read(tmp_path)
    (tmp_path / "a.csv").write_text("stamp,landmark,x,y,inf_x_x\n0,7,2,0.5,4\n")
    with pytest.raises(InputError, match="field 'inf_x_y': there is 'inf_x_x' but no such column"):
        read(tmp_path)
