"""What is said of logs with a mistake, drawn from seeds: never a false name; and nothing of logs without one.

`benchmarks/planted.py` counts hundreds, and how many are named.
"""

import pytest

from planted import draw, outcome, said_by_info, said_by_run

PLANTED = (*range(7_004, 7_010), 30_007)  # the last: a clock of two robots, of which nobody knows whose
INNOCENT = range(8_000, 8_005)


@pytest.mark.parametrize("seed", PLANTED)
def test_no_mistake_is_called_another(seed: int) -> None:
    """By a run or before it."""
    plant = draw(seed)
    if plant is None:
        pytest.skip("its world has no place for the mistake that was drawn")
    for causes in (said_by_info(plant.log), said_by_run(plant.log)):
        assert outcome(plant, causes) != "false", (plant.mistake, plant.robots, plant.world, causes)


def test_outliers_far_off_do_not_hide_a_mistake() -> None:
    """Odometry in feet, of all robots, beside sightings some of which are hundreds of sigmas off: with the mistake
    undone a stretch still costs many times what it should, by these alone."""
    plant = draw(204)
    assert plant is not None and plant.mistake == "feet odometry"
    assert outcome(plant, said_by_run(plant.log)) == "right"


def test_no_sigma_is_named_where_the_map_is_wrong() -> None:
    """Odometry in centimetres beside bearings bends the map: what it leaves keeps its sign, and is no noise."""
    plant = draw(205)
    assert plant is not None and plant.mistake == "centimetres odometry"
    assert not [cause.sentence for cause in said_by_run(plant.log) if cause.kind == "sigma"]


@pytest.mark.parametrize("seed", INNOCENT)
def test_nobody_is_accused_for_nothing(seed: int) -> None:
    """Whatever the world, the senses and the loss."""
    plant = draw(seed, "")
    assert plant is not None
    for causes in (said_by_info(plant.log), said_by_run(plant.log)):
        assert not [cause.sentence for cause in causes if cause.is_mistake], plant.world
