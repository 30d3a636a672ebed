"""What a run's words say of how exact a join is."""

from typing import Any

import pytest

from teamslam.results.words import exactness


def found(shift: float) -> dict[str, Any]:
    gap = {"relative_cost_gap": 0.5, "gradient_norm": 4.0, "max_shift_sigma": shift, "rounds": 1, "bytes": 80}
    return {"exactness": gap, "cost": 100.0}


@pytest.mark.parametrize(("shift", "told"), [(0.1, False), (4.4, True)])
def test_a_join_that_is_far_from_full_least_squares_is_told_the_way_there(shift: float, told: bool) -> None:
    assert ("`teamslam run --exact` goes on from there" in exactness(found(shift))) == told
