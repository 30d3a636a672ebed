"""Fewer sightings of robots: the first of each pair stays, what goes is counted, all else is untouched."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from teamslam.errors import InputError
from teamslam.frontend.thin import keyframe
from teamslam.model import Table
from worlds import team

LOG = team("2d", robots=3, poses=13, every=1)


def sightings(tables: tuple[Table, ...]) -> list[Table]:
    return [t for t in tables if t.source == "robots"]


def test_every_third_sighting_of_each_pair_is_kept() -> None:
    thinned = keyframe(LOG, every=3)
    for whole, table in zip(sightings(LOG.tables), sightings(thinned.tables), strict=True):
        assert_array_equal(table.ids, whole.ids[::3])
        assert_array_equal(table.keys, whole.keys[::3])
    assert thinned.dropped[-1].count == sum(len(a) - len(b) for a, b in zip(LOG.tables, thinned.tables, strict=True))
    assert "one in 3" in thinned.dropped[-1].reason


def test_nothing_but_sightings_of_robots_goes() -> None:
    thinned = keyframe(LOG, every=5)
    for whole, table in zip(LOG.tables, thinned.tables, strict=True):
        if whole.source != "robots":
            assert table is whole


@pytest.mark.parametrize("interval", [0.0, 1.0, 2.0, 4.5, 100.0])
def test_sightings_kept_are_at_least_so_long_apart_and_none_is_missing_that_could_be(interval: float) -> None:
    thinned = keyframe(LOG, min_interval_s=interval)
    for whole, table in zip(sightings(LOG.tables), sightings(thinned.tables), strict=True):
        times = LOG.names.stamps_s(table.keys[:, 0])
        assert (np.diff(times) >= interval).all()
        every = LOG.names.stamps_s(whole.keys[:, 0])
        for time in every:
            assert (np.abs(times - time) < max(interval, 0.5)).any()


def test_what_changes_nothing_gives_the_dataset_back() -> None:
    assert keyframe(LOG, every=1) is LOG


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ({}, "either"),
        ({"every": 2, "min_interval_s": 1.0}, "not both"),
        ({"every": 0}, "one in 0 .* 1 keeps all"),
        ({"min_interval_s": -1.0}, "-1 s apart"),
    ],
)
def test_rules_that_make_no_sense_are_refused(rule: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        keyframe(LOG, **rule)
