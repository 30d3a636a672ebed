"""Maps and truths from whatever the user points at."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.model import Submap, Values


def maps_in(path: Path) -> "tuple[Submap, ...]":
    """The maps in a run folder or in a file of maps."""
    from teamslam.io import read_submaps
    from teamslam.results import is_run, read_run

    return read_run(path).maps if is_run(path) else tuple(read_submaps(path))


def truth_in(path: Path) -> "Values":
    """The truth in a log, or the map of another run or in a file of maps. InputError where there is none."""
    from teamslam.errors import InputError
    from teamslam.io import formats_of, read, read_maps
    from teamslam.results import is_run, read_run

    if path.is_dir() and is_run(path):
        return read_run(path).maps[0].all_values
    if [kind for kind, _ in formats_of(path)] == ["map"]:
        return read_maps(path)[0].values
    truth = read(path).truth
    if truth is None:
        raise InputError("this log holds no truth; there is nothing to score against", path=path)
    return truth
