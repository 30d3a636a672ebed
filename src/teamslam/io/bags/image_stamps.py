"""When images were taken, from a list beside them: a line each, as data sets have it.

    1403636579763555584,1403636579763555584.png      EuRoC: nanoseconds, file
    1305031102.175304 rgb/1305031102.175304.png      TUM: seconds, file
    frame_0012.jpg 12.45                             file, seconds
    12.45                                            seconds, of one image after another (videos)

Lines that begin with '#', and a first line without a number, are headings.
"""

import re
from pathlib import Path, PurePosixPath

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.geometry import IntArray
from teamslam.io.files.delimited import read_text

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
NANOSECONDS = 15  # digits of a whole number that is no count of seconds


def read_stamps(path: Path) -> tuple[tuple[str, ...], IntArray]:
    """Names of files ('' where none is given) and when each was taken [ticks], in the order of the list. InputError
    names the line that is no stamp, or steps back."""
    names: list[str] = []
    ticks: list[int] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        cells = [cell for cell in re.split(r"[,;\s]+", line.strip()) if cell]
        if not cells or cells[0].startswith("#"):
            continue
        stamp = next((cell for cell in cells if NUMBER.fullmatch(cell)), None)
        if stamp is None:
            if not ticks:
                continue
            raise InputError(
                f"no stamp in '{line.strip()[:60]}'; expected seconds, or nanoseconds", path=path, line=number
            )
        names.append(next((PurePosixPath(cell).name for cell in cells if not NUMBER.fullmatch(cell)), ""))
        ticks.append(tick_of(stamp))
        if len(ticks) > 1 and ticks[-1] <= ticks[-2]:
            raise InputError("this stamp is not after the one before", path=path, line=number)
    if not ticks:
        raise InputError("no stamps in it; expected a line for each image: its stamp, and its file", path=path)
    return tuple(names), np.array(ticks, np.int64)


def tick_of(stamp: str) -> int:
    """A stamp in microseconds: nanoseconds where it is a whole number of many digits, else seconds."""
    if stamp.isdigit() and len(stamp) >= NANOSECONDS:
        return int(stamp) // 1000
    return round(float(stamp) * TICKS_PER_S)
