"""Graph files of teams and of one robot, as people have them, through `info` and `run`: to the optimum of the file."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

SQUARE = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 1.57079633
VERTEX_SE2 2 1 1 3.14159265
VERTEX_SE2 3 0 1 -1.57079633
EDGE_SE2 0 1 1.1 0 1.57079633 100 0 0 100 0 400
EDGE_SE2 1 2 1 0.1 1.57079633 100 0 0 100 0 400
EDGE_SE2 2 3 1 0 1.62079633 100 0 0 100 0 400
EDGE_SE2 3 0 1 0 1.55079633 100 0 0 100 0 0
"""
POINTS = """PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1
VERTEX_TRACKXYZ 10 1 1 0
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 400 0 0 400 0 400
EDGE_SE3_TRACKXYZ 0 10 0 1 1 0.1 25 0 0 25 0 1
EDGE_SE3_TRACKXYZ 1 10 0 0.2 1 0 25 0 0 25 0 0
"""
ROBOTS = (
    """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
VERTEX_SE2 10001 2 1 1.57
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400
EDGE_SE2 1 2 1.02 0 0.01 100 0 0 100 0 400
EDGE_SE2 2 10001 0.01 1 1.57 50 0 0 50 0 200
""",
    """VERTEX_SE2 10000 0 0 0
VERTEX_SE2 10001 1 0 0
VERTEX_SE2 10002 2 0 0
VERTEX_SE2 1 0.5 0 0
EDGE_SE2 10000 10001 1 0 0 100 0 0 100 0 400
EDGE_SE2 10001 10002 0.98 0 0 100 0 0 100 0 400
EDGE_SE2 10000 1 -0.02 1 -1.56 50 0 0 50 0 200
""",
)


def mapped(teamslam, log: Path, out: Path) -> dict[str, object]:
    called = teamslam("run", log, "--out", out, "--exact", "--no-figures")
    assert called.code == 0, called.err
    return json.loads((out / "report.json").read_text())


def optimum(text: str) -> float:
    """The least squares of a planar pose graph, by SciPy: g2o's error, from the file's vertices."""
    rows = [[float(word) for word in line.split()[1:]] for line in text.splitlines() if line.startswith("EDGE")]
    start = {int(w[1]): [float(x) for x in w[2:]] for w in map(str.split, text.splitlines()) if w[0] == "VERTEX_SE2"}
    names = sorted(start)

    def residuals(x: np.ndarray) -> np.ndarray:
        at = {name: x[3 * k : 3 * k + 3] for k, name in enumerate(names)}
        out = [100.0 * at[names[0]]]  # the frame
        for row in rows:
            a, b, z = at[int(row[0])], at[int(row[1])], row[2:5]
            information = np.zeros((3, 3))
            information[np.triu_indices(3)] = row[5:]
            information += np.triu(information, 1).T
            values, vectors = np.linalg.eigh(information)
            c, s = np.cos(a[2]), np.sin(a[2])
            h = np.array([[c, s], [-s, c]]) @ (b[:2] - a[:2])
            c, s = np.cos(z[2]), np.sin(z[2])
            e = np.append(np.array([[c, s], [-s, c]]) @ (h - z[:2]), np.angle(np.exp(1j * (b[2] - a[2] - z[2]))))
            out.append(np.sqrt(np.maximum(values, 0.0)) * (vectors.T @ e))
        return np.concatenate(out)

    x = np.concatenate([start[name] for name in names])
    return 2.0 * float(least_squares(residuals, x, xtol=1e-15, ftol=1e-15, gtol=1e-15).cost)


def test_information_with_a_direction_of_zero(teamslam, tmp_path: Path) -> None:
    (tmp_path / "square.g2o").write_text(SQUARE)
    report = mapped(teamslam, tmp_path / "square.g2o", tmp_path / "out")
    assert report["chi2"] == pytest.approx(0.0558436, abs=5e-8) == pytest.approx(optimum(SQUARE), abs=5e-8)


def test_points_that_say_nothing_about_height(teamslam, tmp_path: Path) -> None:
    """The landmark's height is known by its other sighting alone, which it meets exactly."""
    (tmp_path / "points.g2o").write_text(POINTS)
    report = mapped(teamslam, tmp_path / "points.g2o", tmp_path / "out")
    # In x each sighting has variance 0.04, the way between them 0.01, its turn 0.01 at 1 m of arm (g2o's half angles).
    assert report["landmarks"] == 1 and report["chi2"] == pytest.approx(0.2**2 / (0.04 + 0.04 + 0.01 + 0.01), rel=0.02)


@pytest.mark.parametrize("together", [False, True])
def test_two_robots_in_blocks_of_ids_are_one_map(teamslam, tmp_path: Path, together: bool) -> None:
    log = tmp_path / "team"
    log.mkdir()
    files = {"both": "".join(ROBOTS)} if together else {"left": ROBOTS[0], "right": ROBOTS[1]}
    for name, text in files.items():
        (log / f"{name}.g2o").write_text(text)
    report = mapped(teamslam, log, tmp_path / "out")
    assert (report["robots"], report["components"], report["poses"]) == (2, 1, 6)
    assert report["chi2"] == pytest.approx(0.0359796, abs=5e-8)
    called = teamslam("info", log)
    assert called.code == 0 and "ids come in blocks of 10000" in " ".join(called.out.split())


def test_a_vertex_that_stands_twice_is_counted(teamslam, tmp_path: Path) -> None:
    (tmp_path / "twice.g2o").write_text(SQUARE + "VERTEX_SE2 2 9 9 9\n")
    report = mapped(teamslam, tmp_path / "twice.g2o", tmp_path / "out")
    assert report["chi2"] == pytest.approx(0.0558436, abs=5e-8)
    assert report["dropped_reasons"] == [
        {"count": 1, "reason": "vertices that stand twice in a file: the first counts"}
    ]
