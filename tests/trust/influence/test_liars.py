"""Robots that lie are named, with a significance; honest teams accuse nobody; two who contradict each other are told
apart by nobody."""

import pytest

from teamslam.joining import build, join, split
from teamslam.model import Dataset
from teamslam.sim import Options, simulate
from teamslam.sim.faults import made_up, stretched, turning
from teamslam.trust.influence import Judgement, liars, lying_submaps
from teamslam.trust.influence.words import sentences_on_robots

SPACES = ("2d", "planar", "3d")


def judged(log: Dataset) -> Judgement:
    submaps = [build(piece) for piece in split(log)]
    return liars(submaps, join(submaps))


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", range(4))
def test_honest_teams_accuse_nobody(space: str, seed: int) -> None:
    found = judged(simulate(Options(space=space, robots=4), seed))
    assert not found.accused and not found.contradict and not found.alternatives and not found.themselves
    assert found.significance == 1.0 and found.rest is None


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_lies_is_found(space: str, seed: int) -> None:
    log, liar = simulate(Options(space=space, robots=4), seed), 1 + seed % 4
    for lie in (stretched(log, liar, 1.1), made_up(log, liar, seed)):
        found = judged(lie)
        assert found.accused == (liar,) and found.significance < 1e-3 and not found.undecidable
        assert found.rest is not None
        rest = join([s for s in map(build, split(lie)) if liar not in s.robots])
        assert [c.members for c in found.rest.components] == [c.members for c in rest.components]


def test_two_liars_do_not_hide_each_other() -> None:
    log = simulate(Options(space="planar", robots=5), 1)
    found = judged(stretched(stretched(log, 2, 1.1), 4, 0.9))
    assert set(found.accused) == {2, 4}


def test_two_robots_accuse_nobody_and_say_so() -> None:
    found = judged(stretched(simulate(Options(space="2d", robots=2, landmarks=15), 1), 1, 1.1))
    assert found.undecidable and not found.accused
    said = list(sentences_on_robots(found, simulate("2d").names))
    assert len(said) == 1 and "nobody can say who is wrong" in said[0]


def test_a_majority_that_lies_each_in_its_own_way_is_undecidable() -> None:
    log = simulate(Options(space="planar", robots=3, landmarks=15), 0)
    found = judged(stretched(stretched(log, 1, 1.1), 2, 0.9))
    assert found.undecidable and not found.accused


def test_a_robot_that_contradicts_itself_is_named() -> None:
    found = judged(turning(simulate(Options(space="planar", robots=4), 2), 3, 0.05))
    assert tuple(found.themselves) == (3,) and found.themselves[3] < 1e-3


def test_submaps_are_judged_too() -> None:
    log = simulate(Options(space="planar", robots=4), 1)
    submaps = [build(piece) for piece in split(made_up(log, 2, 0))]
    assert lying_submaps(submaps, join(submaps)).accused == tuple(s.id for s in submaps if s.robots == (2,))
