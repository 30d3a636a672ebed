"""Depths in a log: rows that agree with the truth, maps that know more by them, and unknowns that move them as well."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

import clocks_room
from teamslam.config import Config
from teamslam.io.bags.team_file import StatedClock, Unsure
from teamslam.pipeline import run
from teamslam.sim.film import PRESETS

LINE_S = PRESETS["experiment"].shutter.line_s
SURE = Unsure(delay_s=0.0)


@pytest.fixture(scope="module", params=[11, 12])
def log(request):
    return filmed(request.param, SURE, StatedClock(offset_sigma_s=0.0, drift_sigma=0.0))


def filmed(seed, sigma, clock, seconds=24.0, line_s=LINE_S):
    planted = clocks_room.Planted(line_s=line_s)
    seen, file, _ = clocks_room.filmed(seed, seconds, 2.0, planted, preset="experiment", deep=True)
    team = []
    for robot in seen:
        camera = msgspec.structs.replace(robot.entry.camera[0], sigma=sigma)
        entry = msgspec.structs.replace(robot.entry, camera=[camera], clock=clock, truth_in_time=True)
        team.append(replace(robot, entry=entry, views=(replace(robot.views[0], entry=camera),)))
    return clocks_room.read(team, msgspec.structs.replace(file, robot=[robot.entry for robot in team]))


def deep(log):
    return [table for table in log.tables if table.source.endswith("_depth")]


def test_rows_agree_with_the_truth_within_their_sigmas(log):
    """Three numbers each: chi-square, but for tags behind the other robot, of which this detector knows nothing."""
    seen = [table.select(table.told_by(log.truth.layout)) for table in deep(log)]
    squares = np.concatenate([np.sum(table.whitened(log.truth) ** 2, -1) for table in seen])
    assert len(squares) > 40 and all((table.ranks == 3).all() for table in seen)
    assert 1.6 < np.median(squares) < 3.4  # 2.37
    assert np.mean(squares > 7.81) < 0.15  # 0.05


def test_a_slow_shutter_twists_no_plane():
    """Lines of a tag that are read a hundredth of a second apart, by robots that turn and drive meanwhile."""
    log = filmed(11, SURE, StatedClock(offset_sigma_s=0.0, drift_sigma=0.0), line_s=1e-4)
    seen = [table.select(table.told_by(log.truth.layout)) for table in deep(log)]
    squares = np.concatenate([np.sum(table.whitened(log.truth) ** 2, -1) for table in seen])
    assert 1.6 < np.median(squares) < 2.7  # 2.37
    assert np.mean(squares > 7.81) < 0.15  # 0.05


def test_each_depth_is_of_a_sighting(log):
    for table in deep(log):
        (corners,) = [t for t in log.tables if (t.robot, f"{t.source}_depth") == (table.robot, table.source)]
        at = np.searchsorted(corners.ids, table.ids)
        assert np.array_equal(corners.keys[at], table.keys) and len(table) > 0.9 * len(corners)


def test_a_map_with_depths_knows_more_and_is_as_sure_as_it_should_be(log):
    without = log.with_tables(table for table in log.tables if not table.source.endswith("_depth"))
    known = [run(each, Config(method="full")) for each in (log, without)]
    sigmas = [np.sqrt(np.diagonal(each.covariances[0].joint(each.map.landmark_keys))) for each in known]
    share = sigmas[0] / sigmas[1]  # another optimum, and a loss that forgives, may leave a little more in one direction
    assert share.max() < 1.05 and share.mean() < 0.97
    one, other = (each.scores[0].consistency.nees.per_dof for each in known)
    assert 0.7 < one < min(1.3, other + 0.1)


@pytest.mark.slow
def test_cameras_move_depths_as_reading_again_does():
    """Where they are, how they are turned, how long their lenses are; by clocks the keyframes would be others."""
    unsure = Unsure(delay_s=0.0, xyz_m=0.02, rotation_rad=0.03, focal=0.01)
    unknowns = filmed(11, unsure, StatedClock(offset_sigma_s=0.0, drift_sigma=0.0), 16.0).unknowns
    assert len(unknowns.each) == 14
    for k, one in enumerate(unknowns.each):
        values = unknowns.values.copy()
        values[k] += 10.0 * one.step
        varied = [t for t in unknowns.varied(values) if t.source.endswith("_depth")]
        again = {(t.robot, t.kind): t for t in deep(unknowns.again(values))}
        assert {t.source for t in varied} == {"landmarks_depth", "robots_depth"} and len(varied) == 2
        for table in varied:
            other = again[table.robot, table.kind]
            assert np.array_equal(table.ids, other.ids)
            e = table.whitening @ table.row.minus(table.values, other.values, 3)[..., None]
            assert np.abs(e).max() < 2e-2 and table.sensor.minus(other.sensor) == pytest.approx(0.0)


@pytest.mark.slow
def test_a_late_camera_is_found_with_depths_too():
    """Rows of depth are moved in time as corners are: what a latency that is stated wrongly does to both agrees."""
    unsure = Unsure(delay_s=0.01)
    log = filmed(12, unsure, StatedClock(offset_sigma_s=0.0, drift_sigma=0.0))
    found = run(log, Config(method="full")).unknowns
    for one in found.found:
        assert one.unknown.name == "latency" and abs(one.value) < 4.0 * one.sigma + 1e-3
