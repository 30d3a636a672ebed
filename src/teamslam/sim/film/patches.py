"""What a point of the image sees of a board: not a spot of it but a patch.

A point stands for a third of a pixel in both directions and for a third of the exposure, and over these its ray sweeps
a patch of the board. All that is drawn on a board is made of cells, whose edges run along its two directions; what an
edge leaves of a patch depends only on how the patch is spread across that edge. It is taken for a rectangle with the
deviations of the patch in both directions, of which the integral of the picture gives the mean to the bit:

    width^2  =  (dx/du / 3)^2 + (dx/dv / 3)^2 + (dx/dt T / 3)^2        in the board's x, and in its y
"""

import numpy as np

from teamslam.geometry import AnyArray, Array

LEAST = 1e-3  # of a cell: a patch is never less wide


def light_of(picture: Array, x: AnyArray, y: AnyArray, wide: AnyArray, high: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The light of patches about x and y, `wide` and `high`, all in cells from the top left corner of a picture, and
    which share of each lies on it; what is beside it gives no light.

    Law: the mean over each patch.
    """
    rows, columns = picture.shape
    wide, high = np.maximum(wide, LEAST), np.maximum(high, LEAST)
    left, right = _ends(x, wide, columns)
    top, bottom = _ends(y, high, rows)
    area = wide * high
    share = (right - left) * (bottom - top) / area
    if picture.size == 1:
        return share * picture.item(), share
    first, last = (np.minimum(x.astype(np.int32), columns - 1) for x in (left, right))
    above, below = (np.minimum(y.astype(np.int32), rows - 1) for y in (top, bottom))
    light = share * picture[above, first].astype(share.dtype)
    several = np.nonzero((first != last) | (above != below))
    of = [np.broadcast_to(end, share.shape)[several].astype(float) for end in (left, right, top, bottom, area)]
    light[several] = (_until(picture, of[1], *of[2:4]) - _until(picture, of[0], *of[2:4])) / of[4]
    return light, share


def _ends(middle: AnyArray, width: AnyArray, size: int) -> tuple[AnyArray, AnyArray]:
    """Where patches begin and end within a picture."""
    return np.clip(middle - 0.5 * width, 0.0, size), np.clip(middle + 0.5 * width, 0.0, size)


def _until(picture: Array, x: Array, top: Array, bottom: Array) -> Array:
    """The integral of the picture left of x, from top to bottom."""
    whole = np.pad(np.cumsum(np.cumsum(picture, 0), 1), ((1, 0), (1, 0)))  # left of each crossing and above
    rows, columns = picture.shape
    j = np.minimum(x.astype(np.int64), columns - 1)
    u, sums = x - j, []
    for y in (top, bottom):
        i = np.minimum(y.astype(np.int64), rows - 1)
        upper, lower = (whole[k, j] + u * (whole[k, j + 1] - whole[k, j]) for k in (i, i + 1))
        sums.append(upper + (y - i) * (lower - upper))
    return np.asarray(sums[1] - sums[0])
