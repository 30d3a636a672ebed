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
            object.__setattr__(record, name, read_only(array))


def read_only(array: AnyArray) -> AnyArray:
    """The same numbers, not to be written into."""
    view = array.view()
    view.flags.writeable = False
    return view


class Sealed:
    """A record whose arrays are read-only; so are those of its copies, pickled or deep."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        kept = {name: read_only(v) if isinstance(v, np.ndarray) else v for name, v in state.items()}
        vars(self).update(kept)


class FrozenDict(dict[Any, Any]):
    """A dictionary that is never changed; `dict(...)` and `|` make one that can be."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise TypeError("this is part of a frozen record; dict(...) of it gives one to change")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> Any:
        return FrozenDict, (dict(self),)
