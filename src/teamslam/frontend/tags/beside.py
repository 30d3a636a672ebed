"""Corners of tags that are small in the image: what the cells beside an edge do to its line.

The AprilTag library places each point of an edge at the centre of the squared grey slopes that rise outwards, `reach`
pixels to each side. Where a cell is hardly wider than that, the slopes of what is beside the edge are among them: a
white cell behind the black frame takes away what lies inside of the edge, a dark wall behind the white margin what lies
outside. The point is drawn away by up to half a pixel, the same way in all images that are alike, and the line with it.
It follows from what the image shows one cell farther on each side, without a number of its own:

    grey(s)       in - in Phi((s + m) / w) + Phi(s / w) + (out - 1) Phi((s - m) / w), with m the width of a cell across
                  the edge, w that of the edge (`edges`), and `in` and `out` what is seen 3/2 m inside and outside of
                  it, 0 black as the frame and 1 white as the margin
    a point       the centre of the squares of what rises of grey(s + 1) - grey(s - 1)
    a line        least squares of n = max(16, L / 8) points, evenly along the edge
"""

import numpy as np

from teamslam.frontend.tags.edges import CELLS, CUT, FLATTEST, NARROWEST, SHARP, cell_widths, grey_at
from teamslam.frontend.tags.noise import POINTS, TOLD, by_lines
from teamslam.geometry import AnyArray, Array, IntArray

STEP = 0.25  # pixels between places of a slope
ONWARD = 1.5  # cells from an edge to the middle of what is beside the frame, and beside the margin
BRIGHTEST = 1.5  # of the margin: what lies beyond it may be brighter


def undrawn(image: AnyArray, corners: Array, widths: Array, cells: IntArray, reach: float) -> Array:
    """Where the corners of tags (m, 4, 2) [pixels] are that the library found, its edges `widths` (m, 4) wide as
    `edge_widths` has them and so many `cells` (m,) long; what is CUT, or shows no contrast, moves nothing.

    Law: they stay where cells are wide, and where what is beside is black inside and as white as the margin outside.
    """
    if not len(corners):
        return corners
    along = np.roll(corners, -1, 1) - corners
    t = along / np.maximum(np.linalg.norm(along, axis=-1), 1.0)[..., None]
    normal = np.stack([t[..., 1], -t[..., 0]], -1)
    middle = 0.5 * (corners + np.roll(corners, -1, 1)) - corners.mean(1)[:, None]
    side = np.sign(np.sum(middle * normal, -1))
    wide = np.maximum(cell_widths(corners) * CELLS / cells[:, None], 1.0)
    off = _drawn(image, corners, side[..., None] * normal, widths, wide, reach)
    moved = np.einsum("mikr,mkr->mi", by_lines(t), side[..., None] * off)
    return np.asarray(corners - moved.reshape(-1, 4, 2))


def _drawn(image: AnyArray, corners: Array, outwards: Array, widths: Array, cells: Array, reach: float) -> Array:
    """How far outwards lines are drawn at their two ends (m, 4, 2)."""
    along = np.roll(corners, -1, 1) - corners
    places = (np.arange(POINTS) + 1.0) / (POINTS + 1.0)
    feet = corners[:, :, None] + places[:, None] * along[:, :, None]  # (m, 4, POINTS, 2)

    def seen(far: float) -> Array:
        return grey_at(image, feet + (far * cells)[..., None, None] * outwards[:, :, None])

    black, white = (np.median(seen(far), -1, keepdims=True) for far in (-0.5, 0.5))
    contrast = white - black
    told = (np.abs(contrast) > FLATTEST) & ((widths < CUT) & (cells > TOLD * np.maximum(widths, SHARP)))[..., None]
    inside, outside = ((seen(far) - black) / np.where(told, contrast, 1.0) for far in (-ONWARD, ONWARD))
    centres = _centres(np.clip(inside, 0.0, 1.0), np.clip(outside, 0.0, BRIGHTEST), cells, widths, reach)
    x = 2.0 * places - 1.0
    mean, turn = centres.mean(-1), centres @ x / (x @ x)
    return np.where(told, np.stack([mean - turn, mean + turn], -1), 0.0)


def _centres(inside: Array, outside: Array, cells: Array, widths: Array, reach: float) -> Array:
    """Where points (m, 4, POINTS) are placed [pixels outwards]."""
    from scipy.special import ndtr

    s = np.linspace(-reach, reach, round(2.0 * reach / STEP) + 1)
    wide = np.maximum(np.where(widths < CUT, widths, 1.0), NARROWEST)[..., None]

    def rises(of: Array) -> Array:
        """Of a step at so many pixels outwards (m, 4, 1), at each s."""
        return np.asarray(ndtr((s + 1.0 - of) / wide) - ndtr((s - 1.0 - of) / wide))

    far = cells[..., None]
    frame, edge, margin = (rises(of)[:, :, None] for of in (-far, 0.0 * far, far))
    slope = np.maximum(edge - inside[..., None] * frame + (outside[..., None] - 1.0) * margin, 0.0) ** 2
    return np.asarray((slope @ s) / np.maximum(slope.sum(-1), 1e-9))
