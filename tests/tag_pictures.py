"""Pictures of tags with corners that are known, by OpenCV's bitmaps and a homography, each pixel the mean of 5 x 5
points in it: written from the definitions, not with the renderer of the film."""

import cv2
import numpy as np

BITMAPS = {
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
}
FINE = 5


def square(centre, side, turn=0.0, lean=0.0):
    """Corners (4, 2) of a tag: bottom left, bottom right, top right, top left as printed, turned in the image and
    leaning back (its top is shorter by `lean`)."""
    half = side / 2.0
    plain = np.array([[-half, half], [half, half], [half * (1 - lean), -half], [-half * (1 - lean), -half]])
    c, s = np.cos(turn), np.sin(turn)
    return plain @ np.array([[c, s], [-s, c]]) + np.asarray(centre, float)


def picture(tags, size=(320, 250), family="tag36h11", blur=0.0, noise=0.0, seed=0, dark=20.0, bright=230.0):
    """An image (h, w) of bytes with tags {number: corners}, pixel (0, 0) being the centre of the first; blur is that of
    a Gaussian [pixels], noise its deviation."""
    width, height = size
    y, x = np.mgrid[0 : height * FINE, 0 : width * FINE]
    points = (np.stack([x, y], -1) + 0.5) / FINE - 0.5
    image = np.full((height * FINE, width * FINE), 0.6 * bright)
    for number, corners in tags.items():
        cells = _cells(number, family)
        n = len(cells)
        # In cells, from the top left of the black square, which is one cell within the white margin.
        there = np.array([[1, n - 1], [n - 1, n - 1], [n - 1, 1], [1, 1]], np.float32)
        H = cv2.getPerspectiveTransform(corners.astype(np.float32), there)
        at = cv2.perspectiveTransform(points.reshape(-1, 1, 2), H.astype(float)).reshape(*points.shape)
        inside = ((at >= 0) & (at < n)).all(-1)
        column, row = at[inside].astype(int).T
        image[inside] = np.where(cells[row, column], bright, dark)
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur * FINE)
    image = image.reshape(height, FINE, width, FINE).mean((1, 3))
    image += noise * np.random.default_rng(seed).normal(size=image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def _cells(number, family):
    """A tag's cells with a white margin of one, upright: OpenCV keeps them on their heads."""
    book = cv2.aruco.getPredefinedDictionary(BITMAPS[family])
    n = book.markerSize + 2
    bits = cv2.aruco.generateImageMarker(book, number, n, borderBits=1) > 127
    return np.pad(bits[::-1, ::-1], 1, constant_values=True)
