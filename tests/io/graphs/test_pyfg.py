"""PyFG factor graphs: a real team's log, stamps and counts, and every kind of damage."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from damage import damaged_text, survives
from teamslam.errors import InputError
from teamslam.io import read, write
from teamslam.io.graphs import pyfg
from teamslam.model import Dataset, Table, landmark_key, pose_key

GRAPH = """VERTEX_SE2 10.0 A0 0 0 0
VERTEX_SE2 10.5 A1 1 0 0.5
VERTEX_SE2 10.2 B4 3 0 0
VERTEX_XY L6 2 2
EDGE_SE2 10.5 A0 A1 1 0 0.5 0.04 0 0 0.04 0 0.01
EDGE_SE2_XY 10.0 A0 L6 2 2 0.25 0.1 0.25
EDGE_RANGE 10.2 A1 B4 2.2 0.01
EDGE_RANGE 10.2 L6 B4 2.5 0.04
VERTEX_SE2:PRIOR 10.0 A0 0 0 0 1 0 0 1 0 1
VERTEX_XY:PRIOR 10.0 L6 2 2 1 0 1
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "graph.pyfg"
    path.write_text(text)
    return path


def test_what_stands_in_a_graph(tmp_path: Path) -> None:
    found = read(written(tmp_path, GRAPH))
    assert found.robots == {1: 2, 2: 2} and found.names.robots == {1: "A", 2: "B"}
    assert found.names.tick_s == 1e-6
    a0, a1, b4 = (int(k) for k in pose_key(np.array([1, 1, 2]), np.array([10_000_000, 10_500_000, 10_200_000])))
    rows = [(t.robot, t.source, t.model, t.keys.tolist()) for t in found.tables]
    assert rows == [
        (1, "odometry", "relative_pose", [[a0, a1]]),
        (1, "landmarks", "point", [[a0, 6]]),
        (1, "robots", "range", [[a1, b4]]),
        (2, "landmarks", "range", [[b4, 6]]),  # a range has no direction: the robot is the observer
        (1, "world", "pose", [[a0]]),
        (1, "world", "position", [[int(landmark_key(6))]]),
    ]
    assert found.truth is not None and found.initial is None
    assert np.allclose(found.truth.pose(a1).xytheta(), [1, 0, 0.5])
    w = found.tables[1].whitening[0]
    assert np.allclose(np.linalg.inv(w.T @ w), [[0.25, 0.1], [0.1, 0.25]])


def test_stamps_may_be_left_aside(tmp_path: Path) -> None:
    found = read(written(tmp_path, GRAPH), stamps=False)
    assert found.names.tick_s == 1.0 and not found.dropped
    assert found.tables[0].keys.tolist() == [pose_key(1, np.array([0, 1])).tolist()]


@pytest.mark.parametrize("text", [GRAPH.replace("10.5 A1", "9.5 A1"), GRAPH.replace("VERTEX_SE2 10.2 B4 3 0 0\n", "")])
def test_stamps_that_cannot_name_poses_are_dropped_and_counted(tmp_path: Path, text: str) -> None:
    found = read(written(tmp_path, text))
    assert found.names.tick_s == 1.0
    assert [(d.count, d.reason.split(":")[0]) for d in found.dropped] == [(3, "stamps of poses")]


def test_a_real_team(data: Callable[[str], Path]) -> None:
    path = data("mrclam5a.pyfg")
    found = read(path)
    tags = [line.split()[0] for line in path.read_text().splitlines()]
    sizes: dict[str, int] = {}
    for table in found.tables:
        sizes[table.model] = sizes.get(table.model, 0) + len(table)
    assert sizes == {"relative_pose": tags.count("EDGE_SE2"), "point": 1127, "range": 316}
    assert found.names.robots == dict(zip(range(1, 6), "ABCDE", strict=True))
    assert sum(map(len, found.pose_keys.values())) == tags.count("VERTEX_SE2") == 1080
    assert len(found.landmark_keys) == 15 and not found.dropped
    assert found.truth is not None and len(found.truth) == 1095
    # Sightings agree with the truth to within the flat noise that the file states.
    for table in found.tables:
        if table.model == "point":
            assert np.sqrt(np.mean(table.whitened(found.truth) ** 2)) < 1.0


def test_gtsams_own_pyfg() -> None:
    gtsam = pytest.importorskip("gtsam")
    found = read(gtsam.findExampleDataFile("goats_16.pyfg"))
    assert {(t.source, t.model): len(t) for t in found.tables} == {
        ("odometry", "relative_pose"): 200,
        ("landmarks", "range"): 572,
    }


def test_what_pyfg_cannot_say_is_refused(tmp_path: Path) -> None:
    found = read(written(tmp_path, GRAPH))
    keys, whitening = found.tables[1].keys, np.eye(1)[None]
    bearing = Table(1, "landmarks", "bearing", 2, keys, np.zeros((1, 1)), whitening, np.array([9]))
    with pytest.raises(InputError, match=r"no word for landmarks \(bearing, 2D, POSE2 to POINT2\)"):
        write(found.with_tables([bearing]), tmp_path / "out.pyfg")


def test_what_is_lost_is_said(tmp_path: Path) -> None:
    found = read(written(tmp_path, GRAPH))
    without_truth = Dataset(found.robots, found.tables, found.names, initial=found.truth)
    losses = write(without_truth, tmp_path / "out.pyfg")
    assert [(d.count, d.reason.split(":")[0]) for d in losses] == [
        (3, "stamps of poses without a true value"),
        (4, "estimates"),
    ]


DAMAGE = {
    "empty": (" \n", "empty"),
    "vertices alone": ("VERTEX_XY L6 2 2\n", "no line is a measurement"),
    "not a number": (GRAPH.replace("B4 2.2", "B4 far"), "line 7, field 'range': expected a number, found 'far'"),
    "nan": (GRAPH.replace("B4 2.2", "B4 nan"), "line 7, field 'range': expected a finite number"),
    "negative range": (GRAPH.replace("B4 2.2", "B4 -2.2"), "line 7, field 'range': a range is not negative"),
    "zero variance": (GRAPH.replace("2.2 0.01", "2.2 0"), "line 7: covariance is not positive definite"),
    "indefinite covariance": (GRAPH.replace("0.25 0.1 0.25", "0.25 0.3 0.25"), "line 6: covariance is not positive"),
    "cut line": (GRAPH.replace(" 0.25 0.1 0.25", ""), "line 6: EDGE_SE2_XY needs 8 words after the tag, found 5"),
    "long line": (GRAPH.replace("L6 2 2\nEDGE", "L6 2 2 2\nEDGE"), "line 4: VERTEX_XY needs 3 words"),
    "strange key": (GRAPH.replace("A0 A1", "A0 robot"), "line 5, field 'key': expected a letter and a count"),
    "landmark for a pose": (GRAPH.replace("A0 A1", "A0 L1"), "line 5, field 'key': expected the key of a pose"),
    "pose for a landmark": (GRAPH.replace("A0 L6", "A0 B6"), "line 6, field 'key': expected the key of a landmark"),
    "to itself": (GRAPH.replace("A0 A1", "A0 A0"), "line 5, field 'key': the measurement goes from A0 to itself"),
    "no stamp": (GRAPH.replace("EDGE_SE2 10.5", "EDGE_SE2 noon"), "line 5, field 't': expected a number"),
    "count too large": (GRAPH.replace("B4 3", f"B{2**60} 3"), "field 'key': expected a letter and a count"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    text, expected = DAMAGE[name]
    with pytest.raises(InputError, match=expected) as caught:
        read(written(tmp_path, text))
    assert "graph.pyfg" in str(caught.value)


def test_unknown_tags_and_ranges_of_nobody_are_counted(tmp_path: Path) -> None:
    found = read(written(tmp_path, GRAPH + "EDGE_FANCY 1 2 3\nEDGE_RANGE 1 L6 L7 3 1\nVERTEX_XY L9 0 0\n"))
    assert [(d.count, d.reason) for d in found.dropped] == [
        (1, "vertices without a measurement"),
        (1, "ranges between two landmarks"),
        (1, "lines with the unknown tag EDGE_FANCY"),
    ]


@given(damaged_text(GRAPH))
def test_nothing_but_a_log_or_an_error_comes_out(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    found = survives(pyfg.read, tmp_path_factory.mktemp("fuzz") / "graph.pyfg", content)
    assert found is None or isinstance(found, Dataset)
