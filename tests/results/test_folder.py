"""A run folder is whole or not there, is never written over unasked, and gives the run back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config, JoinOptions, read_config
from teamslam.errors import InputError
from teamslam.io.submaps.arrays import write_submap
from teamslam.pipeline import Result, run
from teamslam.results import Record, read_run, write_run
from teamslam.results.figures import headline
from worlds import team

PARTS = {
    "config.toml", "figures", "history.csv", "landmarks.csv", "log.npz", "map.npz", "maps", "report.json",
    "residuals.csv", "team.csv", "trajectories.csv", "tum",
}  # fmt: skip


def test_a_run_survives_its_folder(result: Result, tmp_path: Path) -> None:
    """Maps, covariances, truth, sightings, steps and report come back as they were."""
    written = write_run(result, tmp_path / "run", figures=False)
    assert {p.name for p in (tmp_path / "run").iterdir()} == PARTS - {"figures"}
    again = read_run(tmp_path / "run")
    assert again.report == json.loads(json.dumps(written.report))
    for mine, theirs in zip(written.maps, again.maps, strict=True):
        np.testing.assert_array_equal(mine.values.state, theirs.values.state)
        assert abs(mine.information - theirs.information).max() <= 1e-12 * abs(mine.information).max()
    assert again.truth is not None and written.truth is not None
    np.testing.assert_array_equal(again.truth.state, written.truth.state)
    np.testing.assert_array_equal(again.sightings, written.sightings)
    assert repr(again.histories) == repr(written.histories) and again.costs == written.costs
    assert read_config(tmp_path / "run" / "config.toml") == result.config


def test_figures_are_drawn_into_the_folder(result: Result, tmp_path: Path) -> None:
    """All of a run with truth."""
    write_run(result, tmp_path / "run")
    drawn = {p.name for p in (tmp_path / "run" / "figures").iterdir()}
    names = ("map", "convergence", "residuals", "residuals_by_landmark", "errors", "consistency")
    assert drawn == {f"{name}.png" for name in names}


def test_plain_arrays_are_the_map(result: Result, tmp_path: Path) -> None:
    """Whoever has only numpy can invert the information and find the covariance."""
    import scipy.sparse as sp

    write_run(result, tmp_path / "run", figures=False)
    with np.load(tmp_path / "run" / "map.npz") as found:
        information = sp.csr_array(
            (found["information_data"], found["information_indices"], found["information_indptr"])
        )
        covariance = np.linalg.inv(information.toarray())
        start = np.concatenate([[0], np.cumsum(found["dofs"])])
        number = len(found["keys"]) // 2
        block = covariance[start[number] : start[number + 1], start[number] : start[number + 1]]
        np.testing.assert_allclose(block, result.covariances[0].of(int(found["keys"][number])), rtol=1e-6, atol=1e-12)


def test_plain_arrays_hold_every_component(tmp_path: Path) -> None:
    """Robots that nothing joins have maps of their own, and none is lost; each with its own information."""
    log = team("2d", robots=2, poses=6)
    lone = run(log.with_tables(table for table in log.tables if table.source == "odometry"))
    assert len(lone.joined.components) == 2
    write_run(lone, tmp_path / "run", figures=False)
    with np.load(tmp_path / "run" / "map.npz") as found:
        assert found["parts"] == 2
        for prefix, component in zip(("", "part_2_"), lone.joined.components, strict=True):
            np.testing.assert_array_equal(found[prefix + "keys"], component.map.values.layout.keys)
            np.testing.assert_array_equal(found[prefix + "state"], component.map.values.state)
            assert found[prefix + "information_indptr"][-1] == len(found[prefix + "information_data"])


def test_one_tum_file_a_robot_with_eight_columns(result: Result, tmp_path: Path) -> None:
    """stamp x y z qx qy qz qw, as evo reads it."""
    write_run(result, tmp_path / "run", figures=False)
    files = sorted((tmp_path / "run" / "tum").iterdir())
    assert [f.name for f in files] == [f"{r}.tum" for r in sorted(result.dataset.robots)]
    for robot, file in zip(sorted(result.dataset.robots), files, strict=True):
        rows = np.loadtxt(file)
        keys = result.map.trajectory_keys(robot)
        assert rows.shape == (len(keys), 8)
        np.testing.assert_allclose(rows[:, 1:4], result.map.all_values.positions(keys, 3), atol=1e-8)


def test_nothing_is_left_of_a_run_that_fails_half_way(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk while the last file is written leaves no folder at all."""
    import teamslam.results.folder as folder

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(folder.FILES, "tum", full)
    with pytest.raises(OSError, match="No space"):
        write_run(result, tmp_path / "run", figures=False)
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_is_replaced_only_when_asked(result: Result, tmp_path: Path) -> None:
    """And then whole, but for what no run wrote: that is named, and nothing is touched."""
    write_run(result, tmp_path / "run", figures=False)
    (tmp_path / "run" / "figures").mkdir()
    with pytest.raises(InputError, match="--force"):
        write_run(result, tmp_path / "run", figures=False)
    assert (tmp_path / "run" / "figures").exists()
    write_run(result, tmp_path / "run", figures=False, replace=True)
    assert {p.name for p in tmp_path.iterdir()} == {"run"} and not (tmp_path / "run" / "figures").exists()
    (tmp_path / "run" / "note.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds note\.txt, which no run writes"):
        write_run(result, tmp_path / "run", figures=False, replace=True)
    assert (tmp_path / "run" / "note.txt").read_text() == "mine"


def test_a_folder_that_is_no_run_is_never_replaced(result: Result, tmp_path: Path) -> None:
    """--force on the home folder must not empty it."""
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years")
    with pytest.raises(InputError, match="no run"):
        write_run(result, tmp_path / "home", figures=False, replace=True)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write_run(result, tmp_path / "file", figures=False)


@pytest.mark.parametrize("name", ["report.json", "history.csv", "log.npz"])
def test_a_damaged_run_is_refused_by_the_file_at_fault(result: Result, tmp_path: Path, name: str) -> None:
    """Rubbish in a file, or the file gone: its name is told."""
    write_run(result, tmp_path / "run", figures=False)
    (tmp_path / "run" / name).write_bytes(b"\x00rubbish,\x01\n\xfe")
    with pytest.raises(InputError, match=name):
        read_run(tmp_path / "run")
    (tmp_path / "run" / name).unlink()
    with pytest.raises(InputError, match=name):
        read_run(tmp_path / "run")


def test_a_map_that_is_not_determined_is_refused(result: Result, tmp_path: Path) -> None:
    """Its information is proved on reading, as that of any submap."""
    write_run(result, tmp_path / "run", figures=False)
    (file,) = (tmp_path / "run" / "maps").iterdir()
    free = result.map.information.copy()
    free.data[free.indices == np.repeat(np.arange(free.shape[0]), np.diff(free.indptr))] *= -1.0
    write_submap(replace(result.map, information=free), file)
    with pytest.raises(InputError, match="not positive definite") as told:
        read_run(tmp_path / "run")
    assert told.value.path == tmp_path / "run" / "maps"


def test_a_report_holds_every_field_that_scripts_rely_on(record: Record) -> None:
    """By name and type."""
    report = json.loads(json.dumps(record.report))
    for name in ("cost", "chi2", "seconds", "robot_position_rmse_m", "landmark_rmse_m", "nees_per_dof"):
        assert isinstance(report[name], float) and report[name] >= 0.0
    for name in ("dof", "iterations", "components", "robots", "poses", "landmarks", "dropped"):
        assert isinstance(report[name], int) and not isinstance(report[name], bool)
    assert report["method"] == "join" and report["converged"] is True and report["status"].endswith(".")
    assert report["components"] == 1 and report["reasons"] == []
    exactness = report["exactness"]
    assert set(exactness) >= {"relative_cost_gap", "gradient_norm", "max_shift_sigma", "rounds", "bytes"}
    assert 0.0 <= exactness["relative_cost_gap"] < 1.0 and exactness["rounds"] == 1 and exactness["bytes"] > 0
    assert report["robots"] == 3 and report["dropped"] == 0
    assert set(report["versions"]) == {"teamslam", "numpy", "scipy", "python"}


def test_the_defaults_are_written_out(result: Result, tmp_path: Path) -> None:
    """config.toml holds every option, so that a later version's defaults do not change the run."""
    write_run(result, tmp_path / "run", figures=False)
    text = (tmp_path / "run" / "config.toml").read_text()
    for word in ("method", "max_iterations", "order"):
        assert word in text
    assert read_config(tmp_path / "run" / "config.toml") == Config()


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (Config(), "submap joining"),
        (Config(join=JoinOptions(exact=True)), "exact submap joining"),
        (Config(method="full"), "full least squares"),
    ],
)
def test_figures_say_how_the_map_was_made(config: Config, words: str) -> None:
    """Every join says how exact it is, but only one that went on in rounds is called exact."""
    record = Record.of(run(team("planar"), config))
    assert headline(record).partition(": ")[2].lower() == words
