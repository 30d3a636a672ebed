"""Landmarks on one level with all who range them: as wide as their ranges say, in the map and not lost."""

import numpy as np
import pytest

from teamslam.config import Config, JoinOptions
from teamslam.geometry import Pose
from teamslam.joining import full
from teamslam.joining.start.blunt import SOURCE, Blunt, blunt, with_levels
from teamslam.model import Dataset, Table, landmark_key, pack, pose_key
from teamslam.pipeline import run
from teamslam.sim import Options, Robot, Sensor, simulate

METHODS = {
    "join": Config(calibrate=False),
    "exact": Config(join=JoinOptions(exact=True), calibrate=False),
    "full": Config(method="full", calibrate=False),
}
DOOR = landmark_key(0)


def fleet(seed: int, height_m: float = 0.1) -> Dataset:
    """Two robots of the plane and five beacons hardly above their antennas."""
    beacons, eyes = Sensor(model="range", sigma_m=0.1, range_m=8.0), Sensor(model="relative_pose", every=3)
    team = (Robot(landmarks=beacons, robots=eyes),)
    return simulate(Options(space="planar", robots=2, poses=40, landmarks=5, height_m=height_m, team=team), seed)


def along_a_line(beside_m: float, sigma_m: float = 0.05, sure: float = 1e5) -> Dataset:
    """A robot that knows where it is drives along x, and ranges a beacon ahead of it without error."""
    x = np.linspace(0.0, 6.0, 13)
    keys = np.array([pose_key(1, n) for n in range(len(x))])
    poses = Pose(np.tile(np.eye(2), (len(x), 1, 1)), np.stack([x, 0.0 * x], -1))
    beacon = np.array([9.0, beside_m])
    ranges = np.linalg.norm(poses.translation - beacon, axis=-1)[:, None]
    ids = np.arange(len(x))
    return Dataset(
        {1: 2},
        (
            Table(1, "prior", "pose", 2, keys[:, None], pack(poses), sure * np.eye(3)[None], ids),
            Table(1, "odometry", "relative_pose", 2, np.stack([keys[:-1], keys[1:]], -1),
                  pack(poses[:-1].between(poses[1:])), np.eye(3)[None], ids[:-1]),
            Table(1, "landmarks", "range", 2, np.stack([keys, np.full(len(x), DOOR)], -1), ranges,
                  np.array([[[1.0 / sigma_m]]]), ids),
        ),
    )  # fmt: skip


def found_in(log: Dataset) -> list[Blunt]:
    return blunt(log, full(log).map)


@pytest.mark.parametrize("sigma_m", [0.01, 0.05])
def test_it_is_as_wide_as_what_its_ranges_tell(sigma_m: float) -> None:
    """The variance beside the line, by integrating over all places where the beacon may be: .956 of what is stated."""
    log = along_a_line(0.0, sigma_m)
    (one,) = found_in(log)
    ahead, beside = np.meshgrid(np.linspace(-1, 1, 801) * 12 * sigma_m + 9.0, np.linspace(-1, 1, 801) * 5 * one.sigma_m)
    x = np.linspace(0.0, 6.0, 13)
    misfit = sum(((np.hypot(ahead - at, beside) - (9.0 - at)) / sigma_m) ** 2 for at in x)
    weight = np.exp(-0.5 * misfit)
    variance = float(np.sum(weight * beside**2) / np.sum(weight))
    assert one.sigma_m**2 * 0.956 == pytest.approx(variance, rel=0.02)
    assert abs(one.across) == pytest.approx([0.0, 1.0], abs=1e-4) and one.place == pytest.approx([9.0, 0.0], abs=1e-3)


def test_a_beacon_well_beside_the_line_is_told_to_first_order() -> None:
    assert found_in(along_a_line(2.0)) == []


def test_what_is_unsure_of_the_way_is_no_range_s_own() -> None:
    (sure,), (unsure,) = found_in(along_a_line(0.0, 0.02)), found_in(along_a_line(0.0, 0.02, sure=20.0))
    assert unsure.sigma_m > 1.5 * sure.sigma_m


def test_its_row_costs_nothing_and_counts_across_alone() -> None:
    log = along_a_line(0.0)
    whole = full(log).map
    found = blunt(log, whole)
    (row,) = [t for t in with_levels(log, found, whole.all_values).tables if t.source == SOURCE]
    values = whole.all_values.update(run(with_levels(log, found, whole.all_values), METHODS["full"]).map.all_values)
    assert np.abs(row.whitened(values)).max() < 1e-3
    assert row.ranks.tolist() == [1]


@pytest.mark.parametrize("method", METHODS)
def test_beacons_as_high_as_antennas_are_in_the_map(method: str) -> None:
    """Known in the plane as well as any, and in height to what second order tells; no row is left out."""
    log = fleet(0)
    found = run(log, METHODS[method])
    said = [remark for remark in found.joined.remarks if "to second order alone" in remark]
    assert said and all("its height" in remark and "come from one level" in remark for remark in said)
    assert not found.joined.left_out and len(found.map.landmark_keys) == 5
    for key in found.map.landmark_keys.tolist():
        sigmas = np.sqrt(np.diag(found.covariances[0].of(key)))
        assert sigmas.max() < 1.0 and sigmas[:2].max() < 0.2
        assert found.truth is not None
    assert 0.6 < found.scores[0].nees_per_dof < 1.6


def test_exact_joining_is_full_least_squares() -> None:
    exact, whole = (run(fleet(0), METHODS[name]) for name in ("exact", "full"))
    assert exact.joined.remarks == whole.joined.remarks
    assert exact.costs[0] is not None and whole.costs[0] is not None
    assert exact.costs[0].cost == pytest.approx(whole.costs[0].cost, rel=1e-6)
