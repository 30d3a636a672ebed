"""What a join that is far from full least squares says of landmarks that were moved."""

import pytest

import teamslam as ts
from hinged_walls import with_a_robot
from teamslam.config import Config
from teamslam.pipeline.mending import has_other_places, only_by_the_join
from teamslam.trust.cause import Cause

MOVED = Cause("landmark", "landmark 4 was moved", 1.0, mend=lambda log: log)


@pytest.mark.parametrize(("seed", "moved"), [(0, None), (1, None), (0, 4)])
def test_landmarks_are_moved_only_where_full_least_squares_says_so_too(seed, moved):
    """Parts of one map hang on tags seen three times, which no Gaussian tells; what was moved is so in any map."""
    log = with_a_robot(seed, moved)
    joined = ts.join([ts.build(piece) for piece in ts.split(log)])
    assert only_by_the_join(log, joined, Config()) == (moved is None)
    assert has_other_places([MOVED]) and not has_other_places([])
