"""Maps for other programs, read by readers that are not ours: of JSON, XML, YAML, recordings; PLY by its header."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import damaged_text, survives
from estimates import estimate
from strategies import dims, generators
from teamslam.errors import InputError
from teamslam.geometry import Anchor, Array, Pose
from teamslam.io import MAP_FORMATS, MapEstimate, formats_of, read_maps, write_maps
from teamslam.io.maps import tum
from teamslam.model import WORLD, Kind, Names, index_of, is_landmark, is_pose, robot_of

HERE = Anchor(52.0116, 4.3571, 2.0, 30.0)
KML = "{http://www.opengis.net/kml/2.2}"


def ways(found: MapEstimate) -> dict[str, Array]:
    """Where each robot was, by its name."""
    keys = np.sort(found.values.layout.keys)
    return {
        found.names.robot(robot): found.values.positions(keys[is_pose(keys) & (robot_of(keys) == robot)], 3)
        for robot in found.robots
    }


def marks(found: MapEstimate) -> dict[str, Array]:
    """Where each landmark is, by its name."""
    keys = np.sort(found.values.layout.keys[is_landmark(found.values.layout.keys)])
    return {found.names.landmark(int(index_of(key))): found.values.positions(np.array(key), 3) for key in keys}


def on_map(coordinates: Sequence[Sequence[float]]) -> Array:
    return HERE.local(np.array(coordinates)[:, [1, 0, 2]])


def inside(outline: Array, centre: Array, covariance: Array) -> Array:
    """Squared distances of an outline from its centre, in sigmas."""
    off = outline[:, :2] - centre[:2]
    return np.einsum("ni,ni->n", off, np.linalg.solve(covariance[:2, :2], off.T).T)


@given(generators, dims, st.booleans())
def test_geojson_holds_places_on_the_earth(rng: np.random.Generator, dim: int, mixed: bool) -> None:
    expected = estimate(rng, dim, mixed=mixed)
    with TemporaryDirectory() as folder:
        write_maps([expected], Path(folder) / "map.geojson", anchor=HERE)
        content = json.loads((Path(folder) / "map.geojson").read_text(encoding="utf-8"))
    assert content["type"] == "FeatureCollection"
    found: dict[str, dict[str, list]] = {"robot": {}, "landmark": {}, "region": {}}
    for feature in content["features"]:
        found[feature["properties"]["kind"]][feature["properties"]["name"]] = feature["geometry"]["coordinates"]
    for name, way in ways(expected).items():
        assert np.abs(on_map(found["robot"][name]) - way).max() < 2e-4
    layout = expected.values.layout
    blocks = {expected.names.landmark(int(key)): expected.covariances[layout.index(key)]  # type: ignore[index]
              for key in layout.keys[is_landmark(layout.keys)].tolist()}  # fmt: skip
    for name, place in marks(expected).items():
        assert np.abs(on_map([found["landmark"][name]]) - place).max() < 2e-4
        (ring,) = found["region"][name]
        assert ring[0] == ring[-1]
        assert inside(on_map(ring), place, blocks[name]) == pytest.approx(5.991, rel=1e-2)
        xy = np.array(ring)[:, :2]
        assert np.sum(xy[:-1, 0] * xy[1:, 1] - xy[1:, 0] * xy[:-1, 1]) > 0  # anticlockwise, as RFC 7946 wants it


@given(generators, dims)
def test_kml_holds_the_same_places(rng: np.random.Generator, dim: int) -> None:
    expected = replace(estimate(rng, dim), names=Names({1: "<a&b>", 2: "b\x07"}, {}, 1e-6))
    with TemporaryDirectory() as folder:
        write_maps([expected], Path(folder) / "map.kml", anchor=HERE)
        root = ElementTree.parse(Path(folder) / "map.kml").getroot()
    robots, landmarks, regions = root.findall(f"{KML}Document/{KML}Folder")
    assert len(regions) - 1 == len(landmarks) - 1 == 3
    for way, mark in zip(ways(expected).values(), robots.findall(f"{KML}Placemark"), strict=True):
        rows = mark.findtext(f"{KML}LineString/{KML}coordinates", "").split()
        assert np.abs(on_map([[float(n) for n in row.split(",")] for row in rows]) - way).max() < 2e-4
    assert [mark.findtext(f"{KML}name") for mark in robots.findall(f"{KML}Placemark")] == ["<a&b>", "b\\x07"]


@given(generators, dims, st.booleans())
def test_ply_has_the_places_and_ellipsoids_of_the_map(rng: np.random.Generator, dim: int, mixed: bool) -> None:
    expected = estimate(rng, dim, mixed=mixed)
    with TemporaryDirectory() as folder:
        write_maps([expected], Path(folder) / "map.ply")
        head, body = (Path(folder) / "map.ply").read_text(encoding="utf-8").split("end_header\n")
    counts = {line.split()[1]: int(line.split()[2]) for line in head.splitlines() if line.startswith("element")}
    rows = [line.split() for line in body.splitlines()]
    vertices = np.array(rows[: counts["vertex"]], float)
    faces = np.array(rows[counts["vertex"] :][: counts["face"]], int)
    edges = np.array(rows[counts["vertex"] + counts["face"] :], int)
    assert (
        len(rows) == sum(counts.values()) and edges.max() < counts["vertex"] and faces[:, 1:].max() < counts["vertex"]
    )
    every = np.concatenate(list(ways(expected).values()))
    np.testing.assert_array_equal(vertices[vertices[:, 6] == 0, :3], every)
    centres = vertices[vertices[:, 6] == 1, :3]
    np.testing.assert_array_equal(centres, np.array(list(marks(expected).values())))
    meshes = vertices[vertices[:, 6] == 2, :3].reshape(len(centres), -1, 3)
    layout = expected.values.layout
    for mesh, centre, key in zip(meshes, centres, np.sort(layout.keys[is_landmark(layout.keys)]).tolist(), strict=True):
        block = expected.covariances[layout.index(key)]  # type: ignore[index]
        if len(block) == 3:
            off = mesh - centre
            squared = np.einsum("ni,ni->n", off, np.linalg.solve(block, off.T).T)
            assert squared == pytest.approx(7.815, rel=1e-3)  # chi-square of three, 95 %
        else:
            assert (mesh[:, 2] == 0.0).all() and inside(mesh, centre, block).max() == pytest.approx(5.991, rel=0.05)
    first = faces[: len(faces) // len(centres), 1:] - faces[:, 1:].min()
    sides = np.sort(np.concatenate([first[:, [0, 1]], first[:, [1, 2]], first[:, [2, 0]]]), 1)
    assert (np.unique(sides, axis=0, return_counts=True)[1] == 2).all()  # closed: every side belongs to two triangles


@pytest.mark.parametrize("reader", ["ruamel.yaml", "yaml"])
def test_yaml_is_read_by_every_reader_to_the_bit(reader: str, tmp_path: Path) -> None:
    parser = pytest.importorskip(reader)
    rng = np.random.default_rng(0)
    for dim, names in ((2, {}), (3, {1: 'a "b": #c', 2: "naïve ☃ 門\n", 3: "\x85\U0001f600"})):
        expected = estimate(rng, dim)
        numbers = np.sort(expected.values.layout.keys[is_landmark(expected.values.layout.keys)]).tolist()
        called = {n: names[k] for k, n in enumerate(numbers, 1) if k in names}
        tiny = tuple(1e-5 * block for block in expected.covariances or ())
        expected = replace(expected, names=Names({}, called, 1e-6), covariances=tiny)
        path = tmp_path / f"{dim}.yaml"
        write_maps([expected], path)
        text = path.read_text(encoding="utf-8")
        content = parser.safe_load(text) if reader == "yaml" else parser.YAML(typ="safe").load(text)
        assert [str(name) for name in content["landmarks"]] == list(marks(expected))
        for key, found in zip(numbers, content["landmarks"].values(), strict=True):
            assert found["position"] == expected.values.positions(np.array(key), dim).tolist()
            assert found["covariance"] == tiny[int(expected.values.layout.index(key))].tolist()


@pytest.mark.parametrize("dim", [2, 3])
def test_a_recording_is_played_to_ros(dim: int, tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    expected = estimate(np.random.default_rng(0), dim)
    write_maps([expected], tmp_path / "bag", "ros")
    assert [p.suffix for p in sorted((tmp_path / "bag").iterdir())] == [".mcap", ".yaml"]
    with highlevel.AnyReader([tmp_path / "bag"]) as bag:
        found = {c.topic: bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages()}
    assert set(found) == {"/teamslam/Ada__the_1st/path", "/teamslam/b/path", "/teamslam/landmarks"}
    keys = np.sort(expected.values.layout.keys)
    for robot, topic in ((1, "/teamslam/Ada__the_1st/path"), (2, "/teamslam/b/path")):
        own = keys[is_pose(keys) & (robot_of(keys) == robot)]
        poses = expected.values.poses_of(own, 3)
        path = found[topic]
        assert path.header.frame_id == "map" and len(path.poses) == len(own)
        for n, stamped in enumerate(path.poses):
            stamp = stamped.header.stamp.sec + 1e-9 * stamped.header.stamp.nanosec
            assert stamp == pytest.approx(float(expected.names.stamps_s(own[n])), abs=1e-6)
            p, q = stamped.pose.position, stamped.pose.orientation
            pose = Pose.from_quaternion(np.array([p.x, p.y, p.z]), np.array([q.w, q.x, q.y, q.z]))
            assert np.abs(pose.minus(poses[n])).max() < 1e-9
    markers = found["/teamslam/landmarks"].markers
    balls, names = markers[:3], markers[3:]
    numbers = {key: expected.names.landmark(key) for key in keys[is_landmark(keys)].tolist()}
    assert [m.text for m in names] == list(marks(expected))
    for ball, place in zip(balls, marks(expected).values(), strict=True):
        p, q, s = ball.pose.position, ball.pose.orientation, ball.scale
        assert [p.x, p.y, p.z] == pytest.approx(place.tolist())
        number = next(key for key, mark in numbers.items() if mark == names[ball.id].text)
        block = expected.covariances[int(expected.values.layout.index(number))]  # type: ignore[index]
        turn = Pose.from_quaternion(np.zeros(3), np.array([q.w, q.x, q.y, q.z])).rotation
        spread = turn @ np.diag((0.5 * np.array([s.x, s.y, s.z])) ** 2) @ turn.T / {2: 5.991, 3: 7.815}[dim]
        assert spread[:dim, :dim] == pytest.approx(block, rel=1e-2, abs=1e-5)


def test_names_that_make_one_topic_and_stamps_beyond_ros_are_told(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    found = estimate(np.random.default_rng(0), 2)
    with pytest.raises(InputError, match="make one topic of ROS, /teamslam/a_b/path"):
        write_maps([replace(found, names=Names({1: "a b", 2: "a-b"}))], tmp_path / "bag", "ros")
    with pytest.raises(InputError, match="ROS holds stamps"):
        write_maps([replace(found, names=Names({}, {}, 1e3))], tmp_path / "bag", "ros")
    assert list(tmp_path.iterdir()) == []


@given(generators, dims)
def test_trajectories_of_tum_read_back(rng: np.random.Generator, dim: int) -> None:
    expected = estimate(rng, dim)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "ways"
        path.mkdir()
        tum.write_trajectories(expected.values, expected.names, path)
        assert formats_of(path) == [("map", "tum")]
        (found,) = read_maps(path)
    assert found.base == WORLD and found.covariances is None
    assert {found.names.robot(robot) for robot in found.robots} == {"Ada__the_1st", "b"}
    keys = np.sort(expected.values.layout.keys[is_pose(expected.values.layout.keys)])
    poses = expected.values.poses_of(keys, 3)
    read = found.values.of_kind(Kind.POSE3)
    assert isinstance(read, Pose) and np.array_equal(np.sort(found.values.layout.keys), keys)
    assert np.abs(read.minus(poses)).max() < 1e-9


@given(st.data(), generators)
def test_damaged_trajectories_are_told(data: st.DataObject, rng: np.random.Generator) -> None:
    with TemporaryDirectory() as folder:
        tum.write_trajectories(estimate(rng, 2).values, Names({}, {}, 1e-6), folder)
        path = Path(folder) / "1.tum"
        survives(lambda file: read_maps(file, "tum"), path, data.draw(damaged_text(path.read_text(encoding="utf-8"))))


def test_an_anchor_goes_with_places_on_the_earth_and_with_nothing_else(tmp_path: Path) -> None:
    found = estimate(np.random.default_rng(0), 2)
    with pytest.raises(InputError, match="need an anchor"):
        write_maps([found], tmp_path / "map.kml")
    with pytest.raises(InputError, match="geojson and kml"):
        write_maps([found], tmp_path / "map.csv", anchor=HERE)
    assert list(tmp_path.iterdir()) == []


OURS = [name for name, row in MAP_FORMATS.items() if row.writes and name not in ("rrd", "foxglove", "wpilib")]


@pytest.mark.parametrize("name", OURS)
def test_every_format_takes_a_map_without_covariances_or_landmarks(name: str, tmp_path: Path) -> None:
    if name == "ros":
        pytest.importorskip("rosbags")
    full = estimate(np.random.default_rng(0), 2)
    bare = replace(full, covariances=None)
    poses = MapEstimate(full.values.select(is_pose(full.values.layout.keys)), None, full.base, full.names)
    for n, found in enumerate((bare, poses)):
        anchor = HERE if MAP_FORMATS[name].anchored else None
        write_maps([found], tmp_path / f"{n}{(*MAP_FORMATS[name].suffixes, '')[0]}", name, anchor=anchor)
    assert len(list(tmp_path.iterdir())) >= 2
