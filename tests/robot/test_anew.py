"""A robot's own submaps, linearised where the map has them."""

import numpy as np
import pytest

from teamslam.joining import full, join, split
from teamslam.model import Dataset
from teamslam.robot import Atlas, anew
from worlds import WORLDS, team


def rows_of(world: str) -> Dataset:
    log = team(world, robots=1, poses=60, landmarks=12, sees=0.5, sigma=0.05, sigma_odometry=0.05)
    return log.with_tables(table for table in log.tables if not table.observes_robots)


def atlas_of(log: Dataset) -> Atlas:
    atlas = Atlas()
    for number, piece in enumerate(split(log, poses_per_piece=15)):
        atlas = atlas.with_stretch(number, 0, [piece], int(piece.pose_keys[1][-1]))
    return atlas.in_short()


def off(atlas: Atlas, log: Dataset) -> float:
    """How far its map is from the full least squares, in sigmas of the combination of variables that is worst off."""
    best = full(log).map
    joined = atlas.joined
    assert joined is not None and joined.map.base == best.base
    keys = joined.map.values.layout.keys
    shift = joined.map.values.minus(best.values.only(keys))
    return float(np.sqrt(shift @ (joined.map.information @ shift)))


@pytest.mark.parametrize("world", WORLDS)
def test_linearised_anew_until_nothing_moves_it_is_the_full_least_squares(
    world: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for what its least is off by where rotations bend on the way there: of second order in that way."""
    monkeypatch.setattr(anew, "FAR", 0.0)
    log = rows_of(world)
    atlas = atlas_of(log)
    for _ in range(6):
        atlas = atlas.anew()
    assert off(atlas, log) < 1e-3


@pytest.mark.parametrize("world", WORLDS)
def test_once_is_most_of_the_way_and_what_is_sent_stays_as_it_is(world: str) -> None:
    log = rows_of(world)
    before = atlas_of(log)
    after = before.anew()
    assert off(after, log) < 0.2 * off(before, log)
    assert after.submaps == before.submaps and after.stretches is before.stretches


def test_where_the_rows_are_not_at_hand_submaps_stay_as_they_were_built() -> None:
    log = rows_of("2d")
    built = atlas_of(log)
    atlas = Atlas(built.stretches).in_short()
    assert atlas.anew() is atlas
    expected = join(built.submaps).map
    assert atlas.joined is not None
    keys = atlas.joined.map.values.layout.keys
    np.testing.assert_allclose(atlas.joined.map.values.state, expected.values.only(keys).state, atol=1e-6)
