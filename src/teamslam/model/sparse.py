"""scipy.sparse, loaded without what it takes along.

It copies all of numpy's names for itself, and so loads what numpy leaves to those who ask for it: a compiler of Fortran
and tools for tests, which take as long to load as scipy.sparse does without them.
"""

from typing import Any

import numpy as np

ASKED_FOR = ("f2py", "testing")

_names, _shown = vars(np), [name for name in dir(np) if name not in ASKED_FOR]
_before: dict[str, Any] = {name: _names[name] for name in ("__all__", "__dir__") if name in _names}
_names["__all__"], _names["__dir__"] = [name for name in np.__all__ if name not in ASKED_FOR], lambda: _shown
try:
    import scipy.sparse as sp
finally:
    _names.update(_before)

__all__ = ["sp"]
