"""Files in and out: logs, submaps, trajectories. `formats` holds the table of formats."""

from teamslam.io.formats import (
    FORMATS,
    MAP_FORMATS,
    SUBMAP_FORMATS,
    Format,
    formats_of,
    read,
    read_log,
    read_maps,
    read_submaps,
    write,
    write_maps,
    write_submaps,
)
from teamslam.io.maps.estimate import MapEstimate

__all__ = [
    "FORMATS",
    "MAP_FORMATS",
    "SUBMAP_FORMATS",
    "Format",
    "MapEstimate",
    "formats_of",
    "read",
    "read_log",
    "read_maps",
    "read_submaps",
    "write",
    "write_maps",
    "write_submaps",
]
