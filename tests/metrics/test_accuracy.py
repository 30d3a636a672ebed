"""Errors of maps: zero at the truth, the same in any frame, one alignment for the whole team; evo as oracle."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metrics_maps import TEAMS, at_base, frame_dim, map_of, small, some_frame
from teamslam.geometry import Pose
from teamslam.metrics import Report, align_team, errors_at_base, score
from teamslam.model import Kind, Submap, Values, is_landmark, is_pose, landmark_key, pose_key, robot_of
from teamslam.sim import simulate


def rough(dataset, scale: float = 0.05, seed: int = 0) -> Submap:  # type: ignore[no-untyped-def]
    """A map with errors of some size in everything."""
    n = map_of(dataset).dof
    return map_of(dataset, scale * np.random.default_rng(seed).standard_normal(n))


def numbers_of(report: Report) -> list[float]:
    """All numbers in a report's dictionary, in order."""

    def walk(x: object) -> list[float]:
        if isinstance(x, dict):
            return [n for v in x.values() for n in walk(v)]
        if isinstance(x, list):
            return [n for v in x for n in walk(v)]
        return [float(x)] if isinstance(x, (int, float)) and not isinstance(x, bool) else []

    return walk(report.to_dict())


@pytest.mark.parametrize("team", TEAMS)
def test_the_truth_has_no_error(team: str) -> None:
    """score(truth, truth) = 0, all of it."""
    dataset = small(team)
    assert dataset.truth is not None
    report = score(map_of(dataset), dataset.truth)
    scored = report.accuracy
    assert scored is not None and report.basis == "robots and landmarks"
    errors = [scored.robot_position_rmse_m, scored.robot_turn_rmse_rad, scored.landmark_rmse_m]
    errors += list(vars(scored.per_number).values())
    errors += [x for r in scored.robots for x in (r.position_rmse_m, r.ate_rmse_m, r.rpe_rmse_m, r.rpe_rmse_rad)]
    errors += [x for p in scored.pairs for x in (p.position_rmse_m, p.turn_rmse_rad)]
    assert np.allclose(np.array(errors, float), 0.0, atol=1e-7)
    assert report.nees_per_dof == pytest.approx(0.0, abs=1e-12)
    assert errors_at_base(map_of(dataset), dataset.truth).state == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("team", TEAMS)
@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_moving_the_truth_as_a_whole_changes_nothing(team: str, seed: int) -> None:
    """Errors, NEES and bands are the same in any frame of the truth."""
    dataset = SMALL[team]
    moved = dataset.truth.transform(some_frame(frame_dim(dataset), np.random.default_rng(seed)))
    submap = ROUGH[team]
    assert np.allclose(numbers_of(score(submap, dataset.truth)), numbers_of(score(submap, moved)), rtol=1e-6, atol=1e-7)


SMALL = {team: small(team) for team in TEAMS}
ROUGH = {team: rough(dataset) for team, dataset in SMALL.items()}


@pytest.mark.parametrize("team", TEAMS)
def test_one_alignment_for_the_whole_team(team: str) -> None:
    """A robot that is perfect in itself but in the wrong place is wrong: ATE and RPE do not see it, the score does."""
    dataset = small(team)
    base, values = at_base(dataset)
    stray = values.layout.keys[is_pose(values.layout.keys) & (robot_of(values.layout.keys) == 3)]
    shift = np.zeros(frame_dim(dataset) + 1 + 2 * (frame_dim(dataset) == 3))
    shift[0] = 1.0
    frame = Pose.from_tangent(shift, frame_dim(dataset))
    moved = values.update(values.only(stray).transform(frame))
    submap = replace(map_of(dataset), values=moved.select(moved.layout.keys != base))
    scored = score(submap, dataset.truth).accuracy
    by_robot = {r.robot: r for r in scored.robots}
    assert by_robot["3"].ate_rmse_m < 1e-6 and by_robot["3"].rpe_rmse_m < 1e-6
    assert by_robot["3"].position_rmse_m > 0.5 and scored.robot_position_rmse_m > 0.3
    pairs = {p.robots: p for p in scored.pairs}
    assert pairs["1", "3"].position_rmse_m == pytest.approx(1.0) and pairs["1", "2"].position_rmse_m < 1e-6


def test_rmse_of_numbers_and_of_distances_by_hand() -> None:
    """Two poses and two landmarks of the plane, in the frame of the first pose, with errors one can add up."""
    first, second = pose_key(1, np.array([0, 1_000_000]))
    marks = landmark_key(np.array([0, 1]))
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    truth = Values.of(
        {
            Kind.POSE2: (np.array([first, second]), Pose.from_xytheta(places)),
            Kind.POINT2: (marks, np.array([[0.0, 2.0], [3.0, 0.0]])),
        }
    )
    template = map_of(small("2d"))
    estimate = truth.select(truth.layout.keys != first).retract(np.array([0.1, 0.0, 0.2, 0.0, 0.3, 0.0, 0.0]))
    submap = replace(template, base=int(first), values=estimate, information=template.information[:7][:, :7])
    found = errors_at_base(submap, truth)
    assert found.robot_pose == pytest.approx(np.sqrt((0.01 + 0.04) / 3.0))
    assert found.landmark == pytest.approx(np.sqrt(0.09 / 4.0))
    assert found.state == pytest.approx(np.sqrt((0.01 + 0.04 + 0.09) / 7.0))


def test_per_number_after_alignment_agrees_with_its_parts() -> None:
    """In the plane: state^2 is the mean of squares over x, y, heading of poses and x, y of landmarks."""
    dataset = small("2d")
    scored = score(rough(dataset), dataset.truth).accuracy
    poses = sum(len(keys) for keys in dataset.pose_keys.values())
    marks = len(dataset.landmark_keys)
    of_poses = poses * (scored.robot_position_rmse_m**2 + scored.robot_turn_rmse_rad**2)
    of_marks = marks * scored.landmark_rmse_m**2
    assert scored.per_number.robot_pose == pytest.approx(np.sqrt(of_poses / (3 * poses)))
    assert scored.per_number.landmark == pytest.approx(np.sqrt(of_marks / (2 * marks)))
    assert scored.per_number.state == pytest.approx(np.sqrt((of_poses + of_marks) / (3 * poses + 2 * marks)))


@pytest.mark.parametrize("team", TEAMS)
def test_tracks_are_the_errors_that_the_rmse_averages(team: str) -> None:
    """Over time, robot by robot, in seconds."""
    dataset = small(team)
    report = score(rough(dataset), dataset.truth)
    for robot, track in zip(report.accuracy.robots, report.tracks, strict=True):
        assert np.array_equal(track.stamps_s, np.arange(8.0))
        assert np.sqrt(np.mean(track.position_m**2)) == pytest.approx(robot.position_rmse_m)
        assert np.sqrt(np.mean(track.turn_rad**2)) == pytest.approx(robot.turn_rmse_rad)


# --- truths that know only a part -------------------------------------------------------------------------------------


def test_landmarks_alone_align_the_team() -> None:
    """A survey of the landmarks, nothing about robots."""
    dataset = small("planar")
    truth = dataset.truth.select(is_landmark(dataset.truth.layout.keys))
    report = score(rough(dataset), truth)
    assert report.basis == "landmarks" and report.robot_position_rmse_m is None and report.landmark_rmse_m > 0.0
    assert report.accuracy.robots == () and report.accuracy.pairs == () and report.tracks == ()
    assert report.consistency.frame == "fitted"
    assert json.dumps(report.to_dict(), allow_nan=False)


def test_positions_alone_leave_headings_unscored() -> None:
    """A truth of points for robots: GPS antennas, say."""
    dataset = small("2d")
    keys = dataset.truth.layout.keys
    truth = Values.of({Kind.POINT2: (keys, dataset.truth.positions(keys, 2))})
    report = score(rough(dataset), truth)
    assert report.robot_position_rmse_m == pytest.approx(score(rough(dataset), dataset.truth).robot_position_rmse_m)
    assert report.accuracy.robot_turn_rmse_rad is None and np.isnan(report.tracks[0].turn_rad).all()
    assert json.dumps(report.to_dict(), allow_nan=False)


def test_nothing_in_common_is_said_in_words() -> None:
    """All null, with a note."""
    dataset = small("planar")
    report = score(map_of(dataset), Values.of({Kind.POINT3: (landmark_key(np.array([999])), np.zeros((1, 3)))}))
    assert report.accuracy is None and report.consistency is None and "none of the map's variables" in report.note
    assert report.to_dict()["robot_position_rmse_m"] is None and report.note in str(report)


@pytest.mark.parametrize("team", ["2d", "3d"])
def test_a_truth_that_leaves_the_map_free_to_turn_scores_nothing(team: str) -> None:
    """One landmark in the plane, two in space: any error would be an accident."""
    dataset = small(team)
    marks = dataset.landmark_keys[: 1 if team == "2d" else 2]
    report = score(rough(dataset), dataset.truth.only(marks))
    assert report.accuracy is None and "free to turn" in report.note


def test_a_straight_way_in_space_is_held_by_its_orientations() -> None:
    """Positions in one line leave the roll about it open; orientations do not."""
    dataset = small("3d")
    keys = dataset.pose_keys[1]
    line = Pose(np.tile(np.eye(3), (8, 1, 1)), np.arange(8.0)[:, None] * np.array([1.0, 0.0, 0.0]))
    truth = Values.of({Kind.POSE3: (keys, line)})
    submap = replace(
        map_of(dataset),
        values=Values.of({Kind.POSE3: (keys[1:], line[1:])}),
        information=map_of(dataset).information[:42][:, :42],
    )
    moved = truth.transform(some_frame(3, np.random.default_rng(1)))
    report = score(submap, moved)
    assert "orientations" in report.basis and report.accuracy.robot_turn_rmse_rad < 1e-6


def test_a_planar_map_is_scored_on_the_shadow_of_a_truth_in_space() -> None:
    """Motion capture gives height and tilt; a map of the ground has neither."""
    dataset = small("2d")
    keys = np.concatenate(list(dataset.pose_keys.values()))
    marks = dataset.landmark_keys
    lifted = dataset.truth.poses_of(keys, 3)
    high = Pose(lifted.rotation, lifted.translation + np.array([0.0, 0.0, 0.7]))
    above = dataset.truth.positions(marks, 3) + np.array([0.0, 0.0, 1.0])
    truth = Values.of({Kind.POSE3: (keys, high), Kind.POINT3: (marks, above)})
    submap = rough(dataset)
    flat, spatial = score(submap, dataset.truth), score(submap, truth)
    assert np.allclose(numbers_of(flat), numbers_of(spatial), atol=1e-9)


# --- evo as an independent oracle -------------------------------------------------------------------------------------


def evo_path(values: Values, keys: np.ndarray):  # type: ignore[no-untyped-def]
    """A trajectory as evo has it."""
    trajectory = pytest.importorskip("evo.core.trajectory")
    poses = values.poses_of(keys, 3)
    return trajectory.PoseTrajectory3D(poses.translation, poses.quaternion_wxyz(), np.arange(len(keys), dtype=float))


@pytest.mark.parametrize("team", ["2d", "planar", "3d"])
def test_ate_and_rpe_are_those_of_evo(team: str) -> None:
    """Robot by robot: ATE after a rigid alignment without scale; RPE over consecutive poses."""
    metrics = pytest.importorskip("evo.core.metrics")
    dataset = simulate(team, 2)
    submap = rough(dataset)
    for found, keys in zip(score(submap, dataset.truth).accuracy.robots, dataset.pose_keys.values(), strict=True):
        true, estimate = evo_path(dataset.truth, keys), evo_path(submap.all_values, keys)
        rpe = {}
        for relation in (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_rad):
            measure = metrics.RPE(relation, delta=1, delta_unit=metrics.Unit.frames)
            measure.process_data((true, estimate))
            rpe[relation] = measure.get_statistic(metrics.StatisticsType.rmse)
        assert found.rpe_rmse_m == pytest.approx(rpe[metrics.PoseRelation.translation_part], rel=1e-9)
        assert found.rpe_rmse_rad == pytest.approx(rpe[metrics.PoseRelation.rotation_angle_rad], rel=1e-6)
        estimate.align(true)
        ate = metrics.APE(metrics.PoseRelation.translation_part)
        ate.process_data((true, estimate))
        assert found.ate_rmse_m == pytest.approx(ate.get_statistic(metrics.StatisticsType.rmse), rel=1e-9)


@pytest.mark.parametrize("team", ["2d", "3d"])
def test_the_teams_alignment_is_umeyamas(team: str) -> None:
    """Over all robots and landmarks together."""
    geometry = pytest.importorskip("evo.core.geometry")
    dataset = simulate(team, 2)
    submap = rough(dataset)
    keys, dim = dataset.truth.layout.keys, 2 if team == "2d" else 3
    rotation, translation, _ = geometry.umeyama_alignment(
        submap.all_values.positions(keys, dim).T, dataset.truth.positions(keys, dim).T
    )
    found = align_team(submap, dataset.truth)
    assert np.allclose(found.pose.rotation, rotation) and np.allclose(found.pose.translation, translation)


@pytest.mark.parametrize("team", TEAMS)
def test_a_report_is_json_and_a_table(team: str) -> None:
    """For scripts without NaN, for people with names and units."""
    report = score(rough(small(team)), small(team).truth)
    assert json.loads(json.dumps(report.to_dict(), allow_nan=False)) == report.to_dict()
    text = str(report)
    for words in ("one alignment of the whole team", "robot position RMSE", "landmark RMSE", "NEES / dof", "ATE m"):
        assert words in text


@pytest.mark.parametrize("team", ["3d", "tags"])
def test_landmarks_whose_height_the_truth_does_not_say_count_by_x_and_y(team: str) -> None:
    """The map of the truth itself has no error where some landmarks are surveyed from above, and nobody is named."""
    dataset = small(team)
    map, truth = map_of(dataset), dataset.truth
    marks = truth.layout.keys[is_landmark(truth.layout.keys)]
    flat = marks[::2]
    places = truth.positions(flat, 3)
    assert np.ptp(places[:, 2]) > 0.5
    rest = truth.select(~np.isin(truth.layout.keys, flat))
    known = rest.update(Values.of({Kind.POINT2: (flat, places[:, :2])}))
    report = score(map, known)
    scored = report.accuracy
    assert scored is not None and scored.landmarks == len(marks)
    assert scored.robot_position_rmse_m == pytest.approx(0.0, abs=1e-7)
    assert scored.landmark_rmse_m == pytest.approx(0.0, abs=1e-7)
    only = truth.select(np.isin(truth.layout.keys, np.setdiff1d(marks, flat)))
    alone = align_team(map, only.update(Values.of({Kind.POINT2: (flat, places[:, :2])})))
    assert alone is not None and np.abs(alone.positions(flat)).max() < 1e-7
