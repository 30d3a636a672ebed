"""What of the light that passes a lens falls on each pixel.

A lens that is out of focus a little spreads the light of each point by a Gaussian, and only then pixels gather it, each
from its square. So a point at x beside the middle of a pixel gives it

    w(x)  =  Phi((x + 1/2) / blur) - Phi((x - 1/2) / blur)       in each of the two directions

and each of the FINE x FINE points of a pixel the mean of that over its own square. Blurred after pixels gathered their
light, edges along them would be seen up to 0.03 pixels beside where they are.
"""

import numpy as np

from teamslam.geometry import AnyArray, Array
from teamslam.sim.film.shutter import FINE

REACH = 4.0  # deviations of the blur


def gathered(points: AnyArray, blur_px: float) -> Array:
    """The light (h, w) on pixels, from that of their points (FINE h, FINE w) before the lens spreads it.

    Law: of an image that is the same everywhere, the same; beyond the border of the image there is what is within.
    """
    share = _shares(blur_px)
    lines = _along(np.ascontiguousarray(np.asarray(points, np.float32).T), share)  # (w, FINE h)
    return np.asarray(_along(np.ascontiguousarray(lines.T), share), float)


def _along(points: AnyArray, share: Array) -> AnyArray:
    """The sums (n, k) over the first of two directions of points (FINE n, k), each with its share of the light; where
    the image ends, of those that are in it."""
    count, reach = len(points) // FINE, (len(share) - 1) // 2
    padded = np.pad(points, ((reach, reach), (0, 0)))
    inside = np.pad(np.ones(len(points)), reach)
    light, whole = np.zeros((count, points.shape[1]), np.float32), np.zeros(count)
    for t, w in enumerate(share.tolist()):
        of = slice(t + 1, t + 1 + FINE * count, FINE)  # the middle one of a pixel's points is its second
        light += np.float32(w) * padded[of]
        whole += w * inside[of]
    return np.asarray(light / whole[:, None].astype(np.float32))


def _shares(blur_px: float) -> Array:
    """What a pixel gets of its points and those beside them, from so many before its middle to as many after it."""
    reach = FINE // 2 + int(np.ceil(REACH * blur_px * FINE))
    ends = (np.arange(-reach, reach + 2) - 0.5) / FINE
    return np.asarray(np.diff(_until(ends + 0.5, blur_px) - _until(ends - 0.5, blur_px)))


def _until(x: Array, blur_px: float) -> Array:
    """The integral of Phi(x / blur) from far below."""
    if blur_px == 0.0:
        return np.maximum(x, 0.0)
    from scipy.special import ndtr

    u = x / blur_px
    return np.asarray(x * ndtr(u) + blur_px * np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi))
