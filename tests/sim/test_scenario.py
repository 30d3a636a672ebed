"""Whole simulated teams: their noise is what they claim, their views are what they could see, seeds repeat."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.model import Dataset, Kind, is_landmark, is_pose, robot_of
from teamslam.sim import (
    PATHS,
    PRESETS,
    SPACES,
    Odometry,
    Options,
    PaperOptions,
    Robot,
    Sensor,
    World,
    observe,
    simulate,
)

SENSORS = ("point", "range_bearing", "bearing", "range", "relative_pose")


def whitened(dataset: Dataset) -> np.ndarray:
    """All residuals at the truth, in sigmas."""
    assert dataset.truth is not None
    return np.concatenate([t.whitened(dataset.truth).ravel() for t in dataset.tables])


@pytest.mark.parametrize("preset", PRESETS)
def test_residuals_at_the_truth_are_standard_normal(preset: str) -> None:
    """The laws by which data are made are those by which they are read: Kolmogorov-Smirnov and chi-square."""
    residuals = whitened(simulate(preset, 3))
    assert kstest(residuals, "norm").pvalue > 1e-3
    assert 1e-3 < chi2.cdf(np.sum(residuals**2), len(residuals)) < 1.0 - 1e-3


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("model", SENSORS)
def test_every_sensor_works_in_every_space(space: str, model: str) -> None:
    """For landmarks and for robots; tags make landmarks with an orientation."""
    kind = Robot(landmarks=Sensor(model), robots=Sensor(model, every=2))
    dataset = simulate(Options(space=space, poses=30, team=(kind,)), 5)
    residuals = whitened(dataset)
    assert 1e-3 < chi2.cdf(np.sum(residuals**2), len(residuals)) < 1.0 - 1e-3
    marks = dataset.layout.kinds[is_landmark(dataset.layout.keys)]
    of_world = SPACES[space][1]
    expected = Kind(of_world - 2) if model == "relative_pose" else Kind(of_world)
    assert (marks == expected).all() and {t.source for t in dataset.tables} == {"odometry", "landmarks", "robots"}


@pytest.mark.parametrize("preset", PRESETS)
def test_truth_is_that_of_the_variables_seen(preset: str) -> None:
    """Same keys, same kinds as the measurements speak of."""
    dataset = simulate(preset, 1)
    assert dataset.truth is not None
    assert np.array_equal(dataset.truth.layout.keys, dataset.layout.keys)
    assert np.array_equal(dataset.truth.layout.kinds, dataset.layout.kinds)


@pytest.mark.parametrize("preset", PRESETS)
def test_rows_are_numbered_once(preset: str) -> None:
    """No two rows of one robot's log of one source share a number."""
    seen: dict[tuple[int, str], list[int]] = {}
    for table in simulate(preset, 2).tables:
        seen.setdefault((table.robot, table.source), []).extend(table.ids.tolist())
    assert all(len(set(ids)) == len(ids) for ids in seen.values())


def same(a: Dataset, b: Dataset) -> bool:
    """Two datasets, to the bit."""
    return len(a.tables) == len(b.tables) and all(
        np.array_equal(x.keys, y.keys) and np.array_equal(x.values, y.values)
        for x, y in zip(a.tables, b.tables, strict=True)
    )


@pytest.mark.parametrize("preset", PRESETS)
def test_a_seed_repeats_and_another_differs(preset: str) -> None:
    """To the bit."""
    assert same(simulate(preset, 4), simulate(preset, 4))
    assert not same(simulate(preset, 4), simulate(preset, 5))


def test_a_world_seed_keeps_the_world_while_noise_changes() -> None:
    """Monte Carlo on one world."""
    first, second = (simulate(Options(world_seed=9), seed) for seed in (1, 2))
    assert first.truth is not None and second.truth is not None
    assert np.array_equal(first.truth.state, second.truth.state) and not same(first, second)


def test_spoiling_one_sensor_leaves_all_other_draws_alone() -> None:
    """So that with and without outliers compare, row by row."""
    clean, spoilt = (simulate(Options(team=(Robot(landmarks=Sensor(outliers=share)),)), 6) for share in (0.0, 0.2))
    for a, b in zip(clean.tables, spoilt.tables, strict=True):
        changed = (a.values != b.values).any(1)
        assert changed.mean() < 0.3 if a.source == "landmarks" else not changed.any()


@pytest.mark.parametrize("model", SENSORS)
@pytest.mark.parametrize("space", SPACES)
def test_outliers_come_in_their_share_and_within_range(model: str, space: str) -> None:
    """False alarms are measurements that the sensor could make."""
    sensor = Sensor(model, range_m=4.0, outliers=0.3, sigma_m=1e-3, sigma_rad=1e-3)
    dataset = simulate(Options(space=space, poses=80, team=(Robot(landmarks=sensor, robots=None),)), 8)
    tables = [t for t in dataset.tables if t.source == "landmarks"]
    assert dataset.truth is not None
    far = np.concatenate([np.sum(t.whitened(dataset.truth) ** 2, -1) > 50.0 for t in tables])
    assert 0.22 < far.mean() < 0.36
    if model in ("range", "range_bearing"):
        assert max(t.values[:, 0].max() for t in tables) < 4.0 + 0.01


def test_drop_outs_come_in_their_share() -> None:
    """A share of sightings is lost, odometry never."""
    kinds = (Robot(landmarks=Sensor(dropouts=share)) for share in (0.0, 0.4))
    full, lossy = (simulate(Options(poses=200, team=(kind,)), 7) for kind in kinds)
    counts = [sum(len(t) for t in d.tables if t.source == "landmarks") for d in (full, lossy)]
    assert 0.55 < counts[1] / counts[0] < 0.65
    assert [sum(len(t) for t in d.tables if t.source == "odometry") for d in (full, lossy)] == [597, 597]


@pytest.mark.parametrize("space", SPACES)
def test_views_are_all_that_is_in_range_and_field(space: str) -> None:
    """Against a plain search over all pairs."""
    sensor = Sensor("point", range_m=4.0, field_of_view_deg=100.0, mount_xyz_m=(0.2, 0.1, 0.0), mount_yaw_deg=30.0)
    dataset = simulate(Options(space=space, team=(Robot(landmarks=sensor, robots=None),)), 2)
    truth = dataset.truth
    assert truth is not None
    marks, dim = dataset.landmark_keys, SPACES[space][1]
    mount = sensor.mount(dim)
    assert mount is not None
    for robot, keys in dataset.pose_keys.items():
        found = {(int(a), int(b)) for t in dataset.of_robot(robot).tables[1:] for a, b in t.keys}
        for key in keys.tolist():
            seen = (truth.poses_of(np.array(key), dim) @ mount).unact(truth.positions(marks, dim))
            distance = np.linalg.norm(seen, axis=-1)
            there = (distance <= 4.0) & (seen[:, 0] >= np.cos(np.deg2rad(50.0)) * distance)
            assert {int(m) for m in marks[there]} == {b for a, b in found if a == key}


def test_robots_are_seen_at_the_same_instant_every_so_often() -> None:
    """Poses have common stamps; only every fifth is looked at."""
    dataset = simulate(Options(poses=100, period_s=0.5, team=(Robot(robots=Sensor("point", every=5)),)), 3)
    tables = [t for t in dataset.tables if t.source == "robots"]
    assert tables
    for table in tables:
        assert (robot_of(table.keys[:, 0]) == table.robot).all() and (robot_of(table.keys[:, 1]) != table.robot).all()
        stamps = dataset.names.stamps_s(table.keys)
        assert np.array_equal(stamps[:, 0], stamps[:, 1]) and np.allclose(stamps % 2.5, 0.0)


def test_unequal_robots_form_one_team() -> None:
    """On the ground and in the air, with sensors of their own, seeing each other in space."""
    scout = Robot(dim=3, landmarks=Sensor("bearing", mount_xyz_m=(0.0, 0.0, -0.1)))
    rover = Robot(dim=2, odometry=Odometry(0.1, 0.05), landmarks=Sensor("relative_pose"))
    dataset = simulate(Options(space="3d", robots=4, team=(rover, scout)), 1)
    assert dataset.robots == {1: 2, 2: 3, 3: 2, 4: 3}
    kinds = dataset.layout.kinds[is_pose(dataset.layout.keys)]
    assert set(kinds.tolist()) == {Kind.POSE2, Kind.POSE3}
    dims = {(t.robot, t.dim) for t in dataset.tables if t.source == "robots"}
    assert {(1, 2), (1, 3), (2, 3)} <= dims and (2, 2) not in dims


def test_robots_with_ways_of_different_length_meet_while_both_are_there() -> None:
    """A world of one's own, without any landmark."""
    line = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], -1)
    world = World({1: Pose.from_xytheta(line), 2: Pose.from_xytheta(line[:4] + 0.5)}, Pose.identity(2, (0,)))
    dataset = observe(world, dict.fromkeys((1, 2), Robot(landmarks=None, robots=Sensor("relative_pose"))), 0)
    assert [(t.robot, t.source, len(t)) for t in dataset.tables] == [
        (1, "odometry", 8),
        (1, "robots", 4),
        (2, "odometry", 3),
        (2, "robots", 4),
    ]


def test_a_large_team_is_no_trouble() -> None:
    """Ten robots, twenty thousand poses, a hundred thousand sightings; views go through a tree, not all pairs."""
    options = Options(robots=10, poses=2000, landmarks=1500)
    dataset = simulate(options, 0)
    assert sum(len(t) for t in dataset.tables) > 100_000
    residuals = whitened(dataset)
    assert abs(np.mean(residuals**2) - 1.0) < 5.0 * np.sqrt(2.0 / len(residuals))


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Options(space="4d"), "space"),
        (lambda: Options(path="teleport"), "path"),
        (lambda: Options(robots=0), "robots"),
        (lambda: Options(poses=1), "poses"),
        (lambda: Options(landmarks=-1), "landmarks"),
        (lambda: Options(side_m=0.0), "side_m"),
        (lambda: Options(step_m=float("nan")), "step_m"),
        (lambda: Options(period_s=1e-9), "period_s"),
        (lambda: Options(team=()), "team"),
        (lambda: Options(space="2d", team=(Robot(dim=3),)), "team"),
        (lambda: Robot(dim=4), "dim"),
        (lambda: Odometry(sigma_m=0.0), "sigma_m"),
        (lambda: Odometry(sigma_rad=-1.0), "sigma_rad"),
        (lambda: Sensor("sonar"), "model"),
        (lambda: Sensor("position"), "model"),
        (lambda: Sensor(sigma_m=-0.1), "sigma_m"),
        (lambda: Sensor(sigmas=(0.1, 0.0)), "sigmas"),
        (lambda: simulate(Options(space="2d", team=(Robot(landmarks=Sensor(sigmas=(0.1,))),))), "sigmas"),
        (lambda: Sensor(range_m=0.0), "range_m"),
        (lambda: Sensor(field_of_view_deg=400.0), "field_of_view_deg"),
        (lambda: Sensor(every=0), "every"),
        (lambda: Sensor(outliers=1.5), "outliers"),
        (lambda: Sensor(dropouts=-0.1), "dropouts"),
        (lambda: simulate(Options(space="2d", team=(Robot(landmarks=Sensor(mount_xyz_m=(0, 0, 1))),))), "mount_xyz_m"),
        (lambda: PaperOptions("generous"), "scenario"),
        (lambda: PaperOptions(poses=1), "poses"),
        (lambda: PaperOptions(sigma_observation=0.0), "sigma_observation"),
        (lambda: simulate("moon"), "preset"),
        (lambda: simulate(seed=-1), "seed"),
    ],
)
def test_options_that_make_no_sense_are_refused_by_name(make: object, field: str) -> None:
    """An InputError that names the option."""
    with pytest.raises(InputError) as caught:
        make()  # type: ignore[operator]
    assert caught.value.field == field


def test_every_path_is_an_option() -> None:
    """And gives a log."""
    for path in PATHS:
        assert len(simulate(Options(path=path, poses=10), 0).layout) > 30


def test_standard_deviations_can_be_given_one_by_one() -> None:
    """An instrument that is better sideways than ahead."""
    sensor = Sensor("point", sigmas=(0.5, 0.01))
    dataset = simulate(Options(space="2d", poses=200, team=(replace(Robot(), landmarks=sensor),)), 0)
    assert dataset.truth is not None
    off = np.concatenate([t.residual(dataset.truth) for t in dataset.tables if t.source == "landmarks"])
    assert np.allclose(off.std(0), [0.5, 0.01], rtol=0.1)
