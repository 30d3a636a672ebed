"""Where some measure far sharper than others, sharp measurements come last."""

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.model import Table, Values, pack, pose_key, pose_kind
from teamslam.solver import Options, System, optimise, reach
from teamslam.solver.sharpening import sharpened_start

BARS = 10
FEW = Options(max_iterations=400)


def linkage(sharp: float, seed: int) -> tuple[System, Values]:
    """Bars of a metre in a row in space, each as long as it is to so much [m] and turned against the last as one likes;
    every fifth end is known to be elsewhere, to 0.1 m. From straight out it must bend, and no bar may give way."""
    keys = pose_key(1, np.arange(BARS + 1))
    straight = np.zeros((BARS + 1, 6))
    straight[:, 0] = np.arange(BARS + 1)
    step = np.tile(np.eye(6)[0], (BARS, 1))
    rigid = np.diag([1.0 / sharp] * 3 + [1.0] * 3)
    ends = keys[::5]
    places = np.random.default_rng(seed).normal(size=(len(ends), 3))
    bars = Table(
        *(1, "odometry", "relative_pose", 3, np.stack([keys[:-1], keys[1:]], 1), pack(Pose.from_tangent(step, 3))),
        *(np.tile(rigid, (BARS, 1, 1)), np.arange(BARS)),
    )
    seen = Table(
        1, "world", "position", 3, ends[:, None], places, np.tile(np.eye(3) / 0.1, (len(ends), 1, 1)), np.arange(3)
    )
    start = Values.of({pose_kind(3): (keys, Pose.from_tangent(straight, 3))})
    return System(start.layout, tables=[bars, seen]), start


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_rigid_bends_where_it_may(seed: int) -> None:
    """Bars a hundred times as stiff cost nearly the same: they are long enough, and only to be turned. A search that
    begins with all of their stiffness creeps, and ends at a cost of thousands."""
    soft, start = linkage(1e-2, seed)
    stiff, _ = linkage(1e-4, seed)
    assert optimise(stiff, start, FEW).senseless
    assert reach(stiff, start, FEW).cost == pytest.approx(optimise(soft, start).cost, rel=1e-2)


def test_what_is_about_as_sharp_has_no_such_start() -> None:
    system, start = linkage(0.2, 0)
    assert sharpened_start(system, start, FEW) is None
