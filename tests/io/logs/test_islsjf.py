"""Raw logs of I-SLSJF: Victoria Park and the simulated run, with the numbers that their papers count."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings

from strategies import generators
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import Array
from teamslam.io import read
from teamslam.io.logs import islsjf
from teamslam.io.logs.islsjf import CLEAN
from teamslam.model import Dataset, landmark_key, pose_key

ODOMETRY = [1, 0, 1, 1.0, 0.1, 0.2, 0.04, 0.01, 0, 0.05, 0, 0.01]
ROWS = np.array(
    [
        [0, 0, 5, 3.0, 1.0, 0.1, 0.02, 0.2, 0, 0, 0, 0],
        ODOMETRY,
        [0, 1, 5, 2.0, 0.7, 0.1, 0.0, 0.2, 0, 0, 0, 0],
        [1, 1, 2, *ODOMETRY[3:]],
    ]
)


def written(folder: Path, rows: Any, name: str = CLEAN) -> Path:
    path = folder / f"{CLEAN}.mat"
    scipy.io.savemat(path, {name: rows})
    return path


def test_what_stands_in_a_clean_log(tmp_path: Path) -> None:
    found = read(written(tmp_path, ROWS))
    odometry, sightings = found.tables
    assert odometry.keys.tolist() == pose_key(1, np.array([[0, 1], [1, 2]])).tolist()
    assert sightings.keys.tolist() == [[int(pose_key(1, k)), int(landmark_key(5))] for k in (0, 1)]
    assert np.allclose(odometry.values[0], [1.0, 0.1, np.cos(0.2), -np.sin(0.2), np.sin(0.2), np.cos(0.2)])
    w = sightings.whitening[0]
    assert np.allclose(np.linalg.inv(w.T @ w), [[0.1, 0.02], [0.02, 0.2]])
    w = odometry.whitening[0]
    assert np.allclose(np.linalg.inv(w.T @ w), [[0.04, 0.01, 0], [0.01, 0.05, 0], [0, 0, 0.01]])


def test_victoria_park(data: Callable[[str], Path]) -> None:
    found = read(data("islsjf_vicpark_200"))  # the folder holds the clean log beside the local maps
    odometry, sightings = found.tables
    assert (len(odometry), len(sightings)) == (6898, 45390)
    assert found.dof == 111_474
    assert found.layout.dof - 3 == 21_292  # the first pose is the frame
    assert len(found.landmark_keys) == 299


def test_the_simulated_run_agrees_with_its_truth(data: Callable[[str], Path]) -> None:
    found = read(data("islsjf_535"))
    odometry, sightings = found.tables
    assert (len(odometry), len(sightings)) == (535, 850)
    assert found.truth is not None
    # The two speeds carry two numbers a step; the third is the slip that is stated and never happened.
    assert np.sum(odometry.whitened(found.truth) ** 2) == pytest.approx(2 * 535, rel=0.15)
    spread = np.mean(sightings.whitened(found.truth) ** 2, 0)
    assert np.all(np.abs(spread - 1.0) < 0.15)


def test_the_slip_is_an_option(data: Callable[[str], Path]) -> None:
    folder = data("islsjf_535")
    loose, tight = (np.linalg.inv(read(folder, slip_m=s).tables[0].whitening[0]) for s in (0.1, 0.001))
    covariance = loose @ loose.T - tight @ tight.T
    assert np.allclose(covariance, np.diag([0.1**2 - 1e-6, 0.1**2 - 1e-6, 0]), atol=1e-12)
    with pytest.raises(InputError, match="field 'slip_m': expected a length above 0"):
        read(folder, slip_m=0.0)


def changed(row: int, column: int, value: float) -> Array:
    rows = ROWS.copy()
    rows[row, column] = value
    return rows


DAMAGE: dict[str, tuple[Array, str]] = {
    "wrong columns": (ROWS[:, :11], f"field '{CLEAN}': expected 12 columns, found 11"),
    "empty": (np.zeros((0, 12)), "the matrix is empty"),
    "nan": (changed(2, 4, np.nan), "row 3 holds a number that is not finite"),
    "strange kind": (changed(0, 0, 2), "row 1 begins with 2.0, expected 1"),
    "half a pose": (changed(1, 2, 1.5), "expected a whole number, found 1.5"),
    "gap": (changed(3, 1, 2), "odometry row 2 goes from pose 2 to 2, expected 1 to 2"),
    "back": (changed(3, 2, 0), "odometry row 2 goes from pose 1 to 0"),
    "unknown pose": (changed(2, 1, 7), "observation 2 sees feature 5 from pose 7, but odometry knows the poses 0 to 2"),
    "negative feature": (changed(2, 2, -1), "observation 2 sees feature -1"),
    "indefinite odometry": (changed(3, 6, -1), "odometry row 2: the covariance is not positive definite"),
    "indefinite observation": (changed(2, 6, 9), "observation 2: the covariance is not positive definite"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    rows, expected = DAMAGE[name]
    with pytest.raises(InputError, match=expected) as caught:
        read(written(tmp_path, rows))
    assert f"{CLEAN}.mat" in str(caught.value)


def test_another_matrix(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"expected a matrix '{CLEAN}', found other"):
        read(written(tmp_path, ROWS, "other"))


def test_files_that_are_no_matlab_files(tmp_path: Path) -> None:
    path = tmp_path / f"{CLEAN}.mat"
    for content in (b"", b"MATLAB 7.3 MAT-file" + bytes(200), bytes(range(256)) * 4, b"hello"):
        path.write_bytes(content)
        with pytest.raises(InputError):
            read(path)


@given(generators)
@settings(max_examples=40)
def test_nothing_but_a_log_or_an_error_comes_out(
    tmp_path_factory: pytest.TempPathFactory, rng: np.random.Generator
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    rows = ROWS.copy()
    for _ in range(2):
        at = rng.integers(0, rows.shape)
        rows[tuple(at)] = rng.choice([np.nan, np.inf, -1, 0, 1, 2, 0.5, 1e300, 1e-300, 2.0**60])
    path = written(folder, rows[: rng.integers(0, 5), : rng.integers(10, 14)])
    if rng.random() < 0.3:
        path.write_bytes(path.read_bytes()[: rng.integers(0, 300)])
    try:
        found = islsjf.read(path)
    except TeamslamError:
        return
    assert isinstance(found, Dataset)
