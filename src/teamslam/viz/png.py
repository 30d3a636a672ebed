"""Figures as PNG files: drawn once by Agg, packed as they are.

Lines and letters on white pack best unfiltered: in a third of the time that it takes to try each filter on each row,
which photographs need, and no larger. A fourth channel, full everywhere, is left out.
"""

import struct
import zlib
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKED = 3  # of 9: from there on an image takes longer to write than to draw, and is hardly smaller
INCH_M = 0.0254


def write_png(figure: "Figure", file: BinaryIO, dots: float) -> None:
    """Draw a figure with so many `dots` per inch into an open file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(dots)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    file.write(png(np.asarray(canvas.buffer_rgba())[..., :3], dots))  # type: ignore[no-untyped-call]


def png(image: NDArray[np.uint8], dots: float) -> bytes:
    """A PNG file of an image (height, width, 3), red, green and blue, with so many `dots` per inch."""
    height, width = image.shape[:2]
    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # the first number of each says that it is not filtered
    rows[:, 1:] = image.reshape(height, -1)
    a_metre = round(dots / INCH_M)
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", a_metre, a_metre, 1)),
        (b"IDAT", zlib.compress(rows.tobytes(), PACKED)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(map(_part, *zip(*parts, strict=True)))


def _part(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
