"""Sightings from nearer to a landmark than a map knows how the two lie."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.joining import build, join, split
from teamslam.joining.join.nearer import nearer_than_known
from teamslam.model import Kind, Values
from worlds import team


@pytest.mark.parametrize("world", ["2d", "3d"])
def test_a_row_is_near_where_its_landmark_lies_within_its_own_sigmas_of_the_pose(world: str) -> None:
    log = team(world, robots=2, sees=0.8)
    whole = join([build(piece) for piece in split(log)]).map
    table = next(t for t in log.tables if t.source == "landmarks")
    assert not nearer_than_known(table, whole).any()  # metres away, and known to centimetres
    observer, target = (int(key) for key in table.keys[5])
    dim = 3 if world == "3d" else 2
    here: Pose = whole.all_values.pose(observer)
    beside = here.act(np.full(dim, 1e-3))
    moved = replace(
        whole,
        values=whole.values.update(Values.of({Kind.POINT3 if dim == 3 else Kind.POINT2: ([target], beside[None])})),
    )
    near = nearer_than_known(table, moved)
    assert near[5] and not near[table.keys[:, 1] != target].any()
