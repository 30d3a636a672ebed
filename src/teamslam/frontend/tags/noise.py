"""How well the corners of a tag are known in an image.

A corner is where two edges cross, each a line fitted along L pixels. With s the error of one pixel's edge, the line
errs by about 2 s / sqrt(L) at its end, and the crossing by that over the sine of the angle between them. The error of a
pixel's edge grows as the root of the edge's width w (a Gaussian edge of height C in noise n is known to
n sqrt(2 sqrt(pi) w) / C, the Cramer-Rao bound), so with s for an edge in focus, of width SHARP:

    sigma^2 = floor^2 + (2 s)^2 (w1 / L1 + w2 / L2) / (2 SHARP sin^2)

`floor` is what does not go away in a large tag: the calibration's own error. Both are stated, not fitted to a map.
"""

import numpy as np

from teamslam.frontend.tags.edges import SHARP
from teamslam.geometry import Array


def corner_sigmas(corners: Array, floor: float, edge: float, widths: Array | None = None) -> Array:
    """The standard deviation (m, 4) [pixels] of each corner (m, 4, 2), alike in both directions; `floor` and `edge`
    [pixels] as above. `widths` (m, 4) are those of the edges from each corner to the next; None, and what is below
    SHARP: in focus."""
    ahead = np.roll(corners, -1, 1) - corners
    behind = np.roll(corners, 1, 1) - corners
    one, other = (np.maximum(np.linalg.norm(side, axis=-1), 1e-3) for side in (ahead, behind))
    sine = np.abs(ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]) / (one * other)
    wider = np.ones(one.shape) if widths is None else np.maximum(widths / SHARP, 1.0)
    spread = wider / one + np.roll(wider, 1, 1) / other
    crossing = (2.0 * edge) ** 2 * spread / (2.0 * np.maximum(sine, 0.05) ** 2)
    return np.asarray(np.sqrt(floor**2 + crossing))
