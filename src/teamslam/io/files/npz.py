"""Arrays by name in one file (.npz), as numpy reads them; packed at the speed of writing.

Whole numbers (keys, indices) shrink to a tenth and are packed, quickly. Floating point numbers are stored as they are:
to pack them, as small as numpy can, takes longer than to map a team.
"""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from teamslam.geometry import AnyArray

LEVEL = 1  # of 9


def write_arrays(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Writes arrays. Law: np.load(path) has the same arrays by the same names."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asarray(array), allow_pickle=False)
            packing = zipfile.ZIP_STORED if np.asarray(array).dtype.kind == "f" else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getbuffer(), packing, LEVEL)
