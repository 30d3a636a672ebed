"""g2o graphs: values against GTSAM's reader, teams in several files, landmarks, sensors, and every kind of damage."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import damaged_text, survives
from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io import read, write
from teamslam.io.graphs import g2o
from teamslam.io.graphs.symbols import join_symbol
from teamslam.model import Dataset, Kind, landmark_key, pack, pose_key, unpack

I3, I6 = "1 0 0 1 0 1", "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
PLANE = f"""VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0.5
VERTEX_SE2 7 2 0.5 1
VERTEX_XY 20 3 3
EDGE_SE2 0 1 1 0 0.5 {I3}
EDGE_SE2 1 7 1 0 0.5 2 0.1 0 3 0 4
EDGE_SE2_XY 0 20 3 3 1 0 2
EDGE_BEARING_SE2_XY 1 20 0.3 100
EDGE_PRIOR_SE2 0 0 0 0 {I3}
"""


def written(folder: Path, text: str, name: str = "graph.g2o") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_what_stands_in_a_planar_graph(tmp_path: Path) -> None:
    found = read(written(tmp_path, PLANE))
    assert found.robots == {1: 2}
    assert [(t.source, t.model, len(t)) for t in found.tables] == [
        ("odometry", "relative_pose", 2),  # 1 -> 7 too: ids may have gaps
        ("landmarks", "point", 1),
        ("landmarks", "bearing", 1),
        ("world", "pose", 1),
    ]
    assert found.tables[0].keys.tolist() == pose_key(1, np.array([[0, 1], [1, 7]])).tolist()
    assert found.tables[1].keys.tolist() == [[int(pose_key(1, 0)), int(landmark_key(20))]]
    assert [t.ids.tolist() for t in found.tables] == [[0, 1], [0], [1], [0]]
    assert found.initial is not None
    assert np.allclose(found.initial.pose(int(pose_key(1, 7))).xytheta(), [2, 0.5, 1])
    assert found.dropped == () and found.notes == ()
    w = found.tables[0].whitening[1]
    turn = Pose.from_xytheta(np.array([0, 0, 0.5])).rotation
    expected = turn @ np.array([[2, 0.1], [0.1, 3]]) @ turn.T  # of the translation, turned
    assert np.allclose((w.T @ w)[:2, :2], expected)


@pytest.mark.parametrize(
    "name", ["pose3example-grid.txt", "pose3example-offdiagonal.txt", "pose2example.txt", "noisyToyGraph.txt"]
)
def test_values_agree_with_gtsam(name: str, tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    file = gtsam.findExampleDataFile(name)
    spatial = "3" in name
    graph, values = gtsam.readG2o(file, spatial)
    found = read(file, format="g2o", chart="gtsam")
    assert sum(len(t) for t in found.tables) == graph.size()
    assert found.initial is not None and len(found.initial) == values.size()
    factors = {tuple(graph.at(k).keys()): graph.at(k) for k in range(graph.size())}
    rng = np.random.default_rng(0)
    for table in found.tables:
        for row, (keys, value) in enumerate(zip(table.keys, table.values, strict=True)):
            factor = factors[tuple(int(key & ((1 << 51) - 1)) for key in keys)]
            z = unpack(value, Kind(table.dim - 2))
            assert isinstance(z, Pose)
            measured = factor.measured()
            theirs = measured.matrix()
            assert np.allclose(z.rotation, theirs[: table.dim, : table.dim], atol=1e-7)
            assert np.allclose(z.translation, theirs[: table.dim, -1], atol=1e-9)
            # Near the measurement GTSAM's cost (which has a factor 1/2) is teamslam's, to first order.
            h = z.retract(1e-5 * rng.normal(size=z.dof))
            at = gtsam.Values()
            at.insert(factor.keys()[0], gtsam.Pose3() if spatial else gtsam.Pose2())
            there = h.lift(3)
            at.insert(
                factor.keys()[1],
                gtsam.Pose3(gtsam.Rot3(there.rotation), there.translation) if spatial else gtsam.Pose2(*h.xytheta()),
            )
            e = table.whitening[row] @ table.row.minus(value[None], pack(h)[None], table.dim)[0]
            assert e @ e == pytest.approx(2.0 * factor.error(at), rel=1e-3)


def test_estimates_agree_with_gtsam() -> None:
    gtsam = pytest.importorskip("gtsam")
    file = gtsam.findExampleDataFile("pose3example-grid.txt")
    _, values = gtsam.readG2o(file, True)
    found = read(file, format="g2o").initial
    assert found is not None
    for key in values.keys():  # noqa: SIM118  GTSAM's, not a dict
        pose = found.pose(int(pose_key(1, key)))
        assert np.allclose(pose.rotation, values.atPose3(key).rotation().matrix(), atol=1e-7)
        assert np.allclose(pose.translation, values.atPose3(key).translation())


def test_landmarks_of_space_share_ids_with_poses() -> None:
    gtsam = pytest.importorskip("gtsam")
    found = read(gtsam.findExampleDataFile("known_landmark_localization_20.g2o"))
    assert {(t.source, t.model): len(t) for t in found.tables} == {
        ("landmarks", "point"): 80,
        ("odometry", "relative_pose"): 19,
    }
    assert found.initial is not None
    # The file was made by a solver: at its vertices the points are where they were seen, to a few sigmas.
    points = next(t for t in found.tables if t.model == "point")
    assert np.abs(points.residual(found.initial)).max() < 1.0


def test_a_team_in_four_files(data: Callable[[str], Path]) -> None:
    folder = data("distributed_mapper_4robots")
    files = sorted(folder.glob("*.g2o"))
    found = read(folder)
    edges = [line.split() for file in files for line in file.read_text().splitlines() if line.startswith("EDGE")]
    once = {tuple(words) for words in edges}
    assert len(edges) == 176 and sum(len(t) for t in found.tables) == len(once) == 144
    assert [(d.count, d.reason.split(":")[0]) for d in found.dropped] == [
        (32, "edges that stand in the files of both their robots, or twice")
    ]
    assert found.names.robots == {1: "a", 2: "b", 3: "c", 4: "d"}
    assert {robot: len(keys) for robot, keys in found.pose_keys.items()} == {1: 16, 2: 16, 3: 16, 4: 16}
    between = [t for t in found.tables if t.observes_robots]
    assert sum(len(t) for t in between) == 32
    # The observer is the edge's first vertex.
    firsts = [int(words[1]) >> 56 for words in once if int(words[1]) >> 56 != int(words[2]) >> 56]
    assert sorted(firsts) == sorted(chr(96 + t.robot).encode()[0] for t in between for _ in range(len(t)))
    assert found.initial is not None and len(found.initial) == 64


def test_plain_ids_in_several_files_are_those_of_each_robot(tmp_path: Path) -> None:
    for name in ("left", "right"):
        written(tmp_path, f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {I3}\n", f"{name}.g2o")
    found = read(tmp_path)
    assert found.robots == {1: 2, 2: 2} and found.names.robots == {1: "left", 2: "right"}
    assert [t.robot for t in found.tables] == [1, 2]


def test_sensors_off_the_body(tmp_path: Path) -> None:
    text = f"""PARAMS_SE3OFFSET 4 0.5 0 1 0 0 0 1
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1
VERTEX_TRACKXYZ 9 2 0 1
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {I6}
EDGE_SE3_TRACKXYZ 0 9 4 1.5 0 0 {I3}
"""
    found = read(written(tmp_path, text))
    points = found.tables[1]
    assert points.sensor is not None and points.sensor.translation.tolist() == [0.5, 0, 1]
    assert found.initial is not None and np.abs(points.residual(found.initial)).max() < 1e-12


def test_a_file_without_vertices_has_no_estimate(tmp_path: Path) -> None:
    found = read(written(tmp_path, f"EDGE_SE2 0 1 1 0 0 {I3}\nEDGE_SE2_XY 1 5 1 0 1 0 1\n"))
    assert found.initial is None and found.layout.dof == 8


def test_one_file_of_a_team_keeps_its_sightings_of_others(tmp_path: Path) -> None:
    a, b = (join_symbol(letter, 3) for letter in "ab")
    text = f"VERTEX_SE2 {a} 0 0 0\nEDGE_SE2 {a} {b} 1 0 0 {I3}\n"
    found = read(written(tmp_path, text))
    assert found.robots == {1: 2, 2: 2} and found.tables[0].source == "robots"


def test_what_g2o_cannot_say_is_refused(tmp_path: Path) -> None:
    found = read(written(tmp_path, PLANE))
    ranges = found.tables[2]
    blank = type(ranges)(1, "landmarks", "range", 2, ranges.keys, ranges.values + 1.0, ranges.whitening, ranges.ids)
    with pytest.raises(InputError, match=r"no word for landmarks \(range, 2D, POSE2 to POINT2\)"):
        write(found.with_tables([*found.tables, blank]), tmp_path / "out.g2o")


def test_what_is_lost_is_said(tmp_path: Path) -> None:
    found = read(written(tmp_path, PLANE))
    with_truth = Dataset(found.robots, found.tables, found.names, truth=found.initial)
    losses = write(with_truth, tmp_path / "out.g2o")
    assert [(d.count, d.reason.split(":")[0]) for d in losses] == [
        (4, "variables without an estimate"),
        (4, "true values"),
    ]
    assert read(tmp_path / "out.g2o").initial is None


DAMAGE = {
    "empty": ("", "empty"),
    "no edge": ("VERTEX_SE2 0 0 0 0\n", "no line is a measurement"),
    "unknown tags alone": ("EDGE_CAM 0 1\n", r"no line is a measurement .*; found lines with the unknown tag EDGE_CAM"),
    "not a number": (
        PLANE.replace("1 0 0.5 1 0 0", "1 x 0.5 1 0 0", 1),
        r"line 5, field 'y': expected a number, found 'x'",
    ),
    "nan": (PLANE.replace("VERTEX_XY 20 3 3", "VERTEX_XY 20 nan 3"), r"line 4, field 'x': expected a finite number"),
    "infinite": (PLANE.replace("VERTEX_XY 20 3 3", "VERTEX_XY 20 3 inf"), r"line 4, field 'y': expected a finite"),
    "cut line": (PLANE.replace("2 0.1 0 3 0 4", "2 0.1"), r"line 6: EDGE_SE2 needs 11 words after the tag, found 7"),
    "long line": (PLANE.replace("VERTEX_SE2 1 1", "VERTEX_SE2 1 1 1"), r"line 2: VERTEX_SE2 needs 4 words"),
    "indefinite information": (
        PLANE.replace("2 0.1 0 3 0 4", "2 9 0 3 0 4"),
        r"line 6: information has a negative eigenvalue",
    ),
    "negative information": (
        PLANE.replace("2 0.1 0 3 0 4", "2 0 0 3 0 -1e-9"),
        r"line 6: information has a negative eigenvalue",
    ),
    "unknown vertex": (PLANE.replace("EDGE_SE2 1 7", "EDGE_SE2 1 8"), r"line 6, field 'id': vertex 8 is not defined"),
    "wrong kind": (PLANE.replace("EDGE_SE2_XY 0 20", "EDGE_SE2_XY 0 1"), r"vertex 1 is a POSE2, expected a POINT2"),
    "to itself": (PLANE.replace("EDGE_SE2 1 7", "EDGE_SE2 7 7"), "from vertex 7 to itself"),
    "id no number": (PLANE.replace("VERTEX_SE2 7", "VERTEX_SE2 b7"), r"line 3, field 'id': expected a whole number"),
    "id too large": (PLANE.replace("VERTEX_SE2 7", "VERTEX_SE2 99999999999999999999"), "from 0 to 2"),
    "negative id": (PLANE.replace("VERTEX_SE2 7", "VERTEX_SE2 -7"), "a whole number from 0 to 2"),
    "id beyond an index": (PLANE.replace("VERTEX_SE2 7", f"VERTEX_SE2 {1 << 52}"), "ids run from 0 to 2"),
    "letter of no robot": (
        f"EDGE_SE2 {join_symbol('a', 1)} {join_symbol('7', 1)} 1 0 0 {I3}\n",
        "the letter '7' of a pose's id",
    ),
    "letters and plain numbers": (
        f"{PLANE}VERTEX_SE2 {join_symbol('a', 1)} 0 0 0\n",
        "line 1, field 'id': pose 0 has a plain number where other poses have their robot's letter",
    ),
    "unknown parameter": (f"EDGE_SE3_TRACKXYZ 0 1 0 1 0 0 {I3}\n", "parameter 0 is not defined"),
    "quaternion of zero": ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n", "a quaternion has length 1"),
    "plane and space": (
        f"EDGE_SE2 0 1 0 0 0 {I3}\nEDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 {I6}\n",
        "in the plane and in space",
    ),
    "damaged note": ("# teamslam {]\n" + PLANE, "line 1: teamslam's note of names is damaged"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    text, expected = DAMAGE[name]
    with pytest.raises(InputError, match=expected) as caught:
        read(written(tmp_path, text))
    assert "graph.g2o" in str(caught.value)


def test_binary_rubbish(tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="text"):
        read(tmp_path / "graph.g2o")


def test_unknown_tags_are_counted(tmp_path: Path) -> None:
    found = read(written(tmp_path, PLANE + "EDGE_CAMERA 1 2\nEDGE_CAMERA 2 3\n"))
    assert (found.dropped[-1].count, found.dropped[-1].reason) == (2, "lines with the unknown tag EDGE_CAMERA")


SPACE = f"""PARAMS_SE3OFFSET 0 0.1 0 0 0 0 0 1
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0.6 0.8
VERTEX_TRACKXYZ 2 1 2 3
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0.6 0.8 {I6}
EDGE_SE3_TRACKXYZ 0 2 0 1 2 3 {I3}"""


@given(st.sampled_from([PLANE, SPACE]).flatmap(damaged_text))
def test_nothing_but_a_log_or_an_error_comes_out(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "graph.g2o"
    found = survives(g2o.read, path, content)
    assert found is None or isinstance(found, Dataset)


@pytest.mark.parametrize("text", [PLANE, SPACE.replace("PARAMS_SE3OFFSET 0 0.1", "PARAMS_SE3OFFSET 0 0")])
def test_gtsam_reads_what_is_written(text: str, tmp_path: Path) -> None:
    """GTSAM's reader of the plane finds no edge below a line that it does not know: names come last."""
    gtsam = pytest.importorskip("gtsam")
    found = read(written(tmp_path, text))
    write(found, tmp_path / "out.g2o")
    graph, _ = gtsam.readG2o(str(tmp_path / "out.g2o"), text is not PLANE)
    relative = sum(len(t) for t in found.tables if t.model == "relative_pose")
    assert sum("BetweenFactor" in type(graph.at(k)).__name__ for k in range(graph.size())) == relative


SQUARE = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(3)) + "".join(
    f"EDGE_SE2 {a} {b} 1 0 0 {I3}\n" for a, b in ((0, 1), (1, 2), (2, 0))
)


@pytest.mark.parametrize("lines", ["FIX 0\n", "FIX 0\nFIX 0\n"])
def test_one_held_vertex_only_chooses_the_frame(lines: str, tmp_path: Path) -> None:
    found = read(written(tmp_path, SQUARE + lines))
    assert [(d.count, d.reason.split(":")[0]) for d in found.dropped] == [(1, "vertices held by FIX lines")]


def test_each_robots_file_may_hold_its_own_first_vertex(tmp_path: Path) -> None:
    for name in ("a", "b"):
        written(tmp_path, SQUARE + "FIX 0\n", f"{name}.g2o")
    assert [d.count for d in read(tmp_path).dropped] == [2]


@pytest.mark.parametrize("lines", ["FIX 0\nFIX 2\n", "FIX 0 2\n", f"EDGE_PRIOR_SE2 1 1 0 0 {I3}\nFIX 0\n"])
def test_held_vertices_that_are_more_than_a_frame_are_refused(lines: str, tmp_path: Path) -> None:
    """Leaving them free would answer another question."""
    with pytest.raises(InputError, match="vertices that are held are more than a choice of the frame"):
        read(written(tmp_path, SQUARE + lines))
