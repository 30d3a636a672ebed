"""What an image of depths tells of a tag: the plane in which it lies.

    plane    m . P = 1 of the points P in the camera's frame, so 1/Z = m . (a, b, 1) with a = X/Z, b = Y/Z: least
             squares of the pixels on the black square without its outermost tenth; those far from the plane of most
             are left out
    spread   s^2 = RSS / (N - 5 g) of N pixels, in 1/Z, about the plane
    grain    g: neighbouring pixels err together, so that g of them count for one. (1 + 2 (r_1 + r_2 + ..)) along lines,
             times the same along columns, with r_k how alike residuals k pixels apart are, over all tags of a camera
    noise    g s^2 (A'A)^-1: three numbers are fitted, and s is known from few pixels that count; divided by two less
             than are to spare, squared errors have the mean 1 beside it (Student's t)
    floor    + f^2 m m': a share f of the distance, by which all depths may be off, however large the tag

A pixel of depth is that of the image in which the tag was seen (registered, as it is called), and Z is along the
camera's axis. 0 and what is no number say that nothing was measured. Cameras that triangulate (structured light,
stereo) err alike in 1/Z near and far. So that the plane can follow the camera's numbers, pixels are kept as the means
of 4 x 4 cells of a tag: of what they say of its tilt the cells leave out one part in sixteen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray

SIDE = 4  # cells along an edge
INSET = 0.1  # of an edge: depths at an edge are of either side
FEWEST = 20  # pixels of a tag
ODD = 4.0  # sigmas by the median, of a pixel
FARTHEST = 8  # pixels apart, for which is asked how alike errors are
ALIKE = 0.05  # and from where on they are not


@dataclass(frozen=True, eq=False)
class TagDepths:
    """Depths on the faces of tags (m,), in cells (m, 16): where each is (m, 16, 2) [pixels], 1/Z there [1/m] and how
    many pixels it has, 0 where nothing was measured; the mean square `noise` (m,) of one pixel, and how many pixels
    count for one (`grain`). `alike` (m, 2, FARTHEST + 1, 2) are sums of products of residuals so many pixels apart,
    along lines and columns, and their numbers."""

    pixels: Array
    inverse: Array
    count: IntArray
    noise: Array
    alike: Array
    grain: float = 1.0

    @classmethod
    def nothing(cls, tags: int) -> "TagDepths":
        """Of tags of which no depth is known."""
        cells = tags, SIDE * SIDE
        return cls(np.zeros((*cells, 2)), np.zeros(cells), np.zeros(cells, np.int64), np.zeros(tags),
                   np.zeros((tags, 2, FARTHEST + 1, 2)))  # fmt: skip

    def __len__(self) -> int:
        return len(self.noise)

    def select(self, index: AnyArray) -> "TagDepths":
        """Those of the tags at a mask or index."""
        return TagDepths(
            self.pixels[index],
            self.inverse[index],
            self.count[index],
            self.noise[index],
            self.alike[index],
            self.grain,
        )

    @classmethod
    def together(cls, parts: "Sequence[TagDepths]") -> "TagDepths":
        """Those of some images, one after another."""
        all_ = [cls.nothing(0), *parts]
        return cls(
            np.concatenate([p.pixels for p in all_]),
            np.concatenate([p.inverse for p in all_]),
            np.concatenate([p.count for p in all_]),
            np.concatenate([p.noise for p in all_]),
            np.concatenate([p.alike for p in all_]),
        ).with_grain()

    @property
    def told(self) -> BoolArray:
        """Of which tags (m,) any depth is known."""
        return np.asarray(self.count.any(1))

    def with_grain(self) -> "TagDepths":
        """With the grain that all of them show."""
        total = self.alike.sum(0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.nan_to_num(total[..., 0] / total[..., 1])
        grain = 1.0
        for along in mean:
            r = along / along[0] if along[0] > 0.0 else np.zeros(FARTHEST + 1)
            last = int(np.argmax(np.append(r[1:] < ALIKE, True)))
            grain *= 1.0 + 2.0 * r[1 : 1 + last].sum()
        return replace(self, grain=float(grain))


def depths_on(depths: Array, corners: Array) -> TagDepths:
    """What an image of depths (h, w) [m] says of tags with corners (m, 4, 2)."""
    found = TagDepths.nothing(len(corners))
    for k, square in enumerate(corners):
        _measure(depths, square, found, k)
    return found


def _measure(depths: Array, corners: Array, found: TagDepths, k: int) -> None:
    height, width = depths.shape
    left, top = np.clip(np.ceil(corners.min(0)), 0, (width, height)).astype(int).tolist()
    right, bottom = np.clip(np.floor(corners.max(0)) + 1, 0, (width, height)).astype(int).tolist()
    v, u = np.mgrid[top:bottom, left:right]
    z = depths[top:bottom, left:right]
    cell = _cells(corners, np.stack([u, v], -1).reshape(-1, 2).astype(float)).reshape(z.shape)
    on = (cell >= 0) & np.isfinite(z) & (z > 0.0)
    w, A = 1.0 / np.where(on, z, 1.0), np.stack([u, v, np.ones(u.shape)], -1).astype(float)
    for _ in range(2):
        if np.count_nonzero(on) < FEWEST:
            return
        plane = np.linalg.lstsq(A[on], w[on], rcond=None)[0]
        off = w - A @ plane
        on &= np.abs(off) <= ODD * 1.4826 * np.median(np.abs(off[on])) + 1e-12
    count = np.bincount(cell[on], minlength=SIDE * SIDE)
    found.count[k] = count
    for sums, numbers in ((found.pixels[k, :, 0], u), (found.pixels[k, :, 1], v), (found.inverse[k], w)):
        sums[:] = np.bincount(cell[on], numbers[on], SIDE * SIDE) / np.maximum(count, 1)
    off = np.where(on, off, 0.0)
    found.noise[k] = np.sum(off**2) / count.sum()
    for axis, (r, there) in enumerate(((off, on), (off.T, on.T))):
        for lag in range(min(FARTHEST + 1, r.shape[1])):
            end = r.shape[1] - lag
            both = there[:, :end] & there[:, lag:]
            found.alike[k, axis, lag] = np.sum(r[:, :end] * r[:, lag:]) / max(found.noise[k], 1e-30), both.sum()


def _cells(corners: Array, points: Array) -> IntArray:
    """The cell of points (n, 2) of the image, from the one at the first corner along the first edge; -1 outside."""
    square, (x, y), one = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), corners.T, np.ones(4)
    zero, (s, t) = np.zeros((4, 3)), square.T[..., None]
    here = np.stack([x, y, one], -1)
    rows = np.block([[here, zero, -s * here[:, :2]], [zero, here, -t * here[:, :2]]])
    if np.linalg.matrix_rank(rows) < 8:
        return np.full(len(points), -1)
    H = np.append(np.linalg.solve(rows, np.concatenate([s, t])[:, 0]), 1.0).reshape(3, 3)
    ahead = np.concatenate([points, np.ones((len(points), 1))], 1) @ H.T
    with np.errstate(divide="ignore", invalid="ignore"):
        place = (ahead[:, :2] / ahead[:, 2:] - INSET) / (1.0 - 2.0 * INSET)
    inside = ((place >= 0.0) & (place < 1.0)).all(-1)
    column, row = (np.where(inside[:, None], place, 0.0) * SIDE).astype(np.int64).T
    return np.asarray(np.where(inside, SIDE * row + column, -1))


def points_on(seen: TagDepths, camera: Camera) -> tuple[Array, IntArray]:
    """Where cells of tags are (m, 16, 3) [m] in the camera's frame, each when it was measured, and how many pixels
    each has, 0 where nothing tells."""
    rays, good = camera.rays(np.where(seen.count[..., None] > 0, seen.pixels, np.array(camera.centre)))
    ahead = np.asarray(rays[..., 2] > 0.0)
    count = np.where(good & ahead, seen.count, 0)
    depth = 1.0 / np.where(count > 0, seen.inverse, 1.0)
    return np.asarray(rays / np.where(ahead, rays[..., 2], 1.0)[..., None] * depth[..., None]), count


def planes(seen: TagDepths, points: Array, count: IntArray, floor: float) -> tuple[Array, Array, BoolArray]:
    """The planes m (m, 3) [1/m] of tags through points (m, 16, 3) of so many pixels (`points_on`) in the camera's
    frame, their covariances (m, 3, 3), and of which there is one; `floor` is the share of the distance by which all
    depths may be off."""
    told = count > 0
    inverse = 1.0 / np.where(told, points[..., 2], 1.0)
    A = points * inverse[..., None]
    normal = np.swapaxes(A, 1, 2) @ (count[..., None] * A)
    spare = count.sum(1) - 5.0 * seen.grain
    held = (spare > 0.0) & (seen.noise > 0.0) & (np.linalg.matrix_rank(normal, hermitian=True) == 3)
    cofactor = np.linalg.inv(np.where(held[:, None, None], normal, np.eye(3)))
    m = (cofactor @ np.sum(A * (count * inverse)[..., None], 1)[..., None])[..., 0]
    noise = seen.grain * seen.noise * count.sum(1) / np.where(held, spare, 1.0)
    return m, noise[:, None, None] * cofactor + floor**2 * m[:, :, None] * m[:, None, :], held
