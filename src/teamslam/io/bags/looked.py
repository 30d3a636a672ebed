"""Tags in the images of a topic or a folder, looked for once: what was found stays on the disk, by the content of the
recording and how was looked, so that a run which was broken off goes on, and the next one begins with its map.

Parts of PART images each lie in `$XDG_CACHE_HOME/teamslam/tags` (without it, in `~/.cache`); deleting them costs time
only. Threads share the work: the library lets others run while it looks.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import blake2b
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from threading import local

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.detect import Detector, Found, Looking, library_of_tags
from teamslam.geometry import AnyArray, IntArray
from teamslam.io.bags.pictures import Picture, Pictures, Unusable
from teamslam.io.files.npz import read_arrays
from teamslam.io.files.whole import whole_file

Progress = Callable[[str, int, int], None]
PART = 64
LAYOUT = "6"  # of the parts on the disk
FIELDS = ("frames", "sizes", "frame", "ids", "corners", "hamming", "families", "widths", "lost")


@dataclass(frozen=True, eq=False)
class Looked:
    """What was found: the tags, how large the images are (width, height; 0 without any), and how many could not be used
    for each reason."""

    corners: TagCorners
    size: tuple[int, int]
    lost: dict[str, int]


def tags_in(pictures: Pictures, looking: Looking, progress: Progress | None = None, stage: str = "tags") -> Looked:
    """The tags in images. What an earlier call found in the same images, looking the same way, is taken from the disk.
    Images that are not of the size of most are left out, and counted. MissingExtraError without the library."""
    library_of_tags()
    tell = progress or (lambda stage, done, of: None)
    folder, parts, done = cache() / _key(pictures, looking), [], 0
    tell(stage, 0, pictures.count)
    mine = local()

    def look(picture: Picture) -> Found | str:
        if not hasattr(mine, "detector"):
            mine.detector = Detector(looking)
        try:
            found: Found = mine.detector(picture.grey())
        except Unusable as error:
            return str(error)
        return found

    with ThreadPoolExecutor(os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count()) as crew:
        each = pictures.each()
        for number in range(1 << 30):
            chunk = list(islice(each, PART))
            if not chunk:
                break
            path = folder / f"{number:06d}.npz"
            part = _kept(path, chunk)
            if part is None:
                part = _part(chunk, _told(crew.map(look, chunk), tell, stage, done, pictures.count))
                with whole_file(path) as file:
                    np.savez_compressed(file, **part)  # type: ignore[arg-type]
            parts.append(part)
            done += len(chunk)
            tell(stage, done, pictures.count)
    tell(stage, max(done, pictures.count), pictures.count)
    return _together(parts)


def cache() -> Path:
    """The folder of what was found."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "teamslam" / "tags"


def _key(pictures: Pictures, looking: Looking) -> str:
    words = [LAYOUT, version("apriltag-python"), pictures.content, *looking.families, repr(looking.decimate)]
    return blake2b("\0".join(words).encode(), digest_size=16).hexdigest()


def _told(found: Iterator[Found | str], tell: Progress, stage: str, done: int, count: int) -> Iterator[Found | str]:
    for k, one in enumerate(found, 1):
        tell(stage, done + k, max(count, done + k))
        yield one


def _kept(path: Path, chunk: Sequence[Picture]) -> dict[str, AnyArray] | None:
    """A part from the disk, if it is there, whole, and of these images."""
    try:
        arrays = read_arrays(path)
        part = {name: arrays[name] for name in FIELDS}
    except Exception:  # not there, cut short, or of another layout: looked for again
        return None
    return part if len(part["frames"]) + len(part["lost"]) == len(chunk) else None


def _part(chunk: Sequence[Picture], found: Iterator[Found | str]) -> dict[str, AnyArray]:
    frames: list[int] = []
    frame: list[int] = []
    tags: list[Found] = []
    lost: list[str] = []
    for picture, one in zip(chunk, found, strict=True):
        if isinstance(one, str):
            lost.append(one)
            continue
        frame += [len(frames)] * len(one.ids)
        frames.append(picture.tick)
        tags.append(one)
    families = [name for seen in tags for name in seen.families]
    return {
        "frames": np.array(frames, np.int64),
        "sizes": np.array([seen.size for seen in tags], np.int64).reshape(-1, 2),
        "frame": np.array(frame, np.int64),
        "ids": _rows([seen.ids for seen in tags], ()).astype(np.int64),
        "corners": _rows([seen.corners for seen in tags], (4, 2)),
        "hamming": _rows([seen.hamming for seen in tags], ()).astype(np.int64),
        "families": np.array(families, np.str_),
        "widths": _rows([seen.widths for seen in tags], (4,)),
        "lost": np.array(lost, np.str_),
    }


def _rows(arrays: Sequence[AnyArray], shape: tuple[int, ...]) -> AnyArray:
    return np.concatenate([np.zeros((0, *shape)), *arrays])


def _together(parts: Sequence[dict[str, AnyArray]]) -> Looked:
    """All parts as one; images of another size than most are left out."""
    if not parts:
        parts = [_part([], iter(()))]
    all_ = {name: np.concatenate([part[name] for part in parts]) for name in FIELDS}
    offsets = np.cumsum([0, *(len(part["frames"]) for part in parts[:-1])])
    frame: IntArray = np.concatenate([part["frame"] + start for part, start in zip(parts, offsets, strict=True)])
    lost = Counter(str(reason) for reason in all_["lost"])
    sizes, of, counts = np.unique(all_["sizes"], axis=0, return_inverse=True, return_counts=True)
    usual = of.reshape(-1) == np.argmax(counts) if len(sizes) else np.zeros(0, bool)
    if not usual.all():
        width, height = sizes[np.argmax(counts)].tolist()
        lost[f"of another size than {width} x {height}, as most are"] += int(np.count_nonzero(~usual))
    rows, place = usual[frame], np.cumsum(usual) - 1
    corners = TagCorners(
        all_["frames"][usual],
        place[frame[rows]],
        all_["ids"][rows],
        all_["corners"][rows],
        all_["hamming"][rows],
        tuple(map(str, all_["families"][rows])),
        all_["widths"][rows],
    )
    size = tuple(sizes[np.argmax(counts)].tolist()) if len(sizes) else (0, 0)
    return Looked(corners, size, dict(lost))


def refuse_other_size(size: tuple[int, int], calibrated: tuple[int, int], camera: str) -> None:
    """InputError where images are not of the size for which a camera is calibrated (0: it does not say)."""
    if any(size) and any(calibrated) and size != calibrated:
        raise InputError(
            f"camera {camera}: its images are {size[0]} x {size[1]} pixels, and its calibration is for "
            f"{calibrated[0]} x {calibrated[1]}; calibrate it as it films, or scale the calibration",
            field="robot.camera.calibration",
        )
