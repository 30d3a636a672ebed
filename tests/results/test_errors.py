"""The truth is brought into the frame of the map, and errors are measured there."""

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.geometry import Pose, concatenate
from teamslam.model import Kind, Sources, Submap, Values, landmark_key, pose_key
from teamslam.pipeline import Result
from teamslam.results.errors import error_tracks, truth_by_team
from teamslam.solver import Covariances


def moved(values: Values, dim: int) -> Values:
    """The same things in some other frame."""
    frame = [3.0, -2.0, 0.7] if dim == 2 else [3.0, -2.0, 1.0, 0.1, -0.2, 0.7]
    return values.transform(Pose.from_tangent(np.array(frame), dim))


def test_a_truth_in_any_frame_comes_home(result: Result) -> None:
    """If the truth is the map written in another frame, it is the map again, and all errors vanish."""
    submap = result.map
    home = truth_by_team(submap, moved(submap.all_values, submap.base_dim))
    np.testing.assert_allclose(home.minus(submap.all_values), 0.0, atol=1e-9)
    tracks = error_tracks(submap, moved(submap.all_values, submap.base_dim), result.covariances[0]).tracks
    assert len(tracks) == len(result.dataset.robots)
    for track in tracks:
        np.testing.assert_allclose(track.error, 0.0, atol=1e-9)
        np.testing.assert_allclose(track.nees, 0.0, atol=1e-9)


def test_errors_and_bands_are_those_of_the_map(result: Result) -> None:
    """A known shift of the estimate is the error that is told, and sigma the root of the marginal's diagonal."""
    submap = result.map
    rng = np.random.default_rng(2)
    delta = 0.01 * rng.standard_normal(submap.dof)
    truth = submap.all_values.update(submap.values.retract(-delta))
    covariances = Covariances.of_map(submap)
    for track, robot in zip(
        error_tracks(submap, truth, covariances).tracks, sorted(result.dataset.robots), strict=True
    ):
        keys = submap.trajectory_keys(robot)
        keys = keys[keys != submap.base]
        expected = submap.values.only(keys).minus(truth.only(keys)).reshape(len(keys), -1)
        np.testing.assert_allclose(track.error, expected, atol=1e-9)
        for row, key in enumerate(keys.tolist()):
            block = covariances.of(key)
            np.testing.assert_allclose(track.sigma[row], np.sqrt(np.diag(block)), rtol=1e-9)
            e = expected[row]
            assert track.nees[row] == pytest.approx(e @ np.linalg.inv(block) @ e / len(e), rel=1e-6, abs=1e-12)


def test_where_no_pose_is_known_there_is_no_track(result: Result) -> None:
    """Truth of landmarks alone gives no errors along the way."""
    truth = result.dataset.truth
    assert truth is not None
    marks = truth.only(result.dataset.landmark_keys)
    assert error_tracks(result.map, marks, result.covariances[0]).tracks == []


def test_a_map_without_the_truth_of_its_base_is_compared_by_the_whole_team(result: Result) -> None:
    """There are tracks all the same, with the errors after alignment."""
    submap, truth = result.map, result.dataset.truth
    assert truth is not None
    tracks = error_tracks(submap, truth.select(truth.layout.keys != submap.base), result.covariances[0])
    assert len(tracks.tracks) == len(result.dataset.robots) and "after one alignment" in tracks.frame
    assert max(float(np.abs(t.error).max()) for t in tracks.tracks) < 0.5


def test_the_truth_of_landmarks_with_a_turn_of_which_only_the_place_is_known_comes_home() -> None:
    """Tags that a survey has as points, in a map that has them as poses; a place without its height is none of them."""
    rng = np.random.default_rng(3)
    robots, tags = pose_key(1, np.arange(6)), landmark_key(np.arange(4))
    poses, faces = (Pose.from_tangent(rng.normal(size=(n, 6)), 3) for n in (6, 4))
    values = Values.of({Kind.POSE3: (np.concatenate([robots, tags]), concatenate([poses, faces]))})
    base = int(robots[0])
    seen = values.seen_from(values.pose(base), values.layout)
    known = seen.select(seen.layout.keys != base)
    submap = Submap("one", 0, base, 3, known, sp.eye_array(known.layout.dof, format="csr"), Sources())
    survey = {Kind.POSE3: (robots, poses), Kind.POINT3: (tags[:3], faces.translation[:3])}
    flat = Values.of({Kind.POINT2: (tags[3:], faces.translation[3:, :2])})
    home = truth_by_team(submap, Values.of(survey))
    np.testing.assert_allclose(home.positions(tags[:3], 3), submap.all_values.positions(tags[:3], 3), atol=1e-9)
    assert not truth_by_team(submap, Values.of(survey).update(flat)).layout.contains(tags[3:]).any()
