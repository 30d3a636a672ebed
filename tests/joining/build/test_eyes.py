"""A submap is seen from the pose whose heading what was seen holds most firmly, and the better for it."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.geometry import rotations
from teamslam.joining import build, full, join, split
from teamslam.joining.place.chains import chains_of
from teamslam.model import Dataset, Submap, Table, index_of, landmark_key, rebased
from teamslam.solver import System
from worlds import WORLDS, team

BLIND = 4  # poses at the beginning of every way


def waking(world: str, seed: int, sees: float = 1.0) -> Dataset:
    """A team that sees nothing at first, and whose headings wander: by 0.1 rad at each step."""
    log = team(world, robots=2, sigma=0.01, sees=sees, seed=seed)
    rng = np.random.default_rng(seed)

    def changed(table: Table) -> Table:
        if table.source != "odometry":
            return table.select(index_of(table.keys[:, 0]) >= BLIND)
        d, turned = table.dim, table.values.copy()
        group = rotations(d)
        wander = group.exp(0.1 * rng.standard_normal((len(table), group.DOF)))
        turned[:, d:] = (table.values[:, d:].reshape(-1, d, d) @ wander).reshape(-1, d * d)
        sigmas = np.concatenate([np.full(d, 0.02), np.full(group.DOF, 0.1)])
        return replace(table, values=turned, whitening=np.diag(1.0 / sigmas)[None])

    return log.with_tables(changed(table) for table in log.tables)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("seed", range(3))
def test_a_team_that_starts_blind_is_joined_as_full_least_squares_has_it(world: str, seed: int) -> None:
    """Within a twentieth of a sigma of all that is in the map; in frames that saw nothing it is off by half of one to
    six."""
    log = waking(world, seed)
    submaps, whole = [build(piece) for piece in split(log)], full(log).map

    def off(submaps: list[Submap]) -> float:
        apart = join(submaps).map.values.only(whole.values.layout.keys).minus(whole.values)
        return float(np.sqrt(apart @ (whole.information @ apart)))

    assert off(submaps) < 0.05
    assert off([rebased(submap, submap.first_pose) for submap in submaps]) > 0.5


@pytest.mark.parametrize("world", WORLDS)
def test_it_is_the_pose_that_would_look_the_surest_were_what_it_saw_known(world: str) -> None:
    piece = split(waking(world, 1, sees=0.3))[0]
    submap, robot = build(piece), 1
    own = piece.pose_keys[robot]
    whole = submap.all_values
    seen = np.setdiff1d(whole.layout.keys, own)
    inside = [t.select(submap.rows_of(t)) for t in piece.tables]
    known = System(whole.layout, tables=[t for t in inside if len(t)], fixed=seen)
    covariance = np.linalg.inv(known.linearise(whole).hessian.to_csr().toarray())
    dim = submap.base_dim
    turns = [covariance[np.ix_(at, at)].trace() for at in (known.free.unknowns([key])[dim:] for key in own)]
    assert submap.base == own[int(np.argmin(turns))]
    assert turns[int(np.argmin(turns))] < 0.5 * turns[0]


@pytest.mark.parametrize("world", WORLDS)
def test_where_nothing_tells_how_it_is_turned_it_is_the_first(world: str) -> None:
    """Of a way alone, and of one along which one landmark is seen as a point."""
    log = team(world, robots=1)
    ways = [t for t in log.tables if t.source == "odometry"]
    one = [t.select(t.keys[:, 1] == landmark_key(np.array(2))) for t in log.tables if t.source == "landmarks"]
    for tables in (ways, [*ways, *one]):
        submap = build(log.with_tables(tables))
        assert submap.base == submap.first_pose == log.pose_keys[1][0]


def test_pieces_of_one_way_hang_together_by_their_first_poses() -> None:
    """Whatever they are seen from, a way in pieces is laid end to end in closed form."""
    log = team("2d", robots=1, poses=30, sigma=1e-6, sigma_odometry=1e-6, sees=0.5, seed=2)
    submaps = [build(piece) for piece in split(log, poses_per_piece=6)]
    assert sum(submap.base != submap.first_pose for submap in submaps) > 1
    ((members, frames),) = chains_of(submaps)
    assert members == list(range(len(submaps)))
    assert log.truth is not None
    root = log.truth.pose(submaps[0].base)
    for number, frame in zip(members, frames, strict=True):
        np.testing.assert_allclose(frame.minus(root.between(log.truth.pose(submaps[number].base))), 0.0, atol=1e-4)
