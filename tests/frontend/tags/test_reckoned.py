"""Numbers that stand on two walls are told apart by the way that was driven between them; what stands still is not."""

from dataclasses import replace

import numpy as np
import pytest

import tagged_room
import teamslam as ts
from teamslam.frontend.tags.reckoned import _Reckoning, places_by_way
from teamslam.io.bags.team import _by_visits, _together
from teamslam.model import index_of, is_landmark


def log_of(room, folder, **noise):
    return ts.read(tagged_room.write(room, folder, **noise))


def by_robot(log, robot):
    """Its sightings of landmarks, and its way."""
    mine = [t for t in log.tables if t.robot == robot]
    return [t for t in mine if t.source == "landmarks"], [t for t in mine if t.source == "odometry"]


def renamed(log, number, twin):
    """The sightings of one robot, those of `twin` called by the other's number."""
    tables, way = by_robot(log, 1)
    keys = [np.where(t.keys == keyed(log, twin), keyed(log, number), t.keys) for t in tables]
    truly = np.concatenate([t.keys[:, 1] == keyed(log, twin) for t in tables])
    return [replace(t, keys=k) for t, k in zip(tables, keys, strict=True)], way, truly


def keyed(log, number):
    return next(k for k in log.landmark_keys.tolist() if int(index_of(k)) == number)


@pytest.mark.parametrize("seed", range(3))
def test_a_number_on_two_walls_is_told_apart_within_a_minute(tmp_path, seed):
    """Tag 2 of the opposite wall is called 0: each sighting goes to the place where it truly was."""
    log = log_of(tagged_room.make(seed, 30.0, 3.0), tmp_path, seed=seed)
    tables, way, truly = renamed(log, 0, 2)
    by_way = places_by_way(tables, way)
    found = _together(by_way, _by_visits(tables, by_way))
    assert {place.tag for place in found} == {keyed(log, 0)} and len(found) == 2
    ticks = np.concatenate([index_of(t.keys[:, 0]) for t in tables])
    called = np.concatenate([t.keys[:, 1] for t in tables]) == keyed(log, 0)
    sides = [{bool(t) for tick, t in zip(ticks[called], truly[called], strict=True)
              if any(a <= tick <= b for a, b in place.visits)} for place in found]  # fmt: skip
    assert sorted(map(tuple, sides)) == [(False,), (True,)]


@pytest.mark.parametrize("seed", range(4))
def test_nobody_is_accused_where_tags_stand_still(tmp_path, seed):
    """Not by odometry's noise as stated, nor with twice as much, nor with edges that are a tenth larger than stated."""
    log = log_of(tagged_room.make(seed, 60.0, 2.0), tmp_path, seed=seed, odometry_noise=1.0 + seed % 2)
    for robot in (1, 2):
        tables, way = by_robot(log, robot)
        assert places_by_way(tables, way) == []
        larger = [replace(t, values=np.concatenate([t.values[:, :12], 1.1 * t.values[:, 12:]], 1)) for t in tables]
        assert places_by_way(larger, way) == []


def test_two_sightings_elsewhere_are_misreads_and_no_place(tmp_path):
    log = log_of(tagged_room.make(0, 30.0, 3.0), tmp_path)
    tables, way = by_robot(log, 1)
    (table,) = tables
    odd = np.flatnonzero(table.keys[:, 1] == keyed(log, 2))[:2]
    keys = table.keys.copy()
    keys[odd, 1] = keyed(log, 0)
    assert places_by_way([replace(table, keys=keys)], way) == []


def test_nothing_is_told_without_odometry(tmp_path):
    log = log_of(tagged_room.make(0, 30.0, 3.0), tmp_path)
    tables, _, _ = renamed(log, 0, 2)
    assert places_by_way(tables, []) == [] and is_landmark(tables[0].keys[:, 1]).all()


def test_a_place_seen_after_a_way_spreads_as_stated(tmp_path):
    """Four thousand ways by the noise of their steps: where each has a tag that is seen at its end."""
    log = log_of(tagged_room.make(0, 20.0, 2.0), tmp_path)
    _, (way,) = by_robot(log, 1)
    way, rng, seen = way.select(np.arange(15)), np.random.default_rng(0), np.array([3.0, 1.0, 0.5])
    reckoning = _Reckoning.of(way)
    root = np.linalg.inv(way.whitening)
    x = np.zeros((4000, 3))
    for value, spread in zip(way.values, root, strict=True):
        step = value[:2] + (noise := rng.normal(size=(4000, 3)) @ spread.T)[:, :2]
        c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
        turn = np.arctan2(value[4], value[2])
        x = x + np.stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1], turn + noise[:, 2]], 1)
    c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
    places = x[:, :2] + np.stack([c * seen[0] - s * seen[1], s * seen[0] + c * seen[1]], 1)
    stated = reckoning.spread(0, 15, reckoning.poses[15:].act(seen[None])[0])
    found = np.sqrt(np.linalg.eigvalsh(np.cov(places.T))[-1])
    assert abs(found / stated - 1.0) < 0.06  # of 4,000: 1.1 % one sigma, and turns are not small


def test_a_misread_just_before_a_tag_is_seen_again_makes_no_place_of_it(tmp_path):
    """Long after a tag was seen, the way between explains a sighting far off; what comes then is of where it stood."""
    log = log_of(tagged_room.make(0, 60.0, 3.0), tmp_path)
    tables, way = by_robot(log, 1)
    (table,) = tables
    slow = [replace(t, whitening=0.05 * t.whitening) for t in way]  # little is known of the way: much is explained
    for number in range(8):
        own = np.flatnonzero(table.keys[:, 1] == keyed(log, number)) if number in marks_of(log) else np.zeros(0, int)
        for again in own[np.flatnonzero(np.diff(table.keys[own, 0]) > 5e6) + 1].tolist():
            before = np.flatnonzero(
                (table.keys[:, 0] < table.keys[again, 0]) & (table.keys[:, 1] != table.keys[again, 1])
            )
            keys = table.keys.copy()
            keys[before[-1], 1] = keyed(log, number)
            assert places_by_way([replace(table, keys=keys)], way) == []
            assert places_by_way([replace(table, keys=keys)], slow) == []


def marks_of(log):
    return {int(index_of(k)) for k in log.landmark_keys}
