"""Images in grey, one after another: from a topic (raw, compressed), or from a folder of files.

A folder's images are named by when they were taken, as data sets have it: `1403636579763555584.png` (nanoseconds),
`1305031102.175304.png` (seconds). Where names only count (`frame_0012.jpg`), the rate must be said.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.geometry import AnyArray, IntArray
from teamslam.io.bags.opened import Recording
from teamslam.io.bags.roles import ROLES


class Unusable(Exception):
    """An image that cannot be read; the reason follows on 'images'."""


@dataclass(frozen=True)
class Picture:
    """An image, taken at `tick`; `grey()` gives it as bytes (h, w), or raises Unusable."""

    tick: int
    grey: Callable[[], AnyArray]


@dataclass(frozen=True)
class Pictures:
    """Images: where they are from in words, a digest of their content, how many there should be, and each in turn."""

    origin: str
    content: str
    count: int
    each: Callable[[], Iterator[Picture]]


def pictures_of_topic(recording: Recording, topic: str) -> Pictures:
    """The images of a topic. InputError where there is none, or where it holds something else."""
    types, count = recording.topics.get(topic, ((), 0))
    wrong = [type for type in types if ROLES.get(type) != "image"]
    if wrong or not types:
        listing = ", ".join(n for n, (t, _) in recording.topics.items() if ROLES.get(t[0]) == "image") or "none"
        found = f"{topic} holds {wrong[0]}" if wrong else f"there is no topic {topic}"
        raise InputError(f"{found}; of images this recording has {listing}", path=recording.path)

    def each() -> Iterator[Picture]:
        for message in recording.messages([topic]):
            if (found := recording.decode(message)) is not None:
                yield Picture(message.tick, lambda found=found: _grey(found))  # type: ignore[misc]

    return Pictures(topic, digest(recording.paths, topic), count, each)


def pictures_of_folder(
    folder: Path, pattern: str, rate_hz: float | None, stamps: tuple[tuple[str, ...], IntArray] | None = None
) -> Pictures:
    """The images of a folder whose names fit a pattern ('left/*.png'), in the order of their stamps: those of a list
    (names and ticks), where one is given. InputError where there is none, where their names say no time and no rate is
    given, or the list has none of an image."""
    files = sorted(path for path in folder.glob(pattern) if path.is_file())
    if not files:
        raise InputError(f"no file fits '{pattern}'; expected images, as in '*.png'", path=folder)
    if stamps is not None:
        return _listed(folder, pattern, files, stamps)
    numbers = [re.findall(r"\d+(?:\.\d+)?", path.stem) for path in files]
    for path, found in zip(files, numbers, strict=True):
        if not found:
            raise InputError("the name of an image holds no number; expected a stamp or a count", path=path)
    ticks = [_tick(found[-1], rate_hz) for found in numbers]
    for path, tick in zip(files, ticks, strict=True):
        if tick is None:
            raise InputError(
                "the name of this image is no stamp (nanoseconds, or seconds with decimals); say how many there are a "
                "second with rate_hz",
                path=path,
                field="robot.camera.rate_hz",
            )
    return _taken(folder, pattern, files, [tick or 0 for tick in ticks])


def _listed(folder: Path, pattern: str, files: Sequence[Path], stamps: tuple[tuple[str, ...], IntArray]) -> Pictures:
    """Images by a list of stamps: by their names, or, where it has none, in their order."""
    names, ticks = stamps
    if any(names):
        of = {name: tick for name, tick in zip(names, ticks.tolist(), strict=True) if name}
        for path in files:
            if path.name not in of:
                raise InputError("the list of stamps has none of this image", path=path, field="robot.camera.stamps")
        return _taken(folder, pattern, files, [of[path.name] for path in files])
    if len(ticks) != len(files):
        raise InputError(
            f"there are {len(files)} images, and {len(ticks)} stamps for them", path=folder, field="robot.camera.stamps"
        )
    return _taken(folder, pattern, files, ticks.tolist())


def _taken(folder: Path, pattern: str, files: Sequence[Path], ticks: Sequence[int]) -> Pictures:
    """Image files by when they were taken."""
    order = sorted(range(len(files)), key=lambda k: (ticks[k], files[k].name))

    def each() -> Iterator[Picture]:
        for k in order:
            yield Picture(ticks[k], lambda path=files[k]: _file(path))  # type: ignore[misc]

    return Pictures(pattern, digest([folder], f"{pattern} {stamped(ticks)}"), len(files), each)


def pictures_of_files(files: Sequence[Path]) -> Pictures:
    """Image files, counted as they stand."""

    def each() -> Iterator[Picture]:
        for k, file in enumerate(files):
            yield Picture(k, lambda file=file: _file(file))  # type: ignore[misc]

    return Pictures(files[0].name, "", len(files), each)


def stamped(ticks: Sequence[int]) -> str:
    """A name for when images were taken: what was found in them is kept with it."""
    return blake2b(np.array(ticks, np.int64).tobytes(), digest_size=12).hexdigest()


def digest(paths: Sequence[Path], part: str) -> str:
    """A name for what is in files, or in the files of folders, and for the part of it that is meant."""
    known = blake2b(part.encode(), digest_size=20)
    inner = ([path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file()) for path in paths)
    for file in (file for files in inner for file in files):
        known.update(file.name.encode() + b"\0")
        with file.open("rb") as stream:
            while block := stream.read(1 << 22):
                known.update(block)
    return known.hexdigest()


def _tick(number: str, rate_hz: float | None) -> int | None:
    """When an image was taken, by the number in its name."""
    if rate_hz is not None:
        return round(float(number) / rate_hz * TICKS_PER_S)
    if "." in number:
        return round(float(number) * TICKS_PER_S)
    return int(number) // 1000 if len(number) >= 16 else None


# --- pixels -------------------------------------------------------------------------------------------------------

CHANNELS = {
    "mono8": 1, "8uc1": 1, "rgb8": 3, "bgr8": 3, "8uc3": 3, "rgba8": 4, "bgra8": 4, "8uc4": 4, "mono16": 1, "16uc1": 1,
    "yuv422": 2, "uyvy": 2, "yuv422_yuy2": 2, "yuyv": 2, "nv12": 1, "nv21": 1,
    "bayer_rggb8": 1, "bayer_bggr8": 1, "bayer_gbrg8": 1, "bayer_grbg8": 1,
    "rgb16": 3, "bgr16": 3, "rgba16": 4, "bgra16": 4, "16uc3": 3, "16uc4": 4,
    "bayer_rggb16": 1, "bayer_bggr16": 1, "bayer_gbrg16": 1, "bayer_grbg16": 1,
}  # fmt: skip
"""Encodings of sensor_msgs/Image that can be read, and how many numbers a pixel has."""


def _grey(found: Any) -> AnyArray:
    if hasattr(found, "encoding"):
        return _raw(found)
    return _decoded(np.frombuffer(bytes(found.data), np.uint8))


def _file(path: Path) -> AnyArray:
    try:
        return _decoded(np.fromfile(path, np.uint8))
    except OSError as error:
        raise Unusable(f"that cannot be read ({error.strerror})") from None


def _decoded(data: AnyArray) -> AnyArray:
    """A compressed image (PNG, JPEG, and what OpenCV knows besides)."""
    cv2 = opencv()
    try:
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise Unusable("that cannot be decompressed")
    return np.asarray(image, np.uint8)


def _raw(found: Any) -> AnyArray:
    name, height, width = str(found.encoding).lower(), int(found.height), int(found.width)
    if name not in CHANNELS:
        raise Unusable(f"of an encoding that is not known, {found.encoding!r}")
    numbers, deep = CHANNELS[name], name.endswith("16") or name.startswith("16uc")
    lines = lines_of(found, numbers * (1 + deep), height * 3 // 2 if name.startswith("nv") else height)
    if deep:
        order = ">u2" if found.is_bigendian else "<u2"
        lines = _in_bytes(np.ascontiguousarray(lines).view(order).astype(float))
    if name.startswith("bayer"):
        # A bayer pattern named by its first row and column, where OpenCV names it by the second.
        cv2 = opencv()
        codes = {"rggb": cv2.COLOR_BayerBG2GRAY, "bggr": cv2.COLOR_BayerRG2GRAY,
                 "gbrg": cv2.COLOR_BayerGR2GRAY, "grbg": cv2.COLOR_BayerGB2GRAY}  # fmt: skip
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(lines), codes[name[6:10]]), np.uint8)
    pixels = lines.reshape(height, width, numbers)
    if numbers == 2:
        return np.asarray(pixels[..., 0 if "yuy" in name else 1])
    if numbers == 1:
        return np.asarray(pixels[..., 0])
    red, blue = (0, 2) if name.startswith("rgb") else (2, 0)
    weights = np.zeros(numbers)
    weights[[red, 1, blue]] = 0.299, 0.587, 0.114  # of ITU-R BT.601
    return np.asarray(np.round(pixels @ weights), np.uint8)


def lines_of(found: Any, pixel: int, rows: int) -> AnyArray:
    """The lines (height, bytes) of a raw image whose pixels have so many bytes, of which the message holds `rows`."""
    height, length, step = int(found.height), int(found.width) * pixel, int(found.step)
    data = np.frombuffer(bytes(found.data), np.uint8)
    if min(height, length) < 1 or step < length or len(data) < rows * step:
        raise Unusable("whose bytes do not make an image of the size that they state")
    return data[: rows * step].reshape(rows, step)[:height, :length]


def _in_bytes(image: AnyArray) -> AnyArray:
    """An image of sixteen bits from its darkest hundredth to its brightest: cameras use as many bits as they have."""
    low, high = np.percentile(image, (1.0, 99.0))
    return np.asarray(np.clip((image - low) / max(high - low, 1.0) * 255.0, 0.0, 255.0), np.uint8)


def opencv() -> Any:
    """OpenCV. MissingExtraError where it is not installed."""
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("images need OpenCV; install it with `pip install teamslam[tags]`") from None
    return cv2
