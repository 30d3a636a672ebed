"""When H takes in curvature: near the optimum that of losses, where steps are slow all of it, and none too far away."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teamslam.solver.newton import BACK, NEAR, PATIENCE, SLOW, Bend

distances = st.lists(st.floats(1e-12, 1e6), min_size=1, max_size=20)


def creeps(steps: list[float]) -> bool:
    """Whether PATIENCE steps in a row each left more than SLOW of the distance."""
    slow = "".join("s" if later > SLOW * earlier else "." for earlier, later in pairwise(steps))
    return "s" * PATIENCE in slow


@given(distances)
def test_curvature_comes_near_the_optimum_or_where_steps_creep_and_stays(steps: list[float]) -> None:
    bend, seen = Bend(), []
    for distance in steps:
        bend.see(distance)
        seen.append(["none", "losses", "all"].index(bend.curvature))
    assert seen == sorted(seen)
    assert (seen[-1] > 0) == (min(steps) < NEAR or creeps(steps))


@given(st.floats(1e-9, NEAR, exclude_max=True), st.floats(0.0, 1.0))
def test_residuals_bend_where_a_step_leaves_much(distance: float, left: float) -> None:
    bend = Bend()
    bend.see(distance)
    assert bend.curvature == "losses"
    bend.see(left * distance)
    assert (bend.curvature == "all") == (left * distance > SLOW * distance)


@given(st.integers(1, 8))
def test_each_retreat_waits_until_nearer(retreats: int) -> None:
    bend = Bend()
    assert not bend.retreat()
    near = NEAR
    for _ in range(retreats):
        bend.see(0.99 * near)
        assert bend.curvature != "none"
        assert bend.retreat() and bend.curvature == "none"
        near *= BACK
        bend.see(np.nextafter(near, 1.0))
        assert bend.curvature == "none"
