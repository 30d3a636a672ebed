"""Places on the Earth: there and back, arcs of known length, and axes that point where they should."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.geometry import Anchor

anchors = st.builds(
    Anchor, st.floats(-89.9, 89.9), st.floats(-180.0, 180.0), st.floats(-400.0, 9000.0), st.floats(-360.0, 360.0)
)
places = st.lists(st.tuples(*[st.floats(-5e4, 5e4)] * 3), min_size=1, max_size=5).map(np.array)


@given(anchors, places)
def test_there_and_back(anchor: Anchor, positions: np.ndarray) -> None:
    """To a tenth of a millimetre, 50 km away."""
    assert np.abs(anchor.local(anchor.geodetic(positions)) - positions).max() < 1e-4


@given(anchors)
def test_the_origin_is_the_anchor_and_axes_point_as_said(anchor: Anchor) -> None:
    here = anchor.geodetic(np.zeros((1, 3)))[0]
    assert (
        here == pytest.approx([anchor.latitude_deg, anchor.longitude_deg, anchor.height_m], abs=1e-6)
        or abs(abs(here[1] - anchor.longitude_deg) - 360.0) < 1e-6
    )
    assert anchor.geodetic(np.array([[0.0, 0.0, 10.0]]))[0, 2] == pytest.approx(anchor.height_m + 10.0, abs=1e-6)


def test_arcs_are_as_long_as_geodesy_says() -> None:
    """A degree is 110,574 m of latitude and 111,320 m of longitude on the equator, 111,694 m of latitude at the pole
    (Snyder, Map Projections, 1987, table 3 and 4)."""

    def per_degree(anchor: Anchor, axis: int) -> float:
        step = np.zeros((1, 2))
        step[0, axis] = 1.0
        found, start = anchor.geodetic(step)[0], anchor.geodetic(np.zeros((1, 2)))[0]
        return 1.0 / float(found[1 - axis] - start[1 - axis])

    assert per_degree(Anchor(0.0, 10.0), 1) == pytest.approx(110_574, abs=1.0)
    assert per_degree(Anchor(0.0, 10.0), 0) == pytest.approx(111_320, abs=1.0)
    assert per_degree(Anchor(89.5, 10.0), 1) == pytest.approx(111_693, abs=2.0)
    north = Anchor(52.0, 4.0, turn_deg=90.0).geodetic(np.array([[100.0, 0.0]]))[0]
    assert north[0] > 52.0 and north[1] == pytest.approx(4.0)


@pytest.mark.parametrize("numbers", [(91, 0), (0, 181), (float("nan"), 0), (52, 4, float("inf"))])
def test_what_is_nowhere_on_the_earth_is_refused(numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="anchor is a latitude"):
        Anchor(*numbers)
