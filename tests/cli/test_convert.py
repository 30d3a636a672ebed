"""Logs go from one format to another; what gets lost is told."""

from pathlib import Path

import numpy as np
import pytest

from teamslam.io import FORMATS, MAP_FORMATS, read, read_maps, read_submaps, write, write_submaps
from teamslam.io.maps.tum import read_trajectory
from teamslam.joining import build, split
from teamslam.results import read_run
from worlds import team


def test_help_names_every_format_and_those_that_are_only_read(teamslam) -> None:
    """A new row of FORMATS is a new line of help."""
    lines = teamslam("convert", "--help").out.splitlines()
    for name, row in FORMATS.items():
        line = next(line for line in lines if line.strip().startswith(f"{name} "))
        assert ("(read only)" in line) is not row.writes
    told = " ".join(lines)
    assert all(name in told[told.index("Of maps") : told.index("Of submaps")] for name in MAP_FORMATS)


@pytest.mark.parametrize("to", [name for name, row in FORMATS.items() if row.writes])
def test_a_log_goes_through_every_format_that_is_written(teamslam, tmp_path: Path, to: str) -> None:
    """As many measurements come out as went in; what had to be said in other words (points, to JRL) is told."""
    before = team("2d", poses=6)
    write(before, tmp_path / "log", "plain")
    called = teamslam("convert", tmp_path / "log", tmp_path / "out", "--to", to)
    assert called.code == 0 and "3 robots" in called.out
    assert ("points: written as ranges with bearings" in called.out) == (to == "jrl")
    after = read(tmp_path / "out", format=to)
    assert sum(len(t) for t in after.tables) == sum(len(t) for t in before.tables)


def test_an_output_that_is_there_is_not_written_over(teamslam, tmp_path: Path) -> None:
    """Nor is it read before the refusal."""
    (tmp_path / "out").write_text("mine")
    called = teamslam("convert", tmp_path, tmp_path / "out")
    assert called.code == 2 and "there already" in called.err
    assert (tmp_path / "out").read_text() == "mine"


def test_a_format_that_is_only_read_is_refused_with_those_that_are_written(teamslam, tmp_path: Path) -> None:
    """MRCLAM is not written."""
    write(team("2d", poses=4), tmp_path / "log", "plain")
    called = teamslam("convert", tmp_path / "log", tmp_path / "out", "--to", "mrclam")
    assert called.code == 2 and "plain" in called.err and not (tmp_path / "out").exists()


def test_what_no_words_can_say_names_the_formats_that_can(teamslam, tmp_path: Path) -> None:
    """Ranges from robots in the plane: not g2o's, but PyFG's and JRL's. The advice, followed, works."""
    write(team("2d", poses=6, model="range"), tmp_path / "log", "plain")
    called = teamslam("convert", tmp_path / "log", tmp_path / "out.g2o")
    assert called.code == 2 and not (tmp_path / "out.g2o").exists()
    assert "plain and pyfg and jrl can hold all of this log" in " ".join(called.err.split())
    for name in ("plain", "pyfg", "jrl"):
        assert teamslam("convert", tmp_path / "log", tmp_path / name, "--to", name).code == 0


# --- maps -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run: three robots in the plane, one map."""
    from teamslam.pipeline import run as run_pipeline
    from teamslam.results import write_run

    folder = tmp_path_factory.mktemp("run") / "run"
    write_run(run_pipeline(team("2d", poses=6)), folder, figures=False)
    return folder


@pytest.mark.parametrize("ending", ["csv", "jrr", "g2o", "tum", "submap"])
def test_a_run_becomes_files_for_others(teamslam, run: Path, tmp_path: Path, ending: str) -> None:
    """Each is read back, by what reads it, as the map of the run."""
    out = tmp_path / f"map.{ending}"
    called = teamslam("convert", run, out)
    assert called.code == 0, called.err
    assert ("18 poses, 6 landmarks" in called.out) == (ending != "submap")
    expected = read_run(run).maps[0].all_values
    if ending in ("csv", "jrr"):
        found = read_maps(out)[0].values
    elif ending == "g2o":
        found = read(out).initial
    elif ending == "submap":
        found = read_submaps(out)[0].all_values
    else:
        files = sorted(tmp_path.glob("*.tum"))
        assert [f.name for f in files] == ["map_1.tum", "map_2.tum", "map_3.tum"]
        stamps, poses = read_trajectory(files[1])
        assert len(stamps) == 6
        assert np.allclose(poses.xytheta(), expected.poses_of(expected.layout.keys[6:12], 2).xytheta())
        return
    assert found is not None and np.array_equal(found.layout.keys, expected.layout.keys)
    assert np.allclose(found.state, expected.state, atol=1e-12)


def test_a_map_from_a_file_goes_on(teamslam, run: Path, tmp_path: Path) -> None:
    """From the table to GTSAM's values and to trajectories; and a map may be scored against it."""
    assert teamslam("convert", run, tmp_path / "map.csv").code == 0
    assert teamslam("convert", tmp_path / "map.csv", tmp_path / "map.jrr").code == 0
    called = teamslam("convert", tmp_path / "map.jrr", tmp_path / "ways", "--to", "tum")
    assert called.code == 0 and len(list((tmp_path / "ways").iterdir())) == 3
    called = teamslam("score", run, tmp_path / "map.csv")
    assert called.code == 0 and "0.0000 m" in called.out


def test_the_covariances_are_those_of_the_run(teamslam, run: Path, tmp_path: Path) -> None:
    teamslam("convert", run, tmp_path / "map.csv")
    found, record = read_maps(tmp_path / "map.csv")[0], read_run(run)
    assert found.covariances is not None
    for key, block in zip(found.values.layout.keys.tolist(), found.covariances, strict=True):
        expected = np.zeros((3, 3)) if key == record.maps[0].base else record.covariances[0].of(key)
        assert np.allclose(block, expected, rtol=1e-9)


def test_submaps_become_submaps_and_one_alone_a_map(teamslam, tmp_path: Path) -> None:
    submaps = [build(piece) for piece in split(team("2d", poses=8, robots=1), poses_per_piece=4)]
    write_submaps(submaps, tmp_path / "many")
    called = teamslam("convert", tmp_path / "many", tmp_path / "linear", "--to", "linear")
    assert called.code == 2 and "landmark 0 (ids of features start at 1)" in " ".join(called.err.split())
    assert teamslam("convert", tmp_path / "many", tmp_path / "again", "--to", "teamslam").code == 0
    assert len(read_submaps(tmp_path / "again")) == len(submaps)
    called = teamslam("convert", tmp_path / "many", tmp_path / "map.csv")
    assert called.code == 2 and "each in a frame of its own; join them first" in " ".join(called.err.split())
    one = next((tmp_path / "many").iterdir())
    assert teamslam("convert", one, tmp_path / "map.csv").code == 0
    called = teamslam("convert", one, tmp_path / "map")
    assert called.code == 2 and "the ending of this name says no format" in " ".join(called.err.split())
