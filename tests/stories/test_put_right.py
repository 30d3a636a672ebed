"""A log that is put right where its map is not at an optimum."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions
from teamslam.errors import SolveError
from teamslam.joining import AtMap, Component, Joined
from teamslam.model import Loss, Submap, pose_key
from teamslam.pipeline.clock import Clock
from teamslam.pipeline.mending import carrying_errors, once_more
from teamslam.pipeline.story import Result
from teamslam.solver import Covariances, Options, Status
from trust.calibration.faulty import long_steps, team

METHOD = Config(method="full", loss=Loss("cauchy", 1.0))


@pytest.fixture(scope="module")
def run() -> Result:
    """The map of three robots whose steps are too long, under a loss that forgives."""
    result = ts.run(long_steps(team(0, poses=60)), METHOD)
    assert result.calibration is not None and result.calibration.systematic
    return result


def away(component: Component, far: float) -> Submap:
    """The map of a component so many sigmas away from its optimum."""
    map = component.map
    sigmas = np.sqrt(np.diag(np.linalg.inv(map.information.toarray())))
    return replace(map, values=map.values.retract(far * sigmas * np.random.default_rng(1).normal(size=map.dof)))


def test_a_map_that_is_not_at_an_optimum_has_covariances(run: Result) -> None:
    """Its information is of elsewhere, where a loss forgave more; with what rows say of systematic errors where it is,
    that would be of no map."""
    assert run.calibration is not None
    right = run.calibration.put_right(run.dataset.with_loss(METHOD.loss))
    component = ts.full(right).components[0]
    elsewhere = AtMap(right.tables, away(component, 300.0)).renewed
    map = replace(component.map, information=elsewhere.information)
    assert component.solution is not None
    ended = replace(component.solution, status=Status.INEXACT)
    carries, _ = carrying_errors(Joined((replace(component, map=map, solution=ended),)), run.calibration, right)
    assert carries.map.dof > map.dof and len(Covariances.of_map(carries.map).all)


def test_where_no_search_ends_the_map_as_stated_stays(run: Result) -> None:
    """One step is not enough for the map of submaps, nor for that of full least squares."""
    log = run.dataset.with_loss(METHOD.loss)
    component = ts.full(log).components[0]
    joined = Joined((replace(component, map=away(component, 100.0)),))
    lame = Config(join=JoinOptions(exact=True, max_rounds=1), solver=Options(max_iterations=1, elsewhere=False))
    assert run.calibration is not None and joined.converged
    with pytest.raises(SolveError, match="no optimum was found"):
        once_more(log, lame, run.calibration, (), [ts.build(p) for p in ts.split(log)], joined, Clock(None))


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_pose_that_stood_by_is_said_to_have(method: Literal["join", "full"]) -> None:
    """The map of the log put right is sought from the first map, in which it is not."""
    log = long_steps(team(0, poses=60))
    seen = next(t for t in log.tables if t.source == "landmarks")
    lone = pose_key(1, 10_000)
    keys, ids = np.array([[lone, seen.keys[0, 1]]]), np.array([seen.ids.max() + 1])
    stray = replace(seen.select(np.arange(1)), keys=keys, ids=ids)
    result = ts.run(log.with_tables([*log.tables, stray]), Config(method=method))
    assert result.calibration is not None and result.calibration.systematic
    (lost,) = result.joined.left_out
    assert lost.keys.tolist() == [lone] and "placed by others" in lost.reason
