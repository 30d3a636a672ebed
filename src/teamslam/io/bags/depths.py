"""Images of depth: how deep the faces of tags were in them.

A topic of raw images (16UC1 in millimetres, 32FC1 in metres) or of what `compressed_depth_image_transport` makes of
them, registered to the images in which tags are seen: pixel for pixel, depth along that camera's axis. An image of
depth belongs to the nearest one in which tags were seen, not more than MERGE_S away. Those that cannot be read are
counted, and so are sightings of tags that no image of depth is near enough to.
"""

import struct
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.depth import TagDepths, depths_on
from teamslam.geometry import Array, IntArray
from teamslam.io.bags.opened import Recording
from teamslam.io.bags.pictures import Unusable, lines_of, opencv, pictures_of_topic
from teamslam.io.bags.seen import MERGE_S, View
from teamslam.model import Dropped

METRES = {"16uc1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32fc1": ("f4", 1.0)}
"""Encodings that hold depths: how a number is kept, and its unit [m]."""
CONFIG = struct.Struct("<iff")  # before a compressed image: its format, and how floats were made whole numbers


@dataclass(frozen=True, eq=False)
class Deep:
    """A view with its depths, what was left out, and a line on how many there are."""

    view: View
    dropped: list[Dropped]
    note: str


def with_depths(view: View, recording: Recording, who: str) -> Deep:
    """What a camera's images of depth, on the topic that its entry names, say of the tags that it saw. InputError where
    there is no such topic of images, where all of them are of another size than the images that they are registered to,
    or nobody told that size."""
    topic, size = view.entry.depth, view.camera.size
    if not any(size):
        raise InputError(
            f"camera {view.entry.name} has images of depth, so its calibration needs the size of its images",
            field="robot.camera.depth",
        )
    pictures_of_topic(recording, topic)  # refuses what holds no images
    frames = view.corners.frames
    order, near = np.argsort(frames, kind="stable"), round(MERGE_S * TICKS_PER_S)
    in_time = frames[order]
    of_frame = [np.flatnonzero(view.corners.frame == frame) for frame in range(len(frames))]
    best = np.full(len(frames), near + 1)
    parts, lost, others = dict[int, TagDepths](), Counter[str](), Counter[tuple[int, int]]()
    stamps: list[int] = []
    for message in recording.messages([topic]) if len(view.corners) else ():
        stamps.append(message.tick)
        frame = int(order[_nearest(in_time, message.tick)])
        away = abs(int(frames[frame]) - message.tick)
        if away >= best[frame] or not len(of_frame[frame]) or (image := recording.decode(message)) is None:
            continue
        try:
            depths = _metres(image)
        except Unusable as error:
            lost[str(error)] += 1
            continue
        height, width = depths.shape
        if (width, height) != size:
            others[width, height] += 1
            continue
        best[frame] = away
        parts[frame] = depths_on(depths, view.corners.corners[of_frame[frame]])
    if others and not parts:
        (width, height), _ = others.most_common(1)[0]
        raise InputError(
            f"camera {view.entry.name}: its images of depth are {width} x {height} pixels, and its calibration is for "
            f"{size[0]} x {size[1]}; depth must be registered to the images in which tags are seen",
            field="robot.camera.depth",
        )
    dropped = [Dropped(count, f"{who}: images of depth {reason}") for reason, count in lost.items()]
    dropped += [
        Dropped(count, f"{who}: images of depth of {w} x {h} pixels, where the camera has {size[0]} x {size[1]}")
        for (w, h), count in others.items()
    ]
    dropped += _too_far(view, np.sort(np.array(stamps, np.int64)), who)
    each = [parts.get(frame, TagDepths.nothing(len(rows))) for frame, rows in enumerate(of_frame)]
    found = TagDepths.together(each).select(np.argsort(np.concatenate([np.zeros(0, np.int64), *of_frame])))
    note = f"{who}: depths of {np.count_nonzero(found.told)} of {len(view.corners)} sightings"
    return Deep(replace(view, depths=found), dropped, note)


def _too_far(view: View, stamps: IntArray, who: str) -> list[Dropped]:
    """The sightings that have no image of depth, of those at rising `stamps`, near enough in time."""
    if not len(stamps) or not len(view.corners):
        return []
    ticks = view.corners.ticks
    away = np.abs(ticks - stamps[[_nearest(stamps, tick) for tick in ticks.tolist()]])
    far = away > round(MERGE_S * TICKS_PER_S)
    if not far.any():
        return []
    usual = 1e3 * float(np.median(away[far])) / TICKS_PER_S
    reason = (
        f"{who}: depths of sightings whose nearest image of depth is more than {1e3 * MERGE_S:g} ms from theirs (in "
        f"the median {usual:.1f} ms); depths count where both are taken at once"
    )
    return [Dropped(int(np.count_nonzero(far)), reason)]


def _nearest(ticks: IntArray, tick: int) -> int:
    """Which of some rising ticks is nearest to one."""
    after = int(np.searchsorted(ticks, tick))
    first = max(after - 1, 0)
    return first + int(np.argmin(np.abs(ticks[first : after + 1] - tick)))


def _metres(found: Any) -> Array:
    """An image of depths (h, w) [m]; 0 and what is no number where nothing was measured."""
    if not hasattr(found, "encoding"):
        return _unpacked(str(found.format).lower(), bytes(found.data))
    name = str(found.encoding).lower()
    if name not in METRES:
        raise Unusable(f"of an encoding that holds no depths, {found.encoding!r}")
    kept, unit = METRES[name]
    lines = lines_of(found, int(kept[1]), int(found.height))
    return np.asarray(
        unit * np.ascontiguousarray(lines).view((">" if found.is_bigendian else "<") + kept).astype(float)
    )


def _unpacked(format: str, data: bytes) -> Array:
    """What compressed_depth_image_transport made of an image: whole numbers as PNG; of metres a, b with 1/Z by them."""
    cv2 = opencv()
    if "compresseddepth" not in format or len(data) <= CONFIG.size:
        raise Unusable(f"that were compressed as {format!r}; expected compressedDepth")
    _, a, b = CONFIG.unpack_from(data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8, offset=CONFIG.size), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise Unusable("that cannot be decompressed")
    if format.startswith("16uc1"):
        return np.asarray(1e-3 * image)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(image > 0, a / (image - b), np.nan), float)
