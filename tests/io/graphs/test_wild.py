"""Graph files as they are found in public places: each is read, or refused in one sentence that says what to do.

The texts are made here; their form is that of files in public repositories: exports of mapping programs, lecture
exercises, robots' logs.
"""

from pathlib import Path

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.io import read
from teamslam.io.graphs.symbols import join_symbol
from teamslam.model import Dataset

I3, I6 = "1 0 0 1 0 1", "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
Q = "0 0 0 1"


def log(folder: Path, text: str, name: str = "log.g2o") -> Dataset:
    (folder / name).write_bytes(text.encode())
    return read(folder / name)


def models(found: Dataset) -> dict[str, int]:
    counts: dict[str, int] = {}
    for table in found.tables:
        counts[f"{table.source} {table.model}"] = counts.get(f"{table.source} {table.model}", 0) + len(table)
    return counts


READ = {
    "a mapping program's export: comments, CRLF, blank lines, tabs, trailing blanks": (
        "# saved by a mapper\r\n\r\nVERTEX_SE2 0 0 0 0 \r\nVERTEX_SE2\t1\t1\t0\t0\r\n"
        f"EDGE_SE2 0 1  1.0e+00 0.000000E-05 -0 {I3} \r\n",
        {"odometry relative_pose": 1},
        [],
    ),
    "positions by satellite, with a sensor's id and without": (
        f"PARAMS_SE3OFFSET 0 0.1 0 2 {Q}\nVERTEX_SE3:QUAT 0 0 0 0 {Q}\nVERTEX_SE3:QUAT 1 1 0 0 {Q}\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 {Q} {I6}\nEDGE_SE3_XYZ_PRIOR 0 0 1 2 3 {I3}\nEDGE_SE3_XYZ_PRIOR 1 1 2 3 {I3}\n",
        {"odometry relative_pose": 1, "world position": 2},
        [],
    ),
    "a prior that says nothing about position, by an inertial unit": (
        f"PARAMS_SE3OFFSET 0 0 0 0 {Q}\nVERTEX_SE3:QUAT 0 0 0 0 {Q}\nVERTEX_SE3:QUAT 1 1 0 0 {Q}\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 {Q} {I6}\n"
        f"EDGE_SE3_PRIOR 1 0 1 0 0 {Q} 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 9 0 0 9 0 0\n",
        {"odometry relative_pose": 1, "world pose": 1},
        [],
    ),
    "g2o's tutorial": (
        "TUTORIAL_PARAMS_SE2_OFFSET 0 0.2 0.1 -0.1\nTUTORIAL_VERTEX_SE2 0 0 0 0\nTUTORIAL_VERTEX_SE2 1 1 0 0\n"
        f"TUTORIAL_VERTEX_POINT_XY 2 1 1\nTUTORIAL_EDGE_SE2 0 1 1 0 0 {I3}\n"
        "TUTORIAL_EDGE_SE2_POINT_XY 0 2 0 1 1 500 0 500\n",
        {"odometry relative_pose": 1, "landmarks point": 1},
        [],
    ),
    "lasers, cameras and switches among the edges": (
        f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {I3}\nROBOTLASER1 0 1 2 3\nVERTEX_SWITCH 9 1\n"
        "EDGE_SE2_SWITCHABLE 0 1 9 1 0 0 1 0 0 1 0 1\nDATA x\nDATA y\n",
        {"odometry relative_pose": 1},
        [1, 1, 1, 2],
    ),
    "edges and no vertices": (
        f"EDGE_SE2 0 1 1 0 0 {I3}\nLANDMARK2 0 11 1 2 10 0 10\nLANDMARK2 1 11 1 2 10 0 10\n",
        {"odometry relative_pose": 1, "landmarks point": 2},
        [],
    ),
    "landmarks that nobody guessed": (
        f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {I3}\nEDGE_SE2_XY 0 5 1 1 1 0 1\n",
        {"odometry relative_pose": 1, "landmarks point": 1},
        [],
    ),
    "the first vertex fixed, and said twice": (
        f"FIX 0\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {I3}\n",
        {"odometry relative_pose": 1},
        [1, 1],
    ),
    "edges that say nothing": (
        f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {I3}\nEDGE_SE2 0 1 1 0 0 0 0 0 0 0 0\n",
        {"odometry relative_pose": 1},
        [1],
    ),
    "quaternions of six digits": (
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0.70711 0.70711\nVERTEX_SE3:QUAT 1 0 1 0 0 0 0.70711 0.70711\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 {Q} {I6}\n",
        {"odometry relative_pose": 1},
        [],
    ),
}


@pytest.mark.parametrize("name", READ)
def test_it_is_read(name: str, tmp_path: Path) -> None:
    text, expected, dropped = READ[name]
    found = log(tmp_path, text)
    assert models(found) == expected
    assert sorted(drop.count for drop in found.dropped) == dropped
    assert all(np.isfinite(table.whitening).all() for table in found.tables)


def test_a_satellites_antenna_is_left_out_of_account_as_g2o_does(tmp_path: Path) -> None:
    """g2o's error of EDGE_SE3_XYZ_PRIOR is the vertex's own position, whatever its sensor's id says."""
    text = READ["positions by satellite, with a sensor's id and without"][0]
    world = next(t for t in log(tmp_path, text).tables if t.source == "world")
    assert world.sensor is None and world.values.tolist() == [[1, 2, 3], [1, 2, 3]]


def test_a_robots_tags_have_an_orientation(tmp_path: Path) -> None:
    """A tag mapper's export: keyframes x, tags l."""
    x, tags = [join_symbol("x", k) for k in range(2)], [join_symbol("l", k) for k in range(2)]
    text = "".join(f"VERTEX_SE3:QUAT {name} 0 0 0 {Q}\n" for name in [*x, *tags])
    text += "".join(f"EDGE_SE3:QUAT {a} {b} 1 0 0 {Q} {I6}\n" for a, b in [x, (x[0], tags[0]), (x[1], tags[1])])
    found = log(tmp_path, text)
    assert models(found) == {"odometry relative_pose": 1, "landmarks relative_pose": 2}
    assert list(found.robots) == [24] and found.landmark_keys.tolist() == [0, 1]


REFUSED = {
    "a locale's decimal commas": (
        f"VERTEX_SE3:QUAT 1 0,1 0 0 {Q}\n",
        r"line 1, field 'x': expected a number, found '0,1' \(decimal commas",
    ),
    "landmarks without information": (
        "VERTEX_SE2 0 0 0 0\nVERTEX_XY 5 1 1\nEDGE_SE2_XY 0 5 1 1\n",
        r"line 3: EDGE_SE2_XY needs 7 words after the tag, found 4; write 'EDGE_SE2_XY id id x y upper triangle of",
    ),
    "tags torn apart": ("VERTEX_SE3 : QUAT 0 0 0 0 0 0 0 1\n", "no line is a measurement.*unknown tag VERTEX_SE3"),
    "a sensor that nobody placed": (
        f"VERTEX_SE3:QUAT 0 0 0 0 {Q}\nVERTEX_TRACKXYZ 1 1 0 0\nEDGE_SE3_TRACKXYZ 0 1 3 1 0 0 {I3}\n",
        "parameter 3 is not defined .* it is 'PARAMS_SE3OFFSET 3 0 0 0 0 0 0 1'",
    ),
    "an inertial unit off the body": (
        f"PARAMS_SE3OFFSET 0 1 0 0 {Q}\nVERTEX_SE3:QUAT 0 0 0 0 {Q}\nEDGE_SE3_PRIOR 0 0 1 0 0 {Q} {I6}\n",
        "an absolute pose of a sensor that is not at the body's origin is not supported",
    ),
    "ids in nanoseconds": (f"EDGE_SE2 1403636579763555584 1403636579813555456 1 0 0 {I3}\n", "ids run from 0 to 2"),
    "a multi-hypothesis file": (
        "EDGE2 0 1 1 0 1 0.97 -0.01 0.02\n",
        "EDGE2 needs 5 or 11 words after the tag, found 8",
    ),
    "a page of the web": ("<!DOCTYPE html>\n<html>404: Not Found</html>\n", "a page of the web; .* file itself"),
    "a pointer to a large file": ("version https://git-lfs.github.com/spec/v1\noid sha256:1\n", "run 'git lfs pull'"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_sentence(name: str, tmp_path: Path) -> None:
    text, expected = REFUSED[name]
    with pytest.raises(InputError, match=expected):
        log(tmp_path, text)
