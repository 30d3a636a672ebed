"""What a map costs is what its own rows cost, however many more the log holds."""

import numpy as np
import pytest

from teamslam.joining import AtMap, build, cost_of, full, join, split
from teamslam.joining.join.optimum import usable_rows
from worlds import WORLDS, team


@pytest.mark.parametrize("world", WORLDS)
def test_rows_of_a_piece_that_is_in_no_map_cost_nothing(world: str) -> None:
    """A piece that is left out was seen from poses, and saw things, that the map knows through its neighbours."""
    log = team(world, poses=15, every=1, sees=0.9)
    *pieces, lost = split(log, poses_per_piece=5)
    joined = join([build(piece) for piece in pieces]).map
    values = joined.all_values
    known, _ = usable_rows(lost.tables, values.layout, world=False)
    assert sum(map(len, known)) > 0
    rows, _ = usable_rows([table for piece in pieces for table in piece.tables], values.layout, world=False)
    squared = [np.sum(table.whitened(values) ** 2) for table in rows]
    found = cost_of(joined, log.tables)
    assert found.cost == pytest.approx(sum(squared), rel=1e-9)
    assert found.rows == sum(table.dof for table in rows)
    assert len(AtMap(log.tables, joined)) == sum(map(len, rows))


@pytest.mark.parametrize("world", WORLDS)
def test_at_full_least_squares_it_is_what_was_minimised(world: str) -> None:
    log = team(world)
    best = full(log).map
    assert cost_of(best, log.tables).cost == pytest.approx(best.cost, rel=1e-9)
