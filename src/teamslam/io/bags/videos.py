"""Videos as images: when each was taken is what the container says, or a list of stamps beside it.

A container's stamps count from its beginning. Where they do not grow (cameras that write none), its rate counts, and it
is said so.
"""

import os
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import time
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.geometry import AnyArray, IntArray
from teamslam.io.bags.pictures import Picture, Pictures, digest, opencv, stamped
from teamslam.io.files.whole import beside

SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mjpeg", ".ts", ".wmv")


def is_video(path: Path) -> bool:
    """Whether a path looks like a video: by its ending."""
    return path.is_file() and path.suffix.lower() in SUFFIXES


def pictures_of_video(
    path: Path, rate_hz: float | None = None, stamps: IntArray | None = None, every: int = 1
) -> Pictures:
    """The images of a video, every so many. They were taken as `stamps` [ticks] say, or `rate_hz`, else as the
    container does. InputError where it cannot be read, holds no image, or has another number of them than of stamps."""
    with _open(path) as film:
        count = max(int(film.get(opencv().CAP_PROP_FRAME_COUNT)), 0)
        if not film.grab():
            raise InputError(
                "the video holds no image that can be read; was it closed when it was recorded?", path=path
            )
    ticks = stamps if stamps is not None else _ticks(path, rate_hz)
    if stamps is not None and count and abs(count - len(stamps)) > max(1, count // 100):
        raise InputError(f"the video has {count} images, and there are {len(stamps)} stamps for them", path=path)

    def each() -> Iterator[Picture]:
        with _open(path) as film:
            for number, tick in enumerate(ticks.tolist()):
                if not film.grab():
                    return
                if number % every == 0:
                    good, image = film.retrieve()
                    if good:
                        yield Picture(tick, lambda image=image: _in_grey(image))  # type: ignore[misc]

    return Pictures(path.name, digest([path], f"{every} {stamped(ticks.tolist())}"), -(-len(ticks) // every), each)


def filmed_now(device: str, rate_hz: float | None = None) -> Generator[Picture]:
    """The images of a camera as it films: `device` is its number, or a path: of a device (v4l2), or of a film or a pipe
    that plays one. They were taken when the device says; where it does not, when they came. Of a device the newest
    image is next, however long the one before took: those between are not waited for. InputError where there is none.
    """
    cv2 = opencv()
    is_device = device.isdigit() or device.startswith("/dev/")
    film = cv2.VideoCapture(int(device) if device.isdigit() else device, cv2.CAP_ANY if is_device else cv2.CAP_FFMPEG)
    try:
        if not film.isOpened():
            raise InputError(f"no camera films at {device}; expected a number, as 0, or a path, as /dev/video0")
        if is_device:
            film.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        start, before = (time() if is_device else 0.0), None
        for number in range(1 << 62):
            if not film.grab():
                return
            came, at = time(), float(film.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
            if rate_hz is not None and not is_device:
                at = number / rate_hz
            if is_device and number == 0:
                start -= at
            stamp = start + at if before is None or start + at > before else came
            before = stamp
            good, image = film.retrieve()
            if good:
                yield Picture(round(stamp * TICKS_PER_S), lambda image=image: _in_grey(image))  # type: ignore[misc]
    finally:
        film.release()


def write_video(path: Path, images: Iterable[AnyArray], rate_hz: float) -> None:
    """Grey images (h, w) of bytes as a video of JPEGs (.avi). InputError where there is something already, or none."""
    cv2 = opencv()
    if path.suffix.lower() != ".avi":
        raise InputError("videos are written as .avi", path=path)
    draft = beside(path).with_suffix(".avi")
    film = None
    try:
        for image in images:
            if film is None:
                shape = image.shape[1], image.shape[0]
                film = cv2.VideoWriter(str(draft), cv2.VideoWriter_fourcc(*"MJPG"), rate_hz, shape, isColor=False)
                film.set(cv2.VIDEOWRITER_PROP_QUALITY, 98)
            film.write(image)
        if film is None:
            raise InputError("a video of no image", path=path)
        film.release()
        draft.rename(path)
    finally:
        draft.unlink(missing_ok=True)


def _ticks(path: Path, rate_hz: float | None) -> IntArray:
    """When each image was taken, in microseconds from the beginning."""
    cv2 = opencv()
    with _open(path) as film:
        stated = float(film.get(cv2.CAP_PROP_FPS))
        found = []
        while film.grab():
            found.append(float(film.get(cv2.CAP_PROP_POS_MSEC)))
    ticks = np.round(np.array(found) * 1e-3 * TICKS_PER_S)
    if rate_hz is None and len(ticks) > 1 and (np.diff(ticks) > 0.0).all() and np.isfinite(ticks).all():
        return ticks.astype(np.int64)
    rate = rate_hz or stated
    if not (np.isfinite(rate) and 0.1 < rate < 1e4):
        raise InputError(
            "the video says neither when its images were taken nor how many there are a second; say so with rate_hz",
            path=path,
            field="robot.camera.rate_hz",
        )
    return np.round(np.arange(len(ticks)) / rate * TICKS_PER_S).astype(np.int64)


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # damage is told once, by us
    cv2 = opencv()
    log = cv2.utils.logging
    before = log.setLogLevel(log.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        if not film.isOpened():
            raise InputError("not a video that can be read; was it closed when it was recorded?", path=path)
        yield film
    finally:
        film.release()
        log.setLogLevel(before)


def _in_grey(image: Any) -> Any:
    cv2 = opencv()
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
