"""By how much stamps are late: a search over shifts, from a second to either side, for that at which all fits best.

What is off is summed by absolute values, so that one sighting that is far off counts once. The best shift is believed
where it is clearly better than none.
"""

import numpy as np

from teamslam.geometry import Array

REACH_S, STEP_S = 1.0, 0.02
CLEAR = 4.0  # sigmas
_COUNT = round(REACH_S / STEP_S)
SHIFTS_S = np.arange(-_COUNT, _COUNT + 1) * STEP_S
"""The shifts (n,), none in the middle."""


def clearest(off: Array) -> float | None:
    """The shift [s] at which what is `off` (n, m), of each of m sightings by each of SHIFTS_S, is least in all; None
    where that is not clearly less than with no shift."""
    best = int(np.argmin(off.sum(1)))
    gain = off[_COUNT] - off[best]
    clear = gain.mean() > CLEAR * gain.std() / np.sqrt(len(gain))
    return float(SHIFTS_S[best]) if clear else None
