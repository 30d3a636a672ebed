"""How well the corners of a tag are known in an image.

A corner is where two edges cross, each a line fitted along L pixels. With s the error of one pixel's edge, the line
errs by about 2 s / sqrt(L) at its end, and the crossing by that over the sine of the angle between them:

    sigma^2 = floor^2 + (2 s)^2 (1 / L1 + 1 / L2) / (2 sin^2)

`floor` is what does not go away in a large tag: the calibration's own error. Both are stated, not fitted to a map.
"""

import numpy as np

from teamslam.geometry import Array


def corner_sigmas(corners: Array, floor: float, edge: float) -> Array:
    """The standard deviation (m, 4) [pixels] of each corner (m, 4, 2), alike in both directions; `floor` and `edge`
    [pixels] as above."""
    ahead = np.roll(corners, -1, 1) - corners
    behind = np.roll(corners, 1, 1) - corners
    one, other = (np.maximum(np.linalg.norm(side, axis=-1), 1e-3) for side in (ahead, behind))
    sine = np.abs(ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]) / (one * other)
    crossing = (2.0 * edge) ** 2 * (1.0 / one + 1.0 / other) / (2.0 * np.maximum(sine, 0.05) ** 2)
    return np.asarray(np.sqrt(floor**2 + crossing))
