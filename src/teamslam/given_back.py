"""Memory that is free goes back to the system.

The C library keeps what was freed, in pieces, for whoever asks next. A robot that stands after exact rounds would keep
what they worked with for good. Where the C library has no such call (it is glibc's) nothing is done.
"""

import ctypes
import sys


def give_back() -> None:
    """Give back all that is free; some milliseconds."""
    if sys.platform == "win32":  # nothing is to be had there without a library's name
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
