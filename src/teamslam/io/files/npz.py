"""Arrays by name in one file (.npz), as numpy reads them; packed at the speed of writing.

Whole numbers (keys, indices) shrink to a tenth and are packed, quickly. Floating point numbers are stored as they are:
to pack them, as small as numpy can, takes longer than to map a team.
"""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from threading import Lock

import numpy as np

from teamslam.geometry import AnyArray

LEVEL = 1  # of 9
READING = Lock()
"""numpy has Python parse what an array is, and in Python 3.11 two threads that parse at once now and then end in a
SystemError (python/cpython issue 106905)."""


def write_arrays(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Writes arrays. Law: np.load(path) has the same arrays by the same names."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asarray(array), allow_pickle=False)
            packing = zipfile.ZIP_STORED if np.asarray(array).dtype.kind == "f" else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getbuffer(), packing, LEVEL)


def read_arrays(path: Path) -> dict[str, AnyArray]:
    """All arrays of a file, from any thread. Raises what numpy does where it is none."""
    with READING, path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        return dict(file)
