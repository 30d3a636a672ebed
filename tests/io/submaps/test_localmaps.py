"""Local maps of other submap joiners: chains of submaps, their chart in space, and every kind of damage."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from damage import damaged_text
from strategies import dims, generators, random_poses
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import Array, Pose
from teamslam.io import read_submaps, write_submaps
from teamslam.io.submaps import localmaps_mat, localmaps_text
from teamslam.model import WORLD, Kind, Names, Sources, Submap, Values, landmark_key, point_kind, pose_key, pose_kind


def spd(rng: np.random.Generator, n: int) -> Array:
    root = rng.normal(size=(n, n))
    return np.asarray(root @ root.T + np.eye(n))


def mat_map(folder: Path, number: int, state: Array, covariance: Array) -> Path:
    path = folder / f"localmap_{number}.mat"
    scipy.io.savemat(path, {"localmap_st": state, "localmap_P": covariance})
    return path


STATE = np.array([[0, 5.0], [0, 1.0], [0, 0.3], [12, 2.0], [12, 3.0], [7, -1.0], [7, 4.0]])
COVARIANCE = spd(np.random.default_rng(0), 7)


# --- I-SLSJF ----------------------------------------------------------------------------------------------------------


def test_a_chain_of_mat_files(tmp_path: Path) -> None:
    for number in (1, 2, 10, 9, 8, 7, 6, 5, 4, 3):
        mat_map(tmp_path, number, STATE, COVARIANCE)
    maps = read_submaps(tmp_path)
    assert [m.base for m in maps] == pose_key(1, np.arange(10)).tolist()  # in the order of numbers, not of names
    for before, after in pairwise(maps):
        assert before.values.layout.contains(after.base)
        assert before.sources.overlap(after.sources) is None
    first = maps[0]
    assert first.values.layout.keys.tolist() == [int(pose_key(1, 1)), 7, 12]
    assert np.allclose(first.values.pose(int(pose_key(1, 1))).xytheta(), [5, 1, 0.3])
    assert np.asarray(first.values.of_kind(Kind.POINT2)).tolist() == [[-1, 4], [2, 3]]
    order = [0, 1, 2, 5, 6, 3, 4]  # poses, then points by their numbers
    assert np.allclose(np.linalg.inv(first.information.toarray()), COVARIANCE[np.ix_(order, order)])
    assert first.rows == first.dof == 7 and first.robots == (1,)


def test_victoria_park(data: Callable[[str], Path]) -> None:
    maps = read_submaps(data("islsjf_vicpark_200"))
    assert len(maps) == 200
    landmarks = {int(key) for m in maps for key in m.landmark_keys}
    assert len(landmarks) == 299
    assert sum(m.dof for m in maps) - (3 * len(maps) + 2 * len(landmarks)) == 7180


def test_the_simulated_set_is_consistent_with_its_truth(data: Callable[[str], Path]) -> None:
    folder = data("islsjf_535")
    maps = read_submaps(folder)
    beacons = scipy.io.loadmat(folder / "store_beaconsTrue.mat")["store_beaconsTrue"]
    places = {int(row[0]): row[1:] for row in beacons}
    errors, dof = 0.0, 0
    start = Pose.identity(2)
    for m in maps[:1]:  # the frame of the first map is the true start pose, which is the origin
        keys = m.values.layout.keys_of(Kind.POINT2)
        seen = np.asarray(m.values.of_kind(Kind.POINT2))
        difference = (seen - start.unact(np.array([places[int(k)] for k in keys]))).ravel()
        marginal = np.linalg.inv(m.information.toarray())[3:, 3:]
        errors += difference @ np.linalg.solve(marginal, difference)
        dof += len(difference)
    assert errors < 3.0 * dof


DAMAGE: dict[str, tuple[Array, Array, str]] = {
    "lopsided": (STATE, COVARIANCE + np.triu(np.ones((7, 7)), 1), "'localmap_P': the matrix is not symmetric"),
    "indefinite": (STATE, COVARIANCE - 9 * np.eye(7), "'localmap_P': the matrix is not positive definite"),
    "wrong size": (STATE, COVARIANCE[:6, :6], "'localmap_P': expected 7 columns, found 6"),
    "not square": (STATE, COVARIANCE[:6], "need a covariance"),
    "nan": (
        STATE,
        np.where(np.eye(7) > 0, np.nan, COVARIANCE),
        "'localmap_P': row 1 holds a number that is not finite",
    ),
    "columns": (np.column_stack([STATE, STATE]), COVARIANCE, "'localmap_st': expected 2 columns, found 4"),
    "no end pose": (STATE[3:], COVARIANCE[3:, 3:], "the first three rows should have id 0"),
    "pose in between": (STATE[[0, 1, 2, 3, 4, 0, 1]], COVARIANCE, "the first three rows should have id 0"),
    "half an id": (STATE + np.array([0.5, 0]), COVARIANCE, "'localmap_st': row 1: expected a whole number, found 0.5"),
    "feature twice": (STATE[[0, 1, 2, 3, 4, 3, 4]], COVARIANCE, "feature 12 has 4 rows, expected 2"),
    "half a feature": (STATE[:6], COVARIANCE[:6, :6], "feature 7 has 1 rows, expected 2"),
    "empty": (np.zeros((0, 2)), np.zeros((0, 0)), "empty"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_mat_files_are_named(name: str, tmp_path: Path) -> None:
    state, covariance, expected = DAMAGE[name]
    mat_map(tmp_path, 1, state, covariance)
    with pytest.raises(InputError, match=expected) as caught:
        read_submaps(tmp_path)
    assert "localmap_1.mat" in str(caught.value)


def test_a_gap_in_the_chain(tmp_path: Path) -> None:
    mat_map(tmp_path, 1, STATE, COVARIANCE)
    mat_map(tmp_path, 3, STATE, COVARIANCE)
    with pytest.raises(InputError, match=r"localmap_3\.mat: map 3 should start where map 2 ends"):
        read_submaps(tmp_path)


def test_no_map_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected files localmap_1\.mat"):
        read_submaps(tmp_path, "islsjf")
    with pytest.raises(InputError, match=r"expected files localmap_1\.txt"):
        read_submaps(tmp_path, "linear")


def test_a_file_without_the_matrices(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "localmap_1.mat", {"something": np.eye(2)})
    with pytest.raises(InputError, match="expected a matrix 'localmap_st', found something"):
        read_submaps(tmp_path)


@given(generators)
@settings(max_examples=30)
def test_nothing_but_maps_or_an_error_comes_out_of_mat_files(
    tmp_path_factory: pytest.TempPathFactory, rng: np.random.Generator
) -> None:
    # scipy's reader of .mat files is native code: rubbish is drawn here, not bit flips in sizes it would trust.
    folder = tmp_path_factory.mktemp("fuzz")
    path = mat_map(folder, 1, STATE, COVARIANCE)
    content = bytearray(path.read_bytes())
    cut = int(rng.integers(0, len(content)))
    path.write_bytes(bytes(content[:cut]) if rng.random() < 0.7 else rng.bytes(cut))
    try:
        found = localmaps_mat.read(folder)
    except TeamslamError:
        return
    assert all(isinstance(m, Submap) for m in found)


# --- Linear SLAM ------------------------------------------------------------------------------------------------------


def local_map(rng: np.random.Generator, dim: int, number: int) -> Submap:
    """A map of two poses and three features."""
    values = Values.of(
        {
            pose_kind(dim): (pose_key(1, np.array([number, 40 + number])), random_poses(rng, dim, 2, turn=1.3)),
            point_kind(dim): (landmark_key(rng.permutation(20)[:3] + 1), rng.normal(scale=5, size=(3, dim))),
        }
    )
    n = values.layout.dof
    information = sp.csr_array(spd(rng, n))
    base = int(pose_key(1, number - 1))
    return Submap(f"1/{number}", 1, base, dim, values, information, Sources(), Names(tick_s=1.0), rows=n)


@given(generators, dims)
@settings(max_examples=25)
def test_text_maps_read_back_the_same(
    tmp_path_factory: pytest.TempPathFactory, rng: np.random.Generator, dim: int
) -> None:
    folder = tmp_path_factory.mktemp("maps")
    maps = [local_map(rng, dim, number) for number in (1, 2)]
    losses = write_submaps(maps, folder, "linear")
    assert [d.count for d in losses] == [2] and "names" in losses[0].reason
    for found, expected in zip(read_submaps(folder), maps, strict=True):
        assert (found.id, found.base, found.base_dim) == (expected.id, expected.base, expected.base_dim)
        assert np.array_equal(found.values.layout.keys, expected.values.layout.keys)
        assert np.abs(found.values.minus(expected.values)).max() < 1e-9
        assert np.allclose(found.information.toarray(), expected.information.toarray(), rtol=1e-9, atol=1e-9)


@given(generators)
def test_angles_of_space_mean_what_they_say(tmp_path_factory: pytest.TempPathFactory, rng: np.random.Generator) -> None:
    """R = Rz(a) Ry(b) Rx(c), and the information is that of small changes of a, b, c."""
    folder = tmp_path_factory.mktemp("maps")
    angles = rng.uniform(-1.2, 1.2, 3)
    information = spd(rng, 6)
    rows = "\n".join(" ".join(map(repr, row)) for row in information.tolist())
    numbers = [*rng.normal(size=3).tolist(), *angles.tolist()]
    text = "0\n6\n" + "".join(f"-1 {x!r}\n" for x in numbers) + rows
    (folder / "localmap_1.txt").write_text(text)
    found = read_submaps(folder)[0]
    pose = found.values.pose(int(pose_key(1, 1)))
    assert np.allclose(pose.rotation, Rotation.from_euler("ZYX", angles).as_matrix())
    step = 1e-6 * rng.normal(size=6)
    moved = Pose(Rotation.from_euler("ZYX", angles + step[3:]).as_matrix(), pose.translation + step[:3])
    d = moved.minus(pose)
    assert d @ found.information @ d == pytest.approx(step @ information @ step, rel=1e-4)


def test_a_file_as_linear_slam_writes_it(tmp_path: Path) -> None:
    rows = "\n".join(" ".join(map(str, row)) for row in np.diag([4.0, 4, 9, 1, 1]).tolist())
    (tmp_path / "localmap_2.txt").write_text(f"1\n5\n-2   1.25\n-2   0.5\n-2   0.1\n101   3.0\n101  -2\n{rows}\n")
    (found,) = read_submaps(tmp_path)
    assert found.base == int(pose_key(1, 1)) and found.base_dim == 2
    assert found.values.layout.keys.tolist() == [int(pose_key(1, 2)), 101]
    assert np.allclose(found.information.diagonal(), [4, 4, 9, 1, 1])


PLAIN = "0\n5\n-1 1.25\n-1 0.5\n-1 0.1\n3 3.0\n3 -2\n4 1 0 0 0\n1 4 0 0 0\n0 0 9 0 0\n0 0 0 1 0\n0 0 0 0 1"
TEXT_DAMAGE = {
    "empty": ("", "too early"),
    "one line": ("0\n", "too early"),
    "n is wrong": (PLAIN.replace("5", "6", 1), "line 2: a map of n = 6 numbers needs 14 lines"),
    "n is huge": (PLAIN.replace("5", "999999999999", 1), "a map of n = 999999999999"),
    "n is negative": (PLAIN.replace("5", "-5", 1), "a map of n = -5"),
    "half a frame": (PLAIN.replace("0", "0.5", 1), "'frame': row 1: expected a whole number"),
    "cut off": (PLAIN[:-10], "needs 12 lines|expected 5 numbers"),
    "short row": (PLAIN.replace("0 0 9 0 0", "0 0 9 0"), "line 10, field 'information': expected 5 numbers, found 4"),
    "not a number": (PLAIN.replace("3 -2", "3 x"), "line 7, field 'id value': expected numbers, found '3 x'"),
    "nan": (PLAIN.replace("3 -2", "3 nan"), "line 7, field 'id value': expected finite numbers"),
    "lopsided": (PLAIN.replace("4 1 0", "4 3 0"), "'information': the matrix is not symmetric"),
    "indefinite": (PLAIN.replace("0 0 9", "0 0 -9"), "'information': the matrix is not positive definite"),
    "half a pose": (PLAIN.replace("-1 0.1", "4 0.1"), "pose 1 has 2 rows, expected 3"),
    "its own frame": (PLAIN.replace("0\n", "1\n", 1), "pose 1 is the frame of this map"),
    "feature twice": (PLAIN.replace("-1 1.25\n-1 0.5", "3 1\n3 2").replace("-1 0.1", "5 1"), "feature 5 has 1 rows"),
}


@pytest.mark.parametrize("name", TEXT_DAMAGE)
def test_damaged_text_files_are_named(name: str, tmp_path: Path) -> None:
    text, expected = TEXT_DAMAGE[name]
    (tmp_path / "localmap_1.txt").write_text(text)
    with pytest.raises(InputError, match=expected) as caught:
        read_submaps(tmp_path)
    assert "localmap_1.txt" in str(caught.value)


@given(damaged_text(PLAIN))
def test_nothing_but_maps_or_an_error_comes_out_of_text(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "localmap_1.txt").write_bytes(content)
    try:
        found = localmaps_text.read(folder)
    except TeamslamError:
        return
    assert all(isinstance(m, Submap) for m in found)


def test_what_the_text_cannot_say_is_refused(tmp_path: Path) -> None:
    good = local_map(np.random.default_rng(0), 2, 1)
    marks = np.asarray(good.values.of_kind(Kind.POINT2))
    poses = good.values.of_kind(Kind.POSE2)
    two_robots = Values.of({Kind.POSE2: (pose_key(np.array([1, 2]), 1), poses), Kind.POINT2: (np.arange(1, 4), marks)})
    zero = Values.of({Kind.POSE2: (pose_key(1, np.array([1, 2])), poses), Kind.POINT2: (np.arange(3), marks)})
    for bad, expected in [
        (replace(good, values=two_robots), "poses of several robots"),
        (replace(good, values=zero), "landmark 0"),
        (replace(good, base=WORLD), "a frame that is no robot's pose"),
        (replace(good, base_dim=3), "planar and spatial variables together"),
    ]:
        with pytest.raises(InputError, match=f"submap 1/1 holds {expected}"):
            write_submaps([bad], tmp_path, "linear")
