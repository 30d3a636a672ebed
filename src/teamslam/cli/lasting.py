"""A command that goes on for hours: it looks for garbage as often as Python does, unlike one that ends soon.

Garbage is circles of objects; a robot makes none itself, but what it calls may. What was there when it began is not
looked through again and again, so that looking costs a step next to nothing.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

OFTEN = (700, 10, 10)  # Python's own


@contextmanager
def lasting() -> Iterator[None]:
    """While it goes on, garbage is looked for often, and only among what is new."""
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(*OFTEN)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
