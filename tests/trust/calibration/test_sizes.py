"""How large errors are, from what a map leaves of them and of errors drawn."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teamslam.geometry import Array
from teamslam.trust.calibration.sizes import Sizes

DRAWS, ROWS = 16, np.array([100])


def left(measured: float, drawn: float) -> Array:
    """Mean squares (1, 1, 1 + draws) of one part of one robot's rows."""
    spread = 1.0 + 0.05 * np.linspace(-1.0, 1.0, DRAWS)
    return np.concatenate([[measured], drawn * spread])[None, None]


@given(st.floats(1e-4, 0.2), st.floats(1e-6, 1.0), st.floats(1e-3, 10.0))
def test_where_a_map_leaves_next_to_nothing_errors_are_not_made_smaller(
    drawn: float, share: float, scale: float
) -> None:
    """But where more is left than of those drawn, they are larger."""
    few = Sizes.of(left(share * drawn, drawn), np.array([[scale]]), ROWS, 0.25)
    more = Sizes.of(left(4.0 * drawn, drawn), np.array([[scale]]), ROWS, 0.25)
    np.testing.assert_allclose([few.ratio[0, 0], more.ratio[0, 0]], [scale**2, 4.0 * scale**2], rtol=1e-9)


@given(st.floats(0.3, 1.0), st.floats(0.01, 100.0), st.floats(1e-3, 10.0))
def test_elsewhere_they_are_as_large_as_what_is_left_of_them(drawn: float, times: float, scale: float) -> None:
    """Draws of deviation one leave a share; those measured leave the same share of their own variance."""
    sizes = Sizes.of(left(times * drawn, drawn), np.array([[scale]]), ROWS, 0.25)
    np.testing.assert_allclose(sizes.ratio[0, 0], times * scale**2, rtol=1e-9)
