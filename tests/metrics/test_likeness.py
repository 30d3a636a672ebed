"""A truth in other units, in a mirror, or with headings in degrees is told to be that; any other is not."""

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.metrics import score
from teamslam.model import Values
from teamslam.pipeline import run
from teamslam.sim import Options, simulate

LOG = simulate(Options(space="2d", robots=2, poses=30), 3)
MAP = run(LOG).joined.map


def changed(scale: float = 1.0, mirrored: bool = False, degrees: bool = False) -> Values:
    """The truth as somebody may write it."""
    truth = LOG.truth
    assert truth is not None
    side = np.array([1.0, -1.0 if mirrored else 1.0])
    parts = {}
    for kind, keys, _ in truth.parts():
        places = scale * truth.positions(keys, 2) * side
        if kind.is_pose:
            turns = truth.poses_of(keys, 2).xytheta()[:, 2] * side[1]
            turns = np.degrees(turns) if degrees else turns
            parts[kind] = (keys, Pose.from_xytheta(np.column_stack([places, turns])))
        else:
            parts[kind] = (keys, places)
    return Values.of(parts)


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (changed(1000.0), "it fits with its lengths in millimetres"),
        (changed(1.0 / 0.3048), "it fits with its lengths in feet"),
        (changed(5.0), "it fits with its lengths 5"),
        (changed(mirrored=True), "it fits in a mirror"),
        (changed(1000.0, mirrored=True), "in millimetres, where metres are expected and in a mirror"),
        (changed(degrees=True), "its headings look like degrees"),
    ],
)
def test_what_a_truth_is_written_in_is_told(truth: Values, said: str) -> None:
    assert said in score(MAP, truth).note


def test_of_the_truth_itself_nothing_is_said() -> None:
    """Nor of one in another frame, nor of another world."""
    truth = LOG.truth
    assert truth is not None
    assert score(MAP, truth).note == ""
    assert score(MAP, truth.transform(Pose.from_xytheta(np.array([3.0, -4.0, 2.0])))).note == ""
    other = simulate(Options(space="2d", robots=2, poses=30, world_seed=9), 8).truth
    assert other is not None and "it fits" not in score(MAP, other).note
