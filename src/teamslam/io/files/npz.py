"""Arrays by name in one file (.npz), as numpy reads them; packed at the speed of writing.

numpy packs as small as it can, which takes longer than to map a team, for a tenth less of the size.
"""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from teamslam.geometry import AnyArray

LEVEL = 1  # of 9


def write_arrays(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Writes arrays. Law: np.load(path) has the same arrays by the same names."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array), allow_pickle=False)
