"""A submap seen from another of its poses says the same of its measurements."""

import numpy as np
import pytest

from teamslam.errors import ModelError
from teamslam.joining import build, split
from teamslam.model import Submap, landmark_key, rebased
from teamslam.solver import System
from worlds import WORLDS, team


def built(world: str, seed: int = 0) -> tuple[Submap, list]:
    """A submap of poses, landmarks and poses of another robot, and the rows that it holds."""
    piece = split(team(world, seed=seed))[0]
    submap = build(piece)
    inside = [table.select(submap.rows_of(table)) for table in piece.tables]
    return submap, [table for table in inside if len(table)]


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("seed", range(3))
def test_its_information_is_that_of_its_rows_linearised_there(world: str, seed: int) -> None:
    submap, rows = built(world, seed)
    for base in submap.trajectory_keys(1).tolist():
        seen = rebased(submap, base)
        assert seen.base == base
        whole = seen.all_values
        system = System(whole.layout, tables=rows, fixed=np.array([base]))
        there = system.linearise(whole).hessian.to_csr().toarray()
        np.testing.assert_allclose(seen.information.toarray(), there, atol=1e-12 * np.abs(there).max())
        # What no row ties to the old base hangs on it by nothing, not even by rounding.
        blocks = np.add.reduceat(np.abs(seen.information.toarray()), seen.values.layout.dof_start[:-1], 0)
        tied = np.add.reduceat(blocks, seen.values.layout.dof_start[:-1], 1) > 0.0
        rows_tie = np.add.reduceat(np.abs(there), seen.values.layout.dof_start[:-1], 0)
        rows_tie = np.add.reduceat(rows_tie, seen.values.layout.dof_start[:-1], 1) > 1e-12 * np.abs(there).max()
        assert (tied.sum() <= rows_tie.sum() + 4) and (tied | ~rows_tie).all()


@pytest.mark.parametrize("world", WORLDS)
def test_back_again_it_is_the_same(world: str) -> None:
    submap, _ = built(world)
    other = submap.trajectory_keys(1)[-1]
    back = rebased(rebased(submap, int(other)), submap.base)
    np.testing.assert_allclose(back.values.state, submap.values.state, atol=1e-12)
    most = np.abs(submap.information.toarray()).max()
    np.testing.assert_allclose(back.information.toarray(), submap.information.toarray(), atol=1e-12 * most)


@pytest.mark.parametrize("base", [int(landmark_key(np.array(0))), 5, -1])
def test_it_is_seen_from_its_robot_s_poses_alone(base: int) -> None:
    submap, _ = built("planar")
    with pytest.raises(ModelError, match="cannot be seen from"):
        rebased(submap, base)
