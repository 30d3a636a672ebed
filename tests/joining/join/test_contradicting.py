"""Rows with which a join has no optimum cost nobody the map: they are left out with the reason, the rest is mapped."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.errors import SolveError
from teamslam.joining import build, join, split
from teamslam.joining.join.account import CONTRADICT, FORGIVE, accounted
from teamslam.joining.join.join import _fallen_apart
from teamslam.model import Dataset, Loss
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.solver.optimise import DEFAULTS

MISREAD = Robot(landmarks=Sensor("range_bearing", outliers=0.3), robots=Sensor("range_bearing", outliers=0.5))


def misread(seed: int) -> Dataset:
    """A small team of which so many sightings are wrong that squared losses have no optimum."""
    return simulate(Options(space="2d", robots=2, poses=20, landmarks=6, team=(MISREAD,)), seed)


@pytest.mark.parametrize("seed", [6, 7, 10, 11])
def test_rows_without_an_optimum_are_left_out_and_the_rest_is_mapped(seed: int) -> None:
    log = misread(seed)
    submaps = [build(piece) for piece in split(log)]
    found = accounted(log, join(submaps))
    assert found.converged and {r for m in found.maps for r in m.robots} == {1, 2}
    lost = [one for one in found.left_out if one.reason.startswith(CONTRADICT)]
    assert lost and all(one.kind == "rows" and one.reason == CONTRADICT + FORGIVE for one in lost)
    for table in log.tables:
        held = [m.rows_of(table) for m in found.maps] + [one.rows.rows_of(table) for one in found.left_out]
        np.testing.assert_array_equal(np.sum(held, 0), 1)


def test_the_map_is_that_of_the_rest() -> None:
    submaps = [build(piece) for piece in split(misread(7))]
    found = join(submaps)
    aside = {(t.robot, t.kind): t.ids for t in found.map.raw}
    kept = [replace(s, raw=tuple(t.select(~np.isin(t.ids, aside[t.robot, t.kind])) for t in s.raw)) for s in submaps]
    rest = join([replace(s, raw=tuple(t for t in s.raw if len(t))) for s in kept], near=found)
    np.testing.assert_allclose(rest.map.values.minus(found.map.values), 0.0, atol=1e-4)
    assert rest.map.cost == pytest.approx(found.map.cost, rel=1e-6) and rest.map.rows == found.map.rows


def test_nobody_is_sent_to_a_loss_that_is_there_already() -> None:
    log = misread(7)
    found = accounted(log, join([build(piece) for piece in split(log)]))
    assert any(FORGIVE in one.reason for one in found.left_out)
    forgiving = log.with_loss(Loss("huber"))
    assert not any(FORGIVE in one.reason for one in accounted(forgiving, join(map(build, split(forgiving)))).left_out)


def test_submaps_without_a_map_together_are_maps_by_halves() -> None:
    submaps = [build(piece) for piece in split(simulate("2d", 1))]
    found = _fallen_apart(submaps, SolveError("why"), DEFAULTS, None)
    members = [name for _, component in found for name in component.members]
    assert sorted(members) == sorted(s.id for s in submaps) and len(found) > 1
    assert found[0][0] == "" and found[1][0].endswith("why") and all(c.map.dof for _, c in found)
