"""Leaving a part out: by downdating what a dense solve gives, and exactly what joining the rest gives."""

import numpy as np
import pytest

from teamslam.joining import build, join, split
from teamslam.model import Submap
from teamslam.sim import Options, simulate
from teamslam.trust.influence import Problem, left_out, without
from teamslam.trust.influence.liars import fit_of, robot

SPACES = ("2d", "planar", "3d")


def submaps_of(space: str, seed: int, poses_per_piece: int | None = None) -> list[Submap]:
    log = simulate(Options(space=space, robots=4, poses=30, landmarks=15), seed)
    return [build(piece) for piece in split(log, poses_per_piece=poses_per_piece)]


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("pieces", [None, 10])
def test_a_downdate_is_the_dense_problem_without_the_part(space: str, pieces: int | None) -> None:
    submaps = submaps_of(space, 1, pieces)
    problem = Problem.of(submaps, join(submaps).map)
    parts = problem.parts(robot)
    n = problem.system.free.dof
    whole = problem.system.linearise(problem.values).hessian.to_csr().toarray()
    for part in parts.values():
        # What only the part touches is eliminated from it: it stays in the whole, where nothing else pulls at it.
        rest, slope = whole.copy(), np.zeros(n)
        rest[np.ix_(part.at, part.at)] -= part.information
        slope[part.at] = -part.gradient
        shift, _, rank, _ = np.linalg.lstsq(rest, slope, rcond=1e-11)
        found = left_out(part, problem.factor)
        np.testing.assert_allclose(rest @ found.shift, slope, atol=1e-6 * max(np.abs(slope).max(), 1.0))
        assert found.decrease == pytest.approx(part.cost + slope @ shift, rel=1e-6)
        assert found.dof == part.rows - (n - rank)


@pytest.mark.parametrize("space", SPACES)
def test_slopes_of_all_parts_cancel_and_informations_add_up(space: str) -> None:
    submaps = submaps_of(space, 2)
    joined = join(submaps)
    problem = Problem.of(submaps, joined.map)
    parts = problem.parts(lambda submap: submap.id)
    slope = np.zeros(problem.system.free.dof)
    for part in parts.values():
        slope[part.at] += part.gradient
    assert np.abs(slope).max() < 1e-4
    assert sum(part.cost for part in parts.values()) == pytest.approx(problem.cost, rel=1e-9)
    assert (problem.cost, problem.dof) == pytest.approx((fit_of(joined).cost, fit_of(joined).dof), rel=1e-9)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("pieces", [None, 10])
def test_removal_is_joining_the_rest(space: str, pieces: int | None) -> None:
    submaps = submaps_of(space, 3, pieces)
    joined = join(submaps)
    assert len(joined.components) == 1
    problem = Problem.of(submaps, joined.map)
    for number, part in problem.parts(robot).items():
        gone = {submap.id for submap in submaps if robot(submap) == number}
        near = problem.moved(left_out(part, problem.factor).shift)
        removed = without(submaps, joined, gone, near=near)
        rest = join([submap for submap in submaps if submap.id not in gone])
        assert [c.members for c in removed.components] == [c.members for c in rest.components]
        for mine, theirs in zip(removed.components, rest.components, strict=True):
            assert mine.map.base == theirs.map.base and mine.map.sources == theirs.map.sources
            np.testing.assert_allclose(mine.map.values.minus(theirs.map.values), 0.0, atol=1e-5)
            difference = (mine.map.information - theirs.map.information).toarray()
            assert np.abs(difference).max() < 1e-4 * np.abs(theirs.map.information.toarray()).max()


def test_nothing_removed_is_the_map_itself() -> None:
    submaps = submaps_of("planar", 4)
    joined = join(submaps)
    same = without(submaps, joined, set(), near=joined.map.all_values)
    np.testing.assert_allclose(same.map.values.minus(joined.map.values), 0.0, atol=1e-6)
