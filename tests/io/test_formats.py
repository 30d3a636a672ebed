"""The table of formats: what is written reads back the same, and what fits nothing says so."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logs import ABILITIES, assert_rows_numbered_once, assert_same_log, logs
from teamslam.errors import InputError
from teamslam.io import FORMATS, MAP_FORMATS, SUBMAP_FORMATS, read, read_submaps, write, write_submaps
from teamslam.model import Dataset, Names, Table, landmark_key, pose_key
from worlds import team


@pytest.mark.parametrize("name", ABILITIES)
@given(data=st.data())
@settings(max_examples=40)
def test_what_is_written_reads_back_the_same(name: str, data: st.DataObject) -> None:
    log = data.draw(logs(ABILITIES[name]))
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"log{FORMATS[name].suffixes[0]}"
        write(log, path)  # the format is told by the ending, when writing and when reading
        found = read(path)
    assert_same_log(found, log)
    assert_rows_numbered_once(found)


@pytest.mark.parametrize("name", ["g2o", "pyfg"])
def test_a_table_of_robots_and_landmarks_is_written_by_what_it_sees(name: str, tmp_path: Path) -> None:
    poses, mark, whitening = pose_key(1, np.arange(2)), int(landmark_key(7)), np.eye(3)[None]
    step = np.array([[1.0, 0, 1, 0, 0, 1]])
    odometry = Table(1, "odometry", "relative_pose", 2, poses[None], step, whitening, np.array([0]))
    # Positions of the robot's next pose and of a landmark, in one table.
    model, values = ("position", np.ones((2, 2))) if name == "g2o" else ("range", np.ones((2, 1)))
    keys = np.array([[poses[1]], [mark]]) if name == "g2o" else np.array([[poses[0], poses[1]], [poses[0], mark]])
    both = Table(1, "mixed", model, 2, keys, values, np.eye(values.shape[1])[None], np.arange(2))
    seen = Table(
        1, "landmarks", "point", 2, np.array([[poses[0], mark]]), np.ones((1, 2)), np.eye(2)[None], np.array([0])
    )
    path = tmp_path / f"log.{name}"
    write(Dataset({1: 2}, (odometry, seen, both), Names(tick_s=1.0)), path)
    found = [t for t in read(path).tables if t.model == model]
    assert sorted(key for t in found for row in t.keys.tolist() for key in row[-1:]) == [mark, int(poses[1])]


def test_every_format_that_writes_graphs_is_tested() -> None:
    assert {name for name, row in FORMATS.items() if row.writes and row.suffixes} == set(ABILITIES)


@pytest.mark.parametrize("name", ABILITIES)
def test_more_robots_than_letters_are_refused(name: str, tmp_path: Path) -> None:
    poses = pose_key(60, np.arange(2))
    step = np.array([[1.0, 0, 1, 0, 0, 1]])
    odometry = Table(60, "odometry", "relative_pose", 2, poses[None], step, np.eye(3)[None], np.array([0]))
    with pytest.raises(InputError, match="robot 60 has no letter"):
        write(Dataset({60: 2}, (odometry,), Names(tick_s=1.0)), tmp_path / f"log.{name}")


@pytest.mark.parametrize("name", FORMATS)
def test_a_folder_with_nothing_in_it(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read(tmp_path, format=name)


def test_every_row_has_its_functions() -> None:
    for row in [*FORMATS.values(), *SUBMAP_FORMATS.values()]:
        for name in ["sniff", "read", *(["write"] if row.writes else [])]:
            assert callable(row.function(name)), (row.module, name)


def test_a_path_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "nothing.g2o")


def test_a_file_of_no_known_format_lists_the_formats(tmp_path: Path) -> None:
    (tmp_path / "letter.docx").write_text("dear robot")
    with pytest.raises(InputError, match=r"(?s)none of the formats.*mrclam.*g2o"):
        read(tmp_path / "letter.docx")
    with pytest.raises(InputError, match=r"(?s)none of the formats.*linear"):
        read_submaps(tmp_path / "letter.docx")


def test_an_unknown_format_lists_the_formats(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"(?s)unknown format 'tolo'.*g2o"):
        read(tmp_path, format="tolo")


def test_a_format_that_is_only_read_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"(?s)does not write.*linear"):
        write_submaps([], tmp_path, "islsjf")


@pytest.mark.parametrize("name", sorted({*MAP_FORMATS, *SUBMAP_FORMATS} - {*FORMATS}))
def test_a_log_is_not_written_as_something_else(name: str, tmp_path: Path) -> None:
    """Neither by its name nor by the ending of a file's: what to do is said, and no folder stands under that name."""
    row = {**SUBMAP_FORMATS, **MAP_FORMATS}[name]
    known = {ending for own in FORMATS.values() for ending in own.suffixes}
    for path, format in [(tmp_path / "x", name), *((tmp_path / f"x{end}", None) for end in {*row.suffixes} - known)]:
        with pytest.raises(InputError, match=r"is a format of (finished maps|submaps).*teamslam (run|build) LOG --out"):
            write(team("2d", poses=4), path, format)
    assert not any(tmp_path.iterdir())


def test_what_is_of_another_kind_says_how_to_go_on(tmp_path: Path) -> None:
    """A log where submaps are asked for, and submaps where a log is."""
    write(team("2d", poses=4), tmp_path / "log", "plain")
    with pytest.raises(InputError, match=r"That is a log: `teamslam run \S+/log --out DIR` maps it"):
        read_submaps(tmp_path / "log")
    (tmp_path / "localmap_1.txt").write_text("0\n0\n")
    with pytest.raises(InputError, match=r"Those are submaps: `teamslam join \S+ --out DIR` makes a map"):
        read(tmp_path)


def test_an_unknown_option_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    with pytest.raises(InputError, match=r"no option 'charts'; did you mean 'chart'"):
        read(tmp_path / "a.g2o", charts="gtsam")
