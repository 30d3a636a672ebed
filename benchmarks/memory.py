"""The peak memory of this process [MB], counted afresh from a moment on."""

import resource
from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def forget_peak() -> float:
    """Start counting anew (where the system allows it); the memory in use now."""
    if _RESET.exists():
        _RESET.write_text("5")
    return peak_mb()


def peak_mb() -> float:
    """The most memory in use at any one time since `forget_peak`."""
    if not _STATUS.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024.0
