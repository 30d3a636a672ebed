"""Whose a pose is: letters, blocks of ids, one count of the team, or every file its own; and what is no team at all."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.geometry import Pose
from teamslam.io import read
from teamslam.io.graphs.symbols import COUNT_BITS, LABEL_BITS, join_symbol
from teamslam.model import Dataset, index_of, pose_key, robot_of

I3 = "1 0 0 1 0 1"


def edge(a: int, b: int, z: str = "1 0 0") -> str:
    return f"EDGE_SE2 {a} {b} {z} {I3}\n"


def chain(ids: list[int]) -> str:
    """Vertices and odometry along some ids."""
    return "".join(f"VERTEX_SE2 {name} {name} 0 0\n" for name in ids) + "".join(edge(a, b) for a, b in pairwise(ids))


def log(folder: Path, **files: str) -> Dataset:
    """A log of some files; one alone is read as a file."""
    for name, text in files.items():
        (folder / f"{name}.g2o").write_text(text)
    return read(folder if len(files) > 1 else folder / f"{next(iter(files))}.g2o")


def of(found: Dataset) -> dict[str, list[int]]:
    """The poses of each robot, as the files number them."""
    return {found.names.robot(r): index_of(keys).tolist() for r, keys in found.pose_keys.items()}


TWO = chain([0, 1, 2]), chain([10000, 10001, 10002])
SEEN = "VERTEX_SE2 10001 5 5 5\n" + edge(2, 10001), "VERTEX_SE2 1 5 5 5\n" + edge(10000, 1)


def test_blocks_in_one_file(tmp_path: Path) -> None:
    found = log(tmp_path, team=TWO[0] + SEEN[0] + TWO[1] + SEEN[1])
    assert of(found) == {"0": [0, 1, 2], "1": [10000, 10001, 10002]}
    assert {(t.robot, t.source): len(t) for t in found.tables} == {
        (1, "odometry"): 2, (2, "odometry"): 2, (1, "robots"): 1, (2, "robots"): 1,
    }  # fmt: skip
    assert found.notes == ("ids come in blocks of 10000, one for each robot: 0, 1",)
    assert [(d.count, d.reason) for d in found.dropped] == [
        (2, "vertices that stand twice in a file: the first counts")
    ]
    assert found.initial is not None
    assert found.initial.pose(int(pose_key(1, 1))).translation.tolist() == [1.0, 0.0]  # the first counts


def test_blocks_in_several_files_are_called_by_the_files(tmp_path: Path) -> None:
    found = log(tmp_path, ada=TWO[1] + SEEN[1], bob=TWO[0] + SEEN[0])
    assert of(found) == {"bob": [0, 1, 2], "ada": [10000, 10001, 10002]}


def test_one_file_of_a_team_in_blocks(tmp_path: Path) -> None:
    assert of(log(tmp_path, one=TWO[0] + SEEN[0])) == {"0": [0, 1, 2], "1": [10001]}


@pytest.mark.parametrize(
    "ids",
    [
        list(range(9990, 10010)),  # numbered on past 9,999
        list(range(0, 40000, 1500)),  # keyframes of every 1,500th pose
        [0, 1, 2, 3, 50, 51, 52],
        list(range(0, 10**7, 25_000)),  # stamps
    ],
)
def test_one_robots_ids_are_no_blocks(ids: list[int], tmp_path: Path) -> None:
    found = log(tmp_path, alone=chain(ids))
    assert of(found) == {"alone": ids} and found.notes == ()


def test_one_count_of_the_team_in_several_files(tmp_path: Path) -> None:
    """Ids of the team without blocks; what a robot saw of another stands in both files as a vertex."""
    a, b = chain(list(range(10))), chain(list(range(10, 20)))
    found = log(tmp_path, a=a + "VERTEX_SE2 15 9 9 9\n" + edge(3, 15), b=b + "VERTEX_SE2 4 9 9 9\n" + edge(12, 4))
    assert of(found) == {"a": list(range(10)), "b": list(range(10, 20))}
    assert {t.source: len(t) for t in found.tables if t.robot == 1} == {"odometry": 9, "robots": 1}
    assert found.initial is not None  # the estimate of a pose is its own robot's: its first vertex
    assert found.dropped[0].count == 2


def test_files_that_count_for_themselves(tmp_path: Path) -> None:
    found = log(tmp_path, left=chain([0, 1, 2]), right=chain([0, 1]))
    assert of(found) == {"left": [0, 1, 2], "right": [0, 1]}
    assert found.notes == ("each file counts its own robot's poses",)


def test_labelled_symbols_are_of_the_robot_that_they_name(tmp_path: Path) -> None:
    def name(robot: str, count: int) -> int:
        return ord("x") << COUNT_BITS | ord(robot) << LABEL_BITS | count

    a, b = [name("A", k) for k in range(3)], [name("B", k) for k in range(2)]
    found = log(tmp_path, team=chain(a) + chain(b) + edge(a[1], b[1]))
    assert of(found) == {"A": [0, 1, 2], "B": [0, 1]}


@pytest.mark.parametrize("letter", "Ll")
def test_poses_called_l_are_landmarks_with_an_orientation(letter: str, tmp_path: Path) -> None:
    x, tag = [join_symbol("x", k) for k in range(3)], join_symbol(letter, 7)
    found = log(tmp_path, one=chain(x) + f"VERTEX_SE2 {tag} 1 1 1\n" + edge(x[0], tag) + edge(x[2], tag))
    assert list(of(found)) == ["x"] and found.landmark_keys.tolist() == [7]
    assert found.initial is not None and isinstance(found.initial.pose(7), Pose)


def test_a_robot_may_be_called_l(tmp_path: Path) -> None:
    names = [join_symbol("l", k) for k in range(3)]
    assert of(log(tmp_path, one=chain(names))) == {"l": [0, 1, 2]}


@given(
    st.lists(st.integers(2, 30), min_size=1, max_size=5),
    st.sampled_from([1, 3, 10]),
    st.booleans(),
    st.randoms(use_true_random=False),
)
def test_a_team_in_blocks_is_found_whatever_its_robots(
    tmp_path_factory: pytest.TempPathFactory, lengths: list[int], step: int, several: bool, random
) -> None:
    """Law: robot n is the poses from n * 10,000 on, whoever sees whom."""
    ways = [[10_000 * n + step * k for k in range(length)] for n, length in enumerate(lengths)]
    texts = [chain(way) for way in ways]
    for n in range(len(ways)):
        for _ in range(3):
            if (other := random.randrange(len(ways))) != n:
                texts[n] += edge(random.choice(ways[n]), random.choice(ways[other]), f"{random.random()} 0 0")
    files = {f"r{n}": text for n, text in enumerate(texts)} if several else {"team": "".join(texts)}
    found = log(tmp_path_factory.mktemp("team"), **files)
    assert sorted(of(found).values()) == ways
    for table in found.tables:
        apart = robot_of(table.keys[:, 0]) != robot_of(table.keys[:, 1])
        assert (apart == (table.source == "robots")).all() or not np.any(apart)
