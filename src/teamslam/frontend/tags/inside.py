"""Edges of a tag against the cells inside of it.

What covers an edge of a tag from end to end and is as bright as its margin, as the margin of another tag is, leaves an
edge that is as good as any, beside where the tag's edge is. But the cells inside stay where they are, and are no longer
where the four edges say: where two cells side by side are black and white, the place between them is seen as well.

    cells       n x n, black or white by the grey in their middles, which the homography of the corners gives
    between     where two differ: the centre of the squared slopes on the way from one middle to the next, (-) halfway;
                so many pixels along the row or the column
    corners     what moves them bilinearly to fit these, by least squares; their covariance from what is left
    an edge     is off where its middle moves across by more than OFF + SIGMAS of its deviation, and by
                more of these than the other three: those beside it share its corners

What is off by half a cell and more is told only at times: there the middles are those of other cells.
"""

import numpy as np

from teamslam.frontend.tags.edges import CUT, FAINTEST, grey_at
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray

STEPS = 17  # places between the middles of two cells
OFF, SIGMAS = 0.35, 4.0  # pixels; deviations
LEAST = 2.2  # pixels of a cell: with less, no place between two is seen
FEWEST = 16  # places between cells, twice what is fitted to them
ODD = 4.0  # medians: what is farther off is no place between two cells (a shadow, a reflection)
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def beside_their_cells(image: AnyArray, corners: Array, widths: Array, sides: IntArray) -> BoolArray:
    """Which edges (m, 4), one of a tag at most, of tags with corners (m, 4, 2) [pixels], so many cells (m,) long, are
    not where the cells inside say; those of which the cells say too little are as they should be. Tags of which an edge
    is CUT by its `widths` (m, 4) are not looked at: their corners are somewhere."""
    off = np.zeros((len(corners), 4), bool)
    shortest = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=-1).min(1, initial=np.inf)
    for n in np.unique(sides).tolist():
        tags = np.flatnonzero((sides == n) & (shortest > LEAST * n) & (widths < CUT).all(1))
        if len(tags):
            off[tags] = _off(image, corners[tags], n)
    return off


def _off(image: AnyArray, squares: Array, n: int) -> BoolArray:
    """Which edges (m, 4) of tags of so many cells are."""
    middles = (np.arange(n) + 0.5) / n
    places = np.stack(np.meshgrid(middles, middles), -1).reshape(-1, 2)
    first, last = _ways(n)
    there = _seen(squares, places)  # (m, n n, 2)
    grey = grey_at(image, there)
    ranked = np.sort(grey, 1)
    low, high = ranked[:, n * n // 10, None], ranked[:, -(n * n // 10) - 1, None]
    rise = grey[:, last] - grey[:, first]
    differ = np.abs(rise) > np.maximum(0.5 * (high - low), FAINTEST)
    way = there[:, last] - there[:, first]
    length = np.linalg.norm(way, axis=-1)
    tag, which = np.nonzero(differ)
    share = np.linspace(0.0, 1.0, STEPS)
    seen = grey_at(image, there[tag, first[which], None] + share[:, None] * way[tag, which, None])
    slope = np.maximum((seen[:, 2:] - seen[:, :-2]) * np.sign(rise[tag, which])[:, None], 0.0) ** 2
    centre = np.zeros(length.shape)
    centre[tag, which] = slope @ share[1:-1] / np.maximum(slope.sum(-1), 1e-9) - 0.5
    u, v = (0.5 * (places[first] + places[last])).T
    bilinear = np.stack([(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v], -1)
    J = (bilinear[:, :, None] * (way / length[..., None])[:, :, None]).reshape(*length.shape, 8)
    moved, covariance = _fitted(J, centre * length, differ)
    along = np.roll(squares, -1, 1) - squares
    normal = np.stack([along[..., 1], -along[..., 0]], -1) / np.linalg.norm(along, axis=-1)[..., None]
    middle = np.zeros((len(squares), 4, 4, 2))
    for k in range(4):
        middle[:, k, [k, (k + 1) % 4]] = 0.5 * normal[:, k, None]
    across = middle.reshape(-1, 4, 8)
    off = np.abs((across @ moved[..., None])[..., 0])
    spread = np.sqrt(np.einsum("mki,mij,mkj->mk", across, covariance, across)) + 1e-9
    told = (np.count_nonzero(differ, axis=1) >= FEWEST)[:, None] & (off > OFF + SIGMAS * spread)
    return np.asarray(told & (off / spread == (off / spread).max(1, keepdims=True)))


def _ways(n: int) -> tuple[IntArray, IntArray]:
    """From which cells to which beside them (2 n (n - 1),), counted line by line."""
    cell = np.arange(n * n).reshape(n, n)
    return np.append(cell[:, :-1], cell[:-1]), np.append(cell[:, 1:], cell[1:])


def _seen(squares: Array, places: Array) -> Array:
    """Where places (k, 2) in shares of tags appear (m, k, 2): by the homography of their corners (m, 4, 2)."""
    flat = np.concatenate([UNIT, np.ones((4, 1))], -1)
    rows = np.zeros((len(squares), 2, 4, 8))
    for k in (0, 1):
        rows[:, k, :, 3 * k : 3 * k + 3] = flat
        rows[:, k, :, 6:] = -squares[:, :, k, None] * UNIT
    h = np.linalg.solve(rows.reshape(-1, 8, 8), np.swapaxes(squares, 1, 2).reshape(-1, 8, 1))[..., 0]
    H = np.concatenate([h, np.ones((len(h), 1))], -1).reshape(-1, 3, 3)
    at = H @ np.concatenate([places, np.ones((len(places), 1))], -1).T  # (m, 3, k)
    return np.asarray(np.swapaxes(at[:, :2] / at[:, 2:], 1, 2))


def _fitted(J: Array, z: Array, used: BoolArray) -> tuple[Array, Array]:
    """Least squares (m, 8) of J x = z (m, k), of what is used and not odd, and their covariances (m, 8, 8)."""
    for _ in range(2):
        weight = used[..., None] * J
        normal = np.swapaxes(weight, 1, 2) @ J + 1e-6 * np.eye(8)
        x = np.linalg.solve(normal, np.swapaxes(weight, 1, 2) @ z[..., None])
        left = np.abs((J @ x)[..., 0] - z)
        ranked = np.sort(np.where(used, left, np.inf), 1)
        usual = np.take_along_axis(ranked, np.count_nonzero(used, axis=1, keepdims=True) // 2, 1)
        used = used & (left <= ODD * usual)
    spare = np.maximum(np.count_nonzero(used, axis=1) - 8, 1)
    variance = np.sum(used * left**2, 1) / spare
    return np.asarray(x[..., 0]), np.asarray(variance[:, None, None] * np.linalg.inv(normal))
