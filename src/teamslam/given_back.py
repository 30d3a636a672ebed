"""Memory that is free goes back to the system.

The C library keeps what was freed, in pieces, for whoever asks next, and what a thread has freed for threads like it. A
robot that stands after exact rounds would keep what they worked with for good. Where the C library has no such calls
(they are glibc's) nothing is done.
"""

import ctypes
import sys
from typing import Any

M_ARENA_MAX = -8  # of glibc's malloc.h


def share() -> None:
    """What one thread frees any other takes from now on; for a process that has no threads yet."""
    if (mallopt := _of_the_c_library("mallopt")) is not None:
        mallopt(ctypes.c_int(M_ARENA_MAX), ctypes.c_int(1))


def give_back() -> None:
    """Give back all that is free; some milliseconds."""
    if (trim := _of_the_c_library("malloc_trim")) is not None:
        trim(ctypes.c_size_t(0))


def _of_the_c_library(name: str) -> Any:
    """A function of it; None where it has none."""
    if sys.platform == "win32":  # nothing is to be had there without a library's name
        return None
    return getattr(ctypes.CDLL(None), name, None)
