"""The shared library behind its C interface (cpp/api.h): loaded once, errors turned into ours, arrays checked."""

import ctypes
import os
from ctypes import c_char_p, c_double, c_int32, c_int64, c_void_p
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teamslam.errors import ModelError, TeamslamError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_FLOAT = np.dtype(np.float64)


class Numbers:
    """An argument that is a contiguous array, or None. The call itself keeps the array alive."""

    @classmethod
    def from_param(cls, array: NDArray[Any] | None) -> c_void_p | None:
        return None if array is None else c_void_p(array.__array_interface__["data"][0])


# P: a problem, analysis, factor or condensation, A: an array, I and L: integers, D: a number.
P, A, I, L, D = c_void_p, Numbers, c_int32, c_int64, c_double

# What each function returns and takes, in the order of cpp/api.h.
SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "error": (c_char_p, []),
    "set_threads": (None, [I]),
    "model_shape": (None, [I, I, A]),
    "sparse_rows": (I, [L, A, A, A, A, A, A, A]),
    "blocks_new": (P, [L, A, A, A, A, A]),
    "blocks_take": (None, [P, A, A, A]),
    "problem_new": (P, [L, A, A]),
    "problem_free": (None, [P]),
    "add_table": (L, [P, I, I, L, A, A, A, I, A, I, D]),
    "add_submap": (L, [P, L, L, A, A, A, A, A, A, A]),
    "add_submaps": (L, [P, L, A, A, A, A, A, A, A, A, A, A]),
    "add_blocks": (L, [P, L, L, A, L]),
    "set_weights": (I, [P, L, A]),
    "set_whitening": (I, [P, L, A, I]),
    "set_curvature": (I, [P, L, I]),
    "set_submap": (I, [P, L, A, A, A]),
    "set_homes": (I, [P, A]),
    "normal_equations": (I, [L, A, I, I, L, A, A, A, I, A, I, D, A, A, A, A]),
    "moved": (I, [L, A, A, A, A, A, I, I, L, A, A, A, I, A, I, D, I, L, P, A, I, I, A, A]),
    "seen": (I, [L, A, A, A, A, A, I, I, L, A, A, A, I, A, I, D, I, L, P, L, D, A, A]),
    "told": (I, [L, A, A, A, A, A, L, A, A, A, A, L, A, A, A]),
    "freeze": (I, [P, A]),
    "pattern": (None, [P, A, A, A]),
    "linearise": (I, [P, A, L, A, A, A, A, A]),
    "slope": (I, [P, A, A, A]),
    "cost": (I, [P, A, A]),
    "sharpest": (D, [P]),
    "residuals": (I, [P, L, A, A]),
    "jacobians": (I, [P, L, A, A]),
    "along": (I, [P, L, A, A, L, A]),
    "pull": (I, [P, L, A, A, L, A]),
    "fault": (I, [P, L, A, A]),
    "retract": (I, [P, A, A, A]),
    "analysis_new": (P, [L, A, A, A, I, A, A, I]),
    "analysis_free": (None, [P]),
    "factor_new": (P, [P]),
    "factor_free": (None, [P]),
    "factorise": (I, [P, A, A, A]),
    "solve": (I, [P, A, L]),
    "solve_lower": (I, [P, A, L]),
    "solve_upper": (I, [P, A, L]),
    "log_determinant": (D, [P]),
    "inverse_on_pattern": (I, [P, A]),
    "diagonal_inverse": (I, [P, A, L, A]),
    "eliminate": (I, [P, A, A, A, A, A, A]),
    "back_substitute": (I, [P, A, A]),
    "order": (None, [P, L, A]),
    "statistics": (None, [P, A]),
    "condensation_new": (P, [L, A, A, A, A, A, I, A]),
    "condensation_free": (None, [P]),
    "condensed_rows": (I, [P, A, A, A]),
    "follow": (I, [P, A, A]),
}


class Library:
    """The functions of the kernel as attributes, without their prefix."""

    def __init__(self, path: Path) -> None:
        try:
            loaded = ctypes.CDLL(str(path))
        except OSError as problem:
            raise TeamslamError(
                f"the native kernel could not be loaded ({problem}); build and install the package with 'pip install .'"
            ) from None
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(loaded, f"teamslam_{name}", None)
            if function is None:
                raise TeamslamError(
                    f"the native kernel {path} is of an older version (it has no '{name}'); build and install the "
                    "package again with 'pip install .'"
                )
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:  # for type checkers: every function is set in __init__
        raise AttributeError(name)


def _find() -> Path:
    """Beside the package; another build of it (a sanitiser's) can be named by TEAMSLAM_KERNEL."""
    named = os.environ.get("TEAMSLAM_KERNEL")
    if named:
        return Path(named)
    folder = Path(__file__).parent.parent
    return next(
        (p for p in sorted(folder.glob("_kernel.*")) if p.suffix in (".so", ".dylib", ".dll")), folder / "_kernel.so"
    )


library = Library(_find())


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_threads = 1


def set_threads(count: int) -> None:
    """Let the kernel use `count` threads from now on. Results do not depend on it, to the bit."""
    global _threads
    if count < 1:
        raise ModelError(f"threads: found {count}, expected at least 1")
    _threads = int(count)
    library.set_threads(_threads)


def threads() -> int:
    """How many threads the kernel uses; at first two, or one where there is only one processor."""
    return _threads


set_threads(min(2, _processors()))


def checked(result: int) -> int:
    """The result of a kernel function, or its complaint as a ModelError."""
    if result < 0:
        raise ModelError(library.error().decode())
    return result


def floats(name: str, given: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """`given` as contiguous float64 of one of the shapes (None: any length). Raises ModelError."""
    if (
        isinstance(given, np.ndarray) and given.dtype == _FLOAT and given.shape in shapes
    ):  # small ones come by the thousand
        return np.ascontiguousarray(given)
    return np.ascontiguousarray(_array(name, given, "fiu", "float64", shapes), np.float64)


def integers(name: str, given: ArrayLike, *shapes: tuple[int | None, ...]) -> Integers:
    """`given` as contiguous int64 of one of the shapes (None: any length). Raises ModelError."""
    return np.ascontiguousarray(_array(name, given, "iu", "int64", shapes), np.int64)


def indices(name: str, given: ArrayLike, length: int) -> NDArray[np.int32]:
    """`given` as contiguous int32 of a length, not copied where it is that already. Raises ModelError."""
    if isinstance(given, np.ndarray) and given.dtype == np.int32 and given.shape == (length,):
        return np.ascontiguousarray(given)
    wide = integers(name, given, (length,))
    if length and (wide.min() < 0 or wide.max() > np.iinfo(np.int32).max):
        raise ModelError(f"{name}: found {wide.min()} to {wide.max()}, expected 0 to {np.iinfo(np.int32).max}")
    return wide.astype(np.int32)


def _array(
    name: str, given: ArrayLike, kinds: str, wanted: str, shapes: tuple[tuple[int | None, ...], ...]
) -> NDArray[Any]:
    try:
        array = np.asarray(given)
    except (ValueError, TypeError) as problem:
        raise ModelError(f"{name}: not an array ({problem})") from None
    if array.dtype.kind not in kinds and array.size > 0:
        raise ModelError(f"{name}: found {array.dtype} numbers, expected {wanted}")
    for shape in shapes:
        if _fits(array.shape, shape):
            break
    else:
        expected = " or ".join(str(tuple("any" if n is None else n for n in shape)) for shape in shapes)
        raise ModelError(f"{name}: found shape {array.shape}, expected {expected}".replace("'", ""))
    return array


def _fits(found: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    if len(found) != len(expected):
        return False
    for have, want in zip(found, expected, strict=True):  # noqa: SIM110 (small problems come by the thousand)
        if want is not None and want != have:
            return False
    return True


class InKernel:
    """What lives in the kernel under a pointer: a copy of the pointer would outlive it, so there is none."""

    def __reduce__(self) -> NoReturn:
        raise TypeError(f"a kernel's {type(self).__name__} cannot be copied or pickled; make another of its pattern")
