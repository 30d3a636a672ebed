"""TORO's and iSAM's graphs: what GTSAM ships against GTSAM's reader; noise against each program's own definition."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from damage import damaged_text, survives
from strategies import generators
from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io import read
from teamslam.io.graphs import toro
from teamslam.model import MODELS, Dataset, Table, index_of, landmark_key, pack, pose_key
from teamslam.model.sensors import pose_of


def written(folder: Path, text: str, name: str = "graph.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def shipped(name: str) -> tuple[Any, str]:
    gtsam = pytest.importorskip("gtsam")
    return gtsam, gtsam.findExampleDataFile(name)


def factors_of(graph: Any) -> dict[tuple[int, int], list[Any]]:
    """GTSAM's factors by their keys; landmarks' letters are cut off."""
    found: dict[tuple[int, int], list[Any]] = {}
    for k in range(graph.size()):
        a, b = (key & ((1 << 56) - 1) for key in list(graph.at(k).keys()))
        found.setdefault((a, b), []).append(graph.at(k))
    return found


# --- what GTSAM ships -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("w100.graph", 300),
        ("example.graph", 516),
        ("w100_30.g2o", 59),
        ("victoria_park.txt", 10608),
        ("w20000.txt", 26831),
    ],
)
def test_planes_agree_with_gtsam(name: str, rows: int) -> None:
    """Measurements to the bit; their noise too, but for what GTSAM replaces (LANDMARK) or misreads (iSAM's R)."""
    gtsam, path = shipped(name)
    graph, _ = gtsam.load2D(path)
    found = read(path)
    assert sum(len(t) for t in found.tables) == graph.size() == rows
    factors = factors_of(graph)
    for table in found.tables:
        for keys, value, whitening in zip(table.keys[:200], table.values, table.whitening, strict=False):
            factor = factors[tuple(index_of(keys).tolist())].pop(0)  # type: ignore[index]
            measured = factor.measured()
            if table.model == "relative_pose":
                assert np.allclose(
                    pose_of(value, 2).xytheta(), [measured.x(), measured.y(), measured.theta()], atol=1e-12
                )
                information = factor.noiseModel().information()
                if name == "w20000.txt":  # GTSAM takes iSAM's square roots for covariances
                    information = np.linalg.inv(information) @ np.linalg.inv(information)
                assert np.allclose(whitening.T @ whitening, information, rtol=1e-9)
            else:
                polar = value if table.model == "range_bearing" else [np.hypot(*value), np.arctan2(*value[::-1])]
                assert polar[0] == pytest.approx(measured.range(), abs=1e-9)
                assert np.cos(polar[1] - measured.bearing().theta()) == pytest.approx(1.0, abs=1e-12)
                if table.model == "range_bearing":
                    assert np.allclose(1.0 / np.diag(whitening)[::-1], factor.noiseModel().sigmas())


def test_what_gtsams_files_mean_is_said() -> None:
    _, path = shipped("victoria_park.txt")
    found = read(path)
    assert found.notes == (
        "noise is read as covariances: as iSAM's square roots of information, headings would be uncertain by more than "
        "half a turn",
    )
    assert read(shipped("w20000.txt")[1]).notes == (
        "noise is read as square roots of information, as iSAM's graphs have it",
    )
    small = read(shipped("w100.graph")[1])
    assert small.notes == () and [d.count for d in small.dropped] == [40]  # unit matrices; EQUIV lines
    assert small.initial is not None and len(small.initial) == 100
    assert {t.source for t in small.tables} == {"odometry", "loops"}  # though each edge goes back in time


def test_space_agrees_with_gtsam() -> None:
    """GTSAM stops reading after the first edge without noise; its vertices are whole."""
    gtsam, path = shipped("sphere_smallnoise.graph")
    graph, values = gtsam.load3D(path)
    found = read(path)
    assert sum(len(t) for t in found.tables) == 8647
    assert found.notes == ("8647 measurements state no noise: 1 m and 1 rad are taken",)
    measured, z = graph.at(0).measured(), pose_of(found.tables[0].values[:1], 3)
    assert np.allclose(z.rotation[0], measured.rotation().matrix(), atol=1e-12)
    assert np.allclose(z.translation[0], measured.translation(), atol=1e-12)
    assert found.initial is not None and len(found.initial) == values.size() == 2200
    for key in values.keys():  # noqa: SIM118  GTSAM's, not a dict
        pose = found.initial.pose(int(pose_key(1, key)))
        assert np.allclose(pose.rotation, values.atPose3(key).rotation().matrix(), atol=1e-12)
        assert np.allclose(pose.translation, values.atPose3(key).translation(), atol=1e-12)


def test_edges_of_space_agree_with_gtsam() -> None:
    gtsam, path = shipped("sphere2500.txt")
    graph, _ = gtsam.load3D(path)
    factors = factors_of(graph)
    for table in read(path).tables:
        for keys, value in zip(table.keys[:500], table.values, strict=False):
            measured = factors[tuple(index_of(keys).tolist())].pop(0).measured()  # type: ignore[index]
            z = pose_of(value, 3)
            assert np.allclose(z.rotation, measured.rotation().matrix(), atol=1e-12)
            assert np.allclose(z.translation, measured.translation(), atol=1e-12)


def test_the_sphere_is_isams() -> None:
    """Square roots 10 [1/m] and 100, 100, 25 [1/rad] of roll, pitch and yaw; GTSAM takes them for information of the
    rotation first."""
    found = read(shipped("sphere2500.txt")[1])
    step = found.tables[0]
    information = step.whitening[0].T @ step.whitening[0]
    assert np.allclose(np.diag(information), [100, 100, 100, 10_000, 10_000, 625], rtol=0.01)  # nearly upright


# --- what the numbers mean --------------------------------------------------------------------------------------------


def first(path: Path, **options: object) -> tuple[Table, np.ndarray]:
    table = read(path, **options).tables[0]
    return table, table.whitening[0].T @ table.whitening[0]


FULL = np.array([[4.0, 0.3, 0.2], [0.3, 5.0, 0.1], [0.2, 0.1, 6.0]])


def test_toros_order(tmp_path: Path) -> None:
    noise = "4 0.3 5 6 0.2 0.1"  # I11 I12 I22 I33 I13 I23
    text = f"VERTEX2 0 0 0 0\nVERTEX2 1 1 0 1\nEDGE2 0 1 1 0 1 {noise}\n"
    assert np.allclose(first(written(tmp_path, text))[1], FULL)


def test_isams_square_roots_and_what_they_may_be_told_to_be(tmp_path: Path) -> None:
    upper = np.linalg.cholesky(FULL).T  # FULL = R'R
    numbers = " ".join(map(repr, upper[np.triu_indices(3)].tolist()))
    path = written(tmp_path, f"ODOMETRY 0 1 1 0 1 {numbers}\n")
    assert np.allclose(first(path)[1], FULL)
    path = written(tmp_path, "ODOMETRY 0 1 1 0 1 4 0.3 0.2 5 0.1 6\n")
    assert np.allclose(first(path, noise="information")[1], FULL)
    assert np.allclose(first(path, noise="covariance")[1], np.linalg.inv(FULL))
    with pytest.raises(InputError, match="expected one of information, square_root, covariance, found 'cov'"):
        read(path, noise="cov")


@given(generators)
def test_the_angles_of_space_to_first_order(tmp_path_factory: pytest.TempPathFactory, rng: np.random.Generator) -> None:
    """iSAM's cost: the square roots times the difference in x y z roll pitch yaw."""
    rpy = rng.uniform([-3, -1.3, -3], [3, 1.3, 3])
    upper = np.triu(rng.normal(size=(6, 6))) + 3 * np.eye(6)
    z = np.concatenate([rng.normal(size=3), rpy])
    numbers = " ".join(map(repr, [*z.tolist(), *upper[np.triu_indices(6)].tolist()]))
    path = written(tmp_path_factory.mktemp("isam"), f"EDGE3 0 1 {numbers}\n")
    table = read(path).tables[0]
    for _ in range(3):
        h = z + 1e-6 * rng.normal(size=6)
        pose = Pose(Rotation.from_euler("ZYX", h[:2:-1]).as_matrix(), h[:3])
        mine = table.whitening[0] @ MODELS["relative_pose"].minus(table.values, pack(pose)[None], 3)[0]
        assert np.linalg.norm(mine) == pytest.approx(np.linalg.norm(upper @ (z - h)), rel=1e-4)


def test_isams_points_and_landmarks(tmp_path: Path) -> None:
    found = read(written(tmp_path, "ODOMETRY 0 1 1 0 0 2 0 0 2 0 2\nLANDMARK 1 1 3 4 2 0.5 1\n"))
    points = found.tables[1]
    assert points.keys.tolist() == [[int(pose_key(1, 1)), int(landmark_key(1))]]  # numbered for themselves
    assert np.allclose(points.whitening[0], [[2, 0.5], [0, 1]])
    text = "POSE3D_INIT 0 0 0 0 0 0 0\nPOSE3D_TRUE 0 1 2 3 0 0 0.5\n"
    text += "POINT3 0 7 1 2 3\nPOINT3 0 8 1 2 3 2 0 0 2 0 2\nSOLVE\n"
    found = read(written(tmp_path, text))
    assert found.truth is not None and found.truth.pose(int(pose_key(1, 0))).translation.tolist() == [1, 2, 3]
    assert sorted(np.diag(w)[0] for w in found.tables[0].whitening) == [1, 2]
    assert "1 measurements state no noise: 1 m and 1 rad are taken" in found.notes
    assert [(d.count, d.reason) for d in found.dropped] == [(1, "lines with the unknown tag SOLVE")]


def test_words_of_g2o_may_stand_among_them(tmp_path: Path) -> None:
    text = "VERTEX_SE2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 2 0 2 2 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    for name in ("graph.g2o", "graph.txt"):
        assert sum(len(t) for t in read(written(tmp_path, text, name)).tables) == 2


@pytest.mark.parametrize("name", ["graph.graph", "graph.txt", "graph.log", "graph"])
def test_a_file_is_told_by_its_first_word(name: str, tmp_path: Path) -> None:
    text = "# made by hand\r\n\r\nEDGE2 0 1 1 0 0 2 0 0 2 0 2  # the first step\r\n"
    assert read(written(tmp_path, text, name)).robots == {1: 2}


def test_one_file_for_each_robot(tmp_path: Path) -> None:
    for name in ("a", "b"):
        written(tmp_path, "EDGE2 0 1 1 0 0 2 0 0 2 0 2\nEDGE2 1 2 1 0 0 2 0 0 2 0 2\n", f"{name}.graph")
    assert read(tmp_path).names.robots == {1: "a", 2: "b"}


DAMAGE = {
    "short": (
        "EDGE2 0 1 1 0 0 1 0 0 1 0\n",
        r"line 1: EDGE2 needs 5 or 11 words .* found 10; write 'EDGE2 id id x y theta",
    ),
    "several hypotheses": ("EDGE2 0 1 1 0 1 0.97 -0.01 0.02\n", "EDGE2 needs 5 or 11 words"),
    "no number": ("EDGE2 0 1 1 0 x 1 0 0 1 0 1\n", "line 1, field 'theta': expected a number, found 'x'"),
    "decimal comma": ("EDGE2 0 1 1,5 0 0 1 0 0 1 0 1\n", "decimal commas are not read"),
    "negative": ("VERTEX2 0 0 0 0\nEDGE2 0 0 1 0 0 2 0 2 2 0 0\n", "line 2: the edge goes from vertex 0 to itself"),
    "covariance that is none": (
        "EDGE2 0 1 1 0 0 1e-4 1 0 1e-4 0 1e-4\n",
        "line 1: covariance is not positive definite",
    ),
    "sigma of zero": ("BR 0 1 0.1 2 0 0.1\n", "line 1, field 'sigma': a standard deviation is above zero"),
    "negative range": ("BR 0 1 0.1 -2 0.1 0.1\n", "line 1, field 'range': a range is not negative, found -2"),
    "upright": (
        "EDGE3 0 1 0 0 0 0 1.5707963267948966 0" + " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n",
        "pitch of 90",
    ),
    "no measurement": ("VERTEX2 0 0 0 0\n", "no line is a measurement"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    text, expected = DAMAGE[name]
    with pytest.raises(InputError, match=expected):
        read(written(tmp_path, text))


GOOD = """VERTEX2 0 0 0 0
VERTEX2 1 1 0 0
EDGE2 0 1 1 0 0 2 0 2 2 0 0
BR 1 3 0.1 2 0.1 0.1
LANDMARK 1 4 1 1 2 0 2
EDGE3 5 6 1 0 0 0 0 1
"""


@given(st.sampled_from([GOOD, "ODOMETRY 0 1 1 0 0 2 0 0 2 0 2\n"]).flatmap(damaged_text))
def test_nothing_but_a_log_or_an_error_comes_out(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    found = survives(toro.read, tmp_path_factory.mktemp("fuzz") / "graph.txt", content)
    assert found is None or isinstance(found, Dataset)
