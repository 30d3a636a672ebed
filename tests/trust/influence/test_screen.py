"""What counting and one step promise of a map without a robot, beside that map."""

import pytest

from teamslam.joining import build, join, split
from teamslam.model import Submap
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import stretched
from teamslam.solver import Options as Solving
from teamslam.trust.influence.liars import fit_of, robot
from teamslam.trust.influence.parts import BENDS, Problem, freed, tied

SPACES = ("2d", "planar", "3d")


@pytest.mark.parametrize("lies", [False, True])
@pytest.mark.parametrize("space", SPACES)
def test_the_rest_costs_no_less_than_a_step_says(space: str, lies: bool) -> None:
    """And where all is honest, it is that step and half as much again."""
    log = simulate(Options(space=space, robots=4), 4)
    submaps = [build(piece) for piece in split(stretched(log, 2, 1.1) if lies else log)]
    problem = Problem.of(submaps, join(submaps).map)
    for gone in log.robots:
        rest = problem.rest(lambda submap, gone=gone: robot(submap) != gone)
        if rest is None:
            continue
        cost = rest.cost(Solving())
        assert rest.least() <= cost * (1.0 + 1e-9)
        if not lies:
            step = rest.problem.system.cost(rest.problem.values) - cost
            assert rest.least() == pytest.approx(cost - (BENDS - 1.0) * step, rel=0.02, abs=0.1)


def dof_of_join(submaps: list[Submap]) -> int:
    """What joining leaves to spare."""
    return fit_of(join(submaps)).dof


@pytest.mark.parametrize("poses_per_piece", [None, 15])
@pytest.mark.parametrize("space", SPACES)
def test_counting_says_what_goes_with_each_robot(space: str, poses_per_piece: int | None) -> None:
    """As many as a join of the others has fewer to spare, and where these may fall apart, no more."""
    log = simulate(Options(space=space, robots=4, poses=40), 3)
    submaps = [build(piece) for piece in split(log, poses_per_piece=poses_per_piece)]
    counted = freed(submaps, robot)
    assert counted.keys() == set(log.robots)
    for gone, dof in counted.items():
        rest = [submap for submap in submaps if robot(submap) != gone]
        brings = dof_of_join(submaps) - dof_of_join(rest)
        assert dof in (0, brings)
        assert dof or not tied(rest)


def test_what_travels_raw_is_not_counted_twice() -> None:
    """Rows that speak of others' landmarks, and wait, make the count no larger than it is."""
    log = simulate(Options(space="2d", robots=3, poses=40, team=(Robot(landmarks=Sensor("bearing")),)), 5)
    submaps = [build(piece) for piece in split(log, poses_per_piece=10)]
    assert any(submap.raw for submap in submaps)
    for gone, dof in freed(submaps, robot).items():
        rest = [submap for submap in submaps if robot(submap) != gone]
        assert 0 <= dof <= dof_of_join(submaps) - dof_of_join(rest)
