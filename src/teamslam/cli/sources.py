"""Maps and truths from whatever the user points at."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.model import Names, Submap, Values


@dataclass(frozen=True, eq=False)
class Truth:
    """What a map is compared with, each part with its names: the truth in a log, one `sampled` at stamps of its own, or
    the maps of another run (`is_map`)."""

    parts: "tuple[tuple[Values, Names], ...]"
    is_map: bool
    sampled: bool = False

    def of(self, map: "Submap") -> "Values":
        """The part that knows most of a map, under the map's own keys. InputError where times cannot be compared."""
        from teamslam.metrics import as_called, at_stamps_of

        if self.sampled:
            return max((at_stamps_of(map, values, names) for values, names in self.parts), key=len)
        return max((as_called(values, names, map) for values, names in self.parts), key=len)


def maps_in(path: Path) -> "tuple[Submap, ...]":
    """The maps in a run folder, in a file of submaps, or in a file that holds estimates alone, whose information is
    zero then."""
    from teamslam.io import formats_of, read_maps, read_submaps
    from teamslam.results import is_run, read_run

    if is_run(path):
        return read_run(path).maps
    if [kind for kind, _ in formats_of(path)] == ["map"]:
        return tuple(found.as_submap(path.stem) for found in read_maps(path))
    return tuple(read_submaps(path))


def truth_in(path: Path) -> Truth:
    """The truth in a log or in a file of true poses or places (TUM; CSV, by itself or in a log's folder), or the maps
    of another run or in a file of maps. InputError where there is none."""
    from teamslam.errors import InputError
    from teamslam.io import formats_of, read, read_maps
    from teamslam.results import is_run, read_run

    if path.is_dir() and is_run(path):
        return Truth(tuple((map.all_values, map.names) for map in read_run(path).maps), is_map=True)
    if {kind for kind, _ in formats_of(path)} == {"map"}:
        true = formats_of(path)[0][1] in ("tum", "truth")
        return Truth(tuple((map.values, map.names) for map in read_maps(path)), is_map=not true, sampled=true)
    if path.is_file() and path.suffix == ".csv":
        return Truth(tuple((map.values, map.names) for map in read_maps(path, "truth")), is_map=False, sampled=True)
    log = read(path)
    if log.truth is None:
        raise InputError("this log holds no truth; there is nothing to score against", path=path)
    return Truth(((log.truth, log.names),), is_map=False)
