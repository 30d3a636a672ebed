"""Files in and out: logs, submaps, trajectories. `formats` holds the table of formats."""

from teamslam.io.formats import FORMATS, SUBMAP_FORMATS, Format, read, read_submaps, write, write_submaps

__all__ = ["FORMATS", "SUBMAP_FORMATS", "Format", "read", "read_submaps", "write", "write_submaps"]
