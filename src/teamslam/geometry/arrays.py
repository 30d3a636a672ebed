"""The array types that teamslam's signatures speak of."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
AnyArray = NDArray[Any]


def seal(record: object, *fields: str) -> None:
    """Make arrays of a frozen record read-only, so that frozen means frozen; whoever made them may still write."""
    for name in fields:
        array = getattr(record, name)
        if array.flags.writeable:
            view = array.view()
            view.flags.writeable = False
            object.__setattr__(record, name, view)
