"""Grids of cases of which the suite runs a part, spread evenly; the rest is marked slow (`pytest -m slow`)."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import pytest


def thinned(one_in: int, *axes: Sequence[Any]) -> list[Any]:
    """All combinations of the axes as parameters, of which one in so many stays in the suite: along any axis of that
    length each place is met once, as in a Latin square."""
    found = []
    for places in product(*(range(len(axis)) for axis in axes)):
        marks = [] if sum(places) % one_in == 0 else [pytest.mark.slow]
        found.append(pytest.param(*(axis[at] for axis, at in zip(axes, places, strict=True)), marks=marks))
    return found
