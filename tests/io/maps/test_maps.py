"""Finished maps as files: what is written reads back; GTSAM and evo find in it what teamslam found."""

import csv
import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import damaged_text, survives
from estimates import estimate
from logs import assert_same_values
from strategies import dims, generators, random_poses
from teamslam.errors import InputError, ModelError
from teamslam.geometry import Pose
from teamslam.io import MAP_FORMATS, MapEstimate, formats_of, read, read_maps, write_maps
from teamslam.io.maps import jrr, table
from teamslam.io.maps.star import as_log
from teamslam.model import WORLD, Kind, Names, Values, pack, pose_key, pose_kind
from teamslam.solver import Covariances, System, optimise


def assert_same(found: MapEstimate, expected: MapEstimate, *, covariances: bool) -> None:
    assert_same_values(found.values, expected.values)
    assert found.base == expected.base
    assert {k: found.names.robot(k) for k in (1, 2)} == {k: expected.names.robot(k) for k in (1, 2)}
    assert dict(found.names.landmarks) == dict(expected.names.landmarks) and found.names.tick_s == expected.names.tick_s
    assert (found.covariances is not None) is covariances
    for mine, theirs in zip(found.covariances or (), expected.covariances or (), strict=False):
        assert np.array_equal(mine, np.triu(theirs) + np.triu(theirs, 1).T)


@pytest.mark.parametrize(("ending", "covariances"), [("csv", True), ("jrr", False)])
@given(generators, dims, st.booleans(), st.booleans(), st.booleans())
def test_what_is_written_reads_back(
    ending: str, covariances: bool, rng: np.random.Generator, dim: int, world: bool, mixed: bool, ticks: bool
) -> None:
    expected = estimate(rng, dim, world=world, mixed=mixed, ticks=ticks)
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map.{ending}"
        write_maps([expected], path)
        assert formats_of(path) == [("map", ending)]
        (found,) = read_maps(path)
    assert_same(found, expected, covariances=covariances)


def test_several_maps(tmp_path: Path) -> None:
    """In one table, or in files of their own."""
    rng = np.random.default_rng(0)
    both = [estimate(rng, 2), estimate(rng, 2, robots=1)]
    write_maps(both, tmp_path / "map.csv")
    for found, expected in zip(read_maps(tmp_path / "map.csv"), both, strict=True):
        assert_same_values(found.values, expected.values)
    write_maps(both, tmp_path / "map.jrr")
    assert_same_values(read_maps(tmp_path / "map_part_2.jrr")[0].values, both[1].values)
    write_maps(both, tmp_path / "way.tum")
    assert sorted(p.name for p in tmp_path.glob("*.tum")) == ["way_Ada__the_1st.tum", "way_b.tum", "way_part_2.tum"]


@pytest.mark.parametrize("ending", ["g2o", "jrl"])
@given(generators, dims, st.booleans())
def test_the_edges_of_a_map_lead_to_the_map(ending: str, rng: np.random.Generator, dim: int, world: bool) -> None:
    """The vertices of its graph are its estimate; so is the optimum of its edges, with its covariances."""
    expected = estimate(rng, dim, world=world)
    with TemporaryDirectory() as folder:
        write_maps([expected], Path(folder) / f"map.{ending}")
        log = read(Path(folder) / f"map.{ending}")
    assert_same_values(log.initial, expected.values)
    layout = expected.values.layout
    system = System(layout, tables=log.tables, fixed=[] if world else [expected.base])
    solution = optimise(
        system, expected.values.retract(1e-3 * rng.normal(size=layout.dof)) if world else expected.values
    )
    assert solution.converged and solution.cost < 1e-15
    assert np.abs(solution.values.minus(expected.values)).max() < 1e-9
    found = Covariances(system.free, solution.information)
    for key, block in zip(layout.keys.tolist(), expected.covariances or (), strict=True):
        if key == expected.base:
            continue
        assert np.allclose(found.of(key), block, rtol=1e-6)


def test_points_in_space_of_robots_in_the_plane_are_seen_from_the_world() -> None:
    log = as_log(estimate(np.random.default_rng(0), 2, mixed=True))
    assert {(t.model, t.dim) for t in log.tables} == {("pose", 2), ("position", 3)}
    assert sum(map(len, log.tables)) == 8  # all but the base


@pytest.mark.parametrize("dim", [2, 3])
def test_gtsam_reads_the_graph(dim: int, tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    expected = estimate(np.random.default_rng(0), dim, robots=1, ticks=False)
    write_maps([expected], tmp_path / "map.g2o")
    graph, values = gtsam.readG2o(str(tmp_path / "map.g2o"), dim == 3)
    poses = expected.values.of_kind(pose_kind(dim))
    assert isinstance(poses, Pose)
    for key, rotation, place in zip(expected.values.layout.keys_of(pose_kind(dim)), poses.rotation, poses.translation,
                                    strict=True):  # fmt: skip
        name = int(key) & ((1 << 51) - 1)
        found = values.atPose2(name) if dim == 2 else values.atPose3(name)
        assert np.allclose(found.matrix()[:dim, :dim], rotation) and np.allclose(found.translation(), place)
    assert graph.size() >= 2
    for k in range(graph.size()):  # each edge is met by the vertices
        assert graph.at(k).error(values) == pytest.approx(0.0, abs=1e-12)


def test_gtsams_values_are_what_the_results_say(tmp_path: Path) -> None:
    """A reader of JRL makes gtsam's types of it; here by hand, as its format says."""
    gtsam = pytest.importorskip("gtsam")
    expected = estimate(np.random.default_rng(0), 3)
    write_maps([expected], tmp_path / "map.jrr")
    content = json.loads((tmp_path / "map.jrr").read_text())
    assert {"dataset_name", "method_name", "robots", "solutions"} <= set(content) and content["robots"] == ["a", "b"]
    values = gtsam.Values()
    for robot in content["robots"]:
        for value in content["solutions"][robot]:
            if value["type"] == "Pose3":
                turn = gtsam.Rot3.Quaternion(*value["rotation"])
                values.insert(value["key"], gtsam.Pose3(turn, np.array(value["translation"])))
            else:
                values.insert(value["key"], np.array([value["x"], value["y"], value["z"]]))
    for key, rotation in zip(expected.values.layout.keys_of(Kind.POSE3), _poses(expected).rotation, strict=True):
        robot, index = int(key) >> 51, int(key) & ((1 << 51) - 1)
        assert np.allclose(values.atPose3(gtsam.symbol("ab"[robot - 1], index)).rotation().matrix(), rotation)
    for key, place in zip(
        expected.values.layout.keys_of(Kind.POINT3), expected.values.of_kind(Kind.POINT3), strict=True
    ):
        assert np.allclose(values.atPoint3(gtsam.symbol("L", int(key))), place)


def _poses(found: MapEstimate) -> Pose:
    poses = found.values.of_kind(Kind.POSE3)
    assert isinstance(poses, Pose)
    return poses


def test_evo_reads_a_robots_way(tmp_path: Path) -> None:
    tools = pytest.importorskip("evo.tools.file_interface")
    expected = estimate(np.random.default_rng(0), 3, robots=1)
    write_maps([expected], tmp_path / "way.tum")
    theirs = tools.read_tum_trajectory_file(str(tmp_path / "way.tum"))
    assert np.allclose(theirs.positions_xyz, _poses(expected).translation)
    assert np.allclose([pose[:3, :3] for pose in theirs.poses_se3], _poses(expected).rotation)


def test_pandas_reads_the_table(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    expected = estimate(np.random.default_rng(0), 2)
    write_maps([expected], tmp_path / "map.csv")
    frame = pandas.read_csv(tmp_path / "map.csv")
    poses = frame[frame.landmark.isna()]
    assert np.allclose(poses[["x_m", "y_m", "heading_rad"]], expected.values.of_kind(Kind.POSE2).xytheta())  # type: ignore[union-attr]
    assert (poses.groupby("robot").stamp_s.diff().dropna() > 0).all()
    assert "door" in set(frame.landmark) and frame.columns[-1] == "cov_heading_heading"  # none that nobody uses


def test_a_format_is_told_by_the_ending_or_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"(?s)ending of this name says no format.*csv.*"):
        write_maps([estimate(np.random.default_rng(0), 2)], tmp_path / "map")
    write_maps([estimate(np.random.default_rng(0), 2)], tmp_path / "ways", "tum")
    assert sorted(p.name for p in (tmp_path / "ways").iterdir()) == ["Ada__the_1st.tum", "b.tum"]


def test_robots_whose_names_look_alike_have_files_of_their_own(tmp_path: Path) -> None:
    found = estimate(np.random.default_rng(0), 2)
    alike = MapEstimate(found.values, found.covariances, found.base, Names({1: "a/b", 2: "A_b"}))
    write_maps([alike], tmp_path / "way.tum")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["way_A_b_2.tum", "way_a_b.tum"]


@pytest.mark.parametrize("ending", ["g2o", "jrr"])
def test_a_robot_without_a_letter_is_refused_and_nothing_written(ending: str, tmp_path: Path) -> None:
    keys = pose_key(60, np.arange(2))
    values = Values.of({Kind.POSE2: (keys, random_poses(np.random.default_rng(0), 2, 2))})
    found = MapEstimate(values, (np.eye(3), np.eye(3)), WORLD)
    with pytest.raises(InputError, match=r"robot 60 has no letter.*; write a CSV"):
        write_maps([found], tmp_path / f"map.{ending}")
    assert list(tmp_path.iterdir()) == []


def test_covariances_that_do_not_fit() -> None:
    values = Values.of({Kind.POSE2: (pose_key(1, np.arange(2)), random_poses(np.random.default_rng(0), 2, 2))})
    with pytest.raises(ModelError, match="a covariance of each"):
        MapEstimate(values, (np.eye(3), np.eye(2)), WORLD)


def _good(folder: Path) -> str:
    write_maps([estimate(np.random.default_rng(0), 2)], folder / "good.csv")
    return (folder / "good.csv").read_text()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("pose2", "pose7"), "line 2, field 'kind': expected pose2, pose3, point2, point3, found 'pose7'"),
        (("pose2,2251", "pose2,x2251"), "field 'key': expected a whole number"),
        (("point2", "pose2"), "field 'heading_rad'"),
        (("component,", "part,"), "field 'component': no such column"),
    ],
)
def test_damage_is_named(change: tuple[str, str], problem: str, tmp_path: Path) -> None:
    text = _good(tmp_path)
    path = tmp_path / "bad.csv"
    path.write_text(text.replace(*change))
    with pytest.raises(InputError) as caught:
        table.read(path)
    assert problem in str(caught.value)


@given(st.data())
def test_nothing_but_a_map_or_an_error_comes_out(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    good = _good(folder)
    found = survives(table.read, folder / "map.csv", data.draw(damaged_text(good)))
    assert found is None or isinstance(found, list)
    write_maps([estimate(np.random.default_rng(0), 2)], folder / "good.jrr")
    text = json.dumps(json.loads((folder / "good.jrr").read_text()), indent=1)
    found = survives(jrr.read, folder / "map.jrr", data.draw(damaged_text(text)))
    assert found is None or isinstance(found, list)


def test_every_format_of_maps_is_tested() -> None:
    written = {name for name, row in MAP_FORMATS.items() if row.writes}
    assert written == {
        "g2o",
        "jrl",
        "jrr",
        "tum",
        "csv",
        "rrd",
        "foxglove",
        "geojson",
        "kml",
        "ply",
        "yaml",
        "ros",
        "wpilib",
    }
    assert {name for name, row in MAP_FORMATS.items() if row.reads} == {"jrr", "csv", "tum", "truth"}
    assert csv and pack
