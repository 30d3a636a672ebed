"""Maps that contradict each other: no way to put them together makes sense, and it takes few solves to know that."""

import sys
from math import log2

import pytest

from teamslam.joining import build, join, split
from teamslam.model import Submap, Values, robot_of
from teamslam.solver import Options, Solution, System, optimise
from teamslam.trust.labels.constellations import renamed
from worlds import WORLDS, team

PLACES = ("teamslam.solver.reach", "teamslam.solver.sharpening")
DECADES = 8  # of sharpness between what these teams measure: solves that lead on to the sharpest
ALONE = 2 + 3 + DECADES  # solves of one problem: its start and its convex one; off kinks, convex, sharpened, and theirs
HALVED = 3  # its halves, these with each other, and from there


def contradicting(world: str, pieces: int, everywhere: bool) -> list[Submap]:
    """A robot calls two landmarks by each other's names, in every other piece of its way or in all of them."""
    log = team(world, robots=2, poses=8 * pieces, landmarks=8, every=2, sees=0.8, sigma=1e-3, sigma_odometry=1e-3)
    one, other = log.landmark_keys[:2].tolist()
    submaps = [build(piece) for piece in split(log, poses_per_piece=8)]
    lies = [everywhere * n % 2 == 0 and bool(robot_of(submap.base) == 1) for n, submap in enumerate(submaps)]
    names = {one: other, other: one}
    return [renamed(submap, names) if lie else submap for submap, lie in zip(submaps, lies, strict=True)]


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The unknowns of every problem that was solved."""
    sizes: list[int] = []

    def counted(system: System, start: Values, *rest: object) -> Solution:
        sizes.append(system.free.dof)
        return optimise(system, start, *rest)  # type: ignore[arg-type]

    for place in PLACES:
        monkeypatch.setattr(sys.modules[place], "optimise", counted)
    return sizes


@pytest.mark.parametrize(
    ("world", "pieces", "everywhere"),
    [("2d", 2, False), ("planar", 2, False), ("3d", 2, True), ("2d", 8, False), ("2d", 8, True)],
)
def test_it_takes_a_few_solves_of_the_whole_and_some_for_each_time_it_is_halved(
    solves: list[int], world: str, pieces: int, everywhere: bool
) -> None:
    submaps = contradicting(world, pieces, everywhere)
    solves.clear()
    joined = join(submaps)
    component = joined.components[0]
    assert component.solution is not None and component.solution.senseless
    assert sum(solves) <= max(solves) * (ALONE + HALVED * log2(len(submaps)))


@pytest.mark.parametrize("world", WORLDS)
def test_a_what_if_is_one_solve(solves: list[int], world: str) -> None:
    submaps = contradicting(world, 2, False)
    solves.clear()
    joined = join(submaps, options=Options(elsewhere=False))
    assert joined.components[0].solution is not None and joined.components[0].solution.senseless
    assert solves.count(max(solves)) == 1
