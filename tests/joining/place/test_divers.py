"""A team that knows of each other by ranges alone ends in the optimum that a search from the truth ends in."""

import pytest

from joining.place.divers import divers
from stress.truth import cost_from
from teamslam.joining import cost_of, full


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_no_map_of_divers_costs_more_than_the_optimum_from_the_truth(seed: int) -> None:
    log = divers(seed, poses=20)
    joined = full(log)
    assert log.truth is not None
    for component in joined.components:
        least = cost_from(log.truth, component.map, list(log.tables)) if len(joined.components) == 1 else None
        assert least is not None and cost_of(component.map, log.tables).cost <= 1.001 * least
