"""TUM trajectories: what is written reads back, evo reads it too, and damage is named."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given

from damage import damaged_text, survives
from strategies import dims, generators, random_poses
from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io.maps.tum import read_trajectory, write_trajectories, write_trajectory
from teamslam.model import Kind, Names, Values, landmark_key, pose_key

GOOD = "# stamp x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n1.5 2 2 3 0 0 0.6 0.8\n"


@given(generators, dims)
def test_what_is_written_reads_back(rng: np.random.Generator, dim: int) -> None:
    stamps = np.sort(rng.uniform(0, 2e9, 5))
    poses = random_poses(rng, dim, 5)
    with TemporaryDirectory() as folder:
        write_trajectory(Path(folder) / "a.tum", stamps, poses)
        found_stamps, found = read_trajectory(Path(folder) / "a.tum")
    assert np.array_equal(found_stamps, stamps)
    assert np.abs(found.minus(poses.lift(3))).max() < 1e-12


def test_evo_reads_the_same(tmp_path: Path) -> None:
    tools = pytest.importorskip("evo.tools.file_interface")
    poses = random_poses(np.random.default_rng(0), 3, 7)
    write_trajectory(tmp_path / "a.tum", np.arange(7.0), poses)
    theirs = tools.read_tum_trajectory_file(str(tmp_path / "a.tum"))
    assert np.allclose(theirs.positions_xyz, poses.translation)
    assert np.allclose([pose[:3, :3] for pose in theirs.poses_se3], poses.rotation)


def test_one_file_for_each_robot(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = Values.of(
        {
            Kind.POSE2: (pose_key(np.array([1, 1, 3]), np.array([2_000_000, 1_000_000, 5])), random_poses(rng, 2, 3)),
            Kind.POINT2: (landmark_key(np.arange(2)), rng.normal(size=(2, 2))),
        }
    )
    files = write_trajectories(values, Names({1: "Ada/Lovelace"}), tmp_path)
    assert [f.name for f in files] == ["Ada_Lovelace.tum", "3.tum"]
    stamps, poses = read_trajectory(files[0])
    assert stamps.tolist() == [1.0, 2.0]
    assert np.allclose(poses.xytheta()[0], values.pose(int(pose_key(1, 1_000_000))).xytheta())


DAMAGE = {
    "empty": ("", "no pose"),
    "comments alone": ("# nothing\n", "no pose"),
    "short line": ("0 1 2 3 0 0 0\n", "line 1: expected 8 columns"),
    "long line": ("0 1 2 3 0 0 0 1 9\n", "line 1: expected 8 columns"),
    "not a number": (GOOD.replace("2 2 3", "2 y 3"), "line 3, field 'y'"),
    "nan": (GOOD.replace("2 2 3", "2 nan 3"), "line 3, field 'y'"),
    "time back": (GOOD.replace("1.5", "0.4"), "line 3, field 'stamp': time steps back"),
    "same time": (GOOD.replace("1.5", "0.5"), "line 3, field 'stamp': time steps back or stands still"),
    "zero quaternion": (GOOD.replace("0.6 0.8", "0 0"), "line 3: a quaternion has length 1, found 0"),
    "long quaternion": (GOOD.replace("0.6 0.8", "6 8"), "line 3: a quaternion has length 1, found 10"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    text, expected = DAMAGE[name]
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(InputError, match=expected):
        read_trajectory(tmp_path / "a.tum")


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_trajectory(tmp_path / "a.tum")


@given(damaged_text(GOOD))
def test_nothing_but_a_trajectory_or_an_error_comes_out(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    found = survives(read_trajectory, tmp_path_factory.mktemp("fuzz") / "a.tum", content)
    assert found is None or isinstance(found[1], Pose)
