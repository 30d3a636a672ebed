"""What one step promises of a map without a robot, beside that map."""

import pytest

from teamslam.joining import build, join, split
from teamslam.model import robot_of
from teamslam.sim import Options, simulate
from teamslam.sim.faults import stretched
from teamslam.solver import Options as Solving
from teamslam.trust.influence.parts import BENDS, Problem

SPACES = ("2d", "planar", "3d")


@pytest.mark.parametrize("lies", [False, True])
@pytest.mark.parametrize("space", SPACES)
def test_the_rest_costs_no_less_than_a_step_says(space: str, lies: bool) -> None:
    """And where all is honest, it is that step and half as much again."""
    log = simulate(Options(space=space, robots=4), 4)
    submaps = [build(piece) for piece in split(stretched(log, 2, 1.1) if lies else log)]
    problem = Problem.of(submaps, join(submaps).map)
    for robot in log.robots:
        rest = problem.rest(lambda submap, gone=robot: int(robot_of(submap.base)) != gone)
        if rest is None:
            continue
        cost = rest.cost(Solving())
        assert rest.least() <= cost * (1.0 + 1e-9)
        if not lies:
            step = rest.system.cost(rest.values) - cost
            assert rest.least() == pytest.approx(cost - (BENDS - 1.0) * step, rel=0.02, abs=0.1)
