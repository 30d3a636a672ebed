"""Scenes for rerun and Foxglove: their own libraries read back the poses, places and regions that the map has."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from estimates import estimate
from strategies import dims, generators
from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io import MapEstimate, write_maps
from teamslam.io.maps.space import ball, balls
from teamslam.model import Names, chi2_quantile, is_landmark, is_pose, robot_of


@given(generators, dims)
def test_a_ball_holds_what_it_should(rng: np.random.Generator, dim: int) -> None:
    """Each point on it is as far from the middle, in sigmas, as the region of 95 % reaches; its axes are a rotation."""
    root = np.zeros((3, 3))
    root[:dim, :dim] = rng.normal(size=(dim, dim)) + 2.0 * np.eye(dim)
    covariance = root @ root.T
    half, axes = ball(covariance[None], np.array([dim]))
    np.testing.assert_allclose(np.linalg.det(axes[0]), 1.0)
    ways = rng.normal(size=(20, 3))
    ways[:, : 3 - dim] = 0.0  # along the axis that is flat there is nothing
    surface = (ways / np.linalg.norm(ways, axis=-1, keepdims=True)) * half[0] @ axes[0].T
    far = np.einsum("ni,ij,nj->n", surface, np.linalg.pinv(covariance), surface)
    np.testing.assert_allclose(far, chi2_quantile(0.95, dim), rtol=1e-6)


def made(dim: int, ticks: bool) -> MapEstimate:
    """A map with a robot whose name has a comma, a space and a slash in it."""
    found = estimate(np.random.default_rng(dim), dim, ticks=ticks)
    names = Names({1: "Ada, the 1st/2", 2: "b"}, dict(found.names.landmarks), found.names.tick_s)
    return MapEstimate(found.values, found.covariances, found.base, names)


def expected(found: MapEstimate, robot: int) -> tuple[Array, Array, Array]:
    """Stamps, places and turns (w, x, y, z) of a robot."""
    keys = found.values.layout.keys
    own = np.sort(keys[is_pose(keys) & (robot_of(keys) == robot)])
    poses = found.values.poses_of(own, 3)
    return np.asarray(found.names.stamps_s(own)), poses.translation, poses.quaternion_wxyz()


def same_turns(found: Array, other: Array, atol: float) -> None:
    """Quaternions, either sign."""
    np.testing.assert_allclose(np.abs(np.sum(found * other, -1)), 1.0, atol=atol)


def landmarks(found: MapEstimate) -> tuple[list[str], Array]:
    """Names and places in space."""
    keys = found.values.layout.keys[is_landmark(found.values.layout.keys)]
    return [found.names.describe(key).removeprefix("landmark ") for key in keys.tolist()], found.values.positions(
        keys, 3
    )


@pytest.mark.parametrize("ticks", [True, False])
@pytest.mark.parametrize("dim", [2, 3])
def test_rerun_reads_what_was_written(tmp_path: Path, dim: int, ticks: bool) -> None:
    """In 32 bits, with the stamps on the timeline to the nanosecond, and as many ellipsoids as landmarks."""
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    found = made(dim, ticks)
    write_maps([found], tmp_path / "map.rrd")
    chunks: dict[str, list[Any]] = {}
    for chunk in RrdReader(str(tmp_path / "map.rrd")).stream():
        chunks.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    robots = sorted(path for path in chunks if path.startswith("/map/robots/"))
    assert len(robots) == 2
    for robot, path in enumerate(robots, start=1):
        stamps, places, turns = expected(found, robot)
        moving = next(batch for batch in chunks[path] if column(batch, "Transform3D:translation"))
        time = "pose" if found.names.counts else "time"
        recorded = np.array(moving.column(time).cast("int64").to_pylist(), float)
        np.testing.assert_allclose(recorded * (1.0 if found.names.counts else 1e-9), stamps, rtol=1e-9)
        np.testing.assert_allclose(numbers(moving, "Transform3D:translation"), places, rtol=1e-6, atol=1e-6)
        same_turns(np.roll(numbers(moving, "Transform3D:quaternion"), 1, -1), turns, 1e-6)
    names, places = landmarks(found)
    (points,) = (batch for batch in chunks["/map/landmarks"])
    np.testing.assert_allclose(numbers(points, "Points3D:positions"), places, rtol=1e-6, atol=1e-6)
    assert list(np.ravel(points.column(column(points, "Points3D:labels")).to_pylist())) == names
    (regions,) = (batch for batch in chunks["/map/regions"])
    np.testing.assert_allclose(
        numbers(regions, "Ellipsoids3D:half_sizes"), balls(found).half_axes, rtol=1e-5, atol=1e-6
    )


def column(batch: Any, name: str) -> str:
    """The full name of a component's column; '' where the batch has none."""
    return next((field for field in batch.schema.names if name in field), "")


def numbers(batch: Any, name: str) -> Array:
    """A component's vectors, of all rows, one after another."""
    rows = batch.column(column(batch, name)).to_pylist()
    return np.array([vector for row in rows for vector in row], float)


@pytest.mark.parametrize("ticks", [True, False])
@pytest.mark.parametrize("dim", [2, 3])
def test_foxglove_reads_what_was_written(tmp_path: Path, dim: int, ticks: bool) -> None:
    """Through the readers of MCAP and protobuf, by the schemas that stand in the file."""
    pytest.importorskip("foxglove")
    decoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    from mcap.reader import make_reader

    found = made(dim, ticks)
    write_maps([found], tmp_path / "map.mcap")
    messages: dict[str, list[tuple[int, Any]]] = {}
    with (tmp_path / "map.mcap").open("rb") as file:
        for schema, channel, message, decoded in make_reader(file, decoder_factories=[decoder]).iter_decoded_messages():
            assert schema is not None and schema.name.startswith("foxglove.")
            messages.setdefault(channel.topic, []).append((message.log_time, decoded))
    for robot in (1, 2):
        stamps, places, turns = expected(found, robot)
        rows = messages[f"/robots/{found.names.robot(robot)}"]
        np.testing.assert_allclose([time * 1e-9 for time, _ in rows], stamps, rtol=1e-9)
        moves = [move for _, move in rows]
        assert {move.parent_frame_id for move in moves} == {"map"}
        got = [[move.translation.x, move.translation.y, move.translation.z] for move in moves]
        np.testing.assert_allclose(got, places, atol=1e-12)
        quaternions = [[m.rotation.w, m.rotation.x, m.rotation.y, m.rotation.z] for m in moves]
        same_turns(np.array(quaternions), turns, 1e-12)
    ((_, scene),) = messages["/landmarks"]
    names, places = landmarks(found)
    assert [entity.texts[0].text for entity in scene.entities] == names
    spheres = [entity.spheres[0] for entity in scene.entities]
    middles = [[s.pose.position.x, s.pose.position.y, s.pose.position.z] for s in spheres]
    np.testing.assert_allclose(middles, places, atol=1e-12)
    sizes = [[s.size.x, s.size.y, s.size.z] for s in spheres]
    np.testing.assert_allclose(sizes, 2.0 * balls(found).half_axes, atol=1e-12)
    ((_, ways),) = messages["/ways"]
    assert [len(entity.lines[0].points) for entity in ways.entities] == [3, 3]


@pytest.mark.parametrize("name", ["map.rrd", "map.mcap"])
def test_maps_without_covariances_and_several(tmp_path: Path, name: str) -> None:
    """A file each; a map of which only the places are known has a scene, too."""
    pytest.importorskip("rerun" if name.endswith("rrd") else "foxglove")
    found = made(3, True)
    write_maps([found, MapEstimate(found.values, None, found.base, found.names)], tmp_path / name)
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [Path(name).suffix] * 2


def test_a_stamp_before_time_is_refused(tmp_path: Path) -> None:
    """Foxglove counts nanoseconds from 1970 in a number without sign."""
    pytest.importorskip("foxglove")
    from teamslam.geometry import Pose
    from teamslam.io.maps.foxglove_mcap import _checked
    from teamslam.io.maps.space import Course

    with pytest.raises(InputError, match="found -1"):
        _checked([Course("a", (0, 0, 0), np.array([-1.0]), Pose.identity(3, (1,)))])
