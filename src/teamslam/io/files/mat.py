"""MATLAB files (.mat, up to version 7): named matrices, checked at the door."""

import warnings
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray


def read_mat(path: Path) -> dict[str, Array]:
    """The numeric matrices of a .mat file by name. InputError where the file is missing, damaged or of version 7.3."""
    from scipy.io import loadmat

    if path.is_dir():
        raise InputError("expected a .mat file, found a folder", path=path)
    if not path.exists():
        raise InputError("there is no such file; check the path", path=path)
    if path.stat().st_size == 0:
        raise InputError("the file is empty", path=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = loadmat(path)
    except NotImplementedError:
        raise InputError("MATLAB 7.3 files are not read; save it again with '-v7'", path=path) from None
    except MemoryError:
        raise InputError("the file states sizes beyond memory; it is damaged", path=path) from None
    except Exception as error:  # loadmat lets out errors of many kinds on damaged files
        raise InputError(f"this is no readable MATLAB file ({error or type(error).__name__})", path=path) from None
    return {
        name: np.asarray(value, float)
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim == 2
    }


def matrix(content: dict[str, Array], name: str, columns: int | None, path: Path) -> Array:
    """One matrix of a .mat file, finite and of so many columns. InputError otherwise."""
    if name not in content:
        found = ", ".join(sorted(content)) or "no matrix at all"
        raise InputError(f"expected a matrix '{name}', found {found}", path=path)
    value = content[name]
    if columns is not None and value.shape[1] != columns:
        raise InputError(f"expected {columns} columns, found {value.shape[1]}", path=path, field=name)
    if len(value) == 0:
        raise InputError("the matrix is empty", path=path, field=name)
    finite = np.isfinite(value).all(1)
    if not finite.all():
        raise InputError(
            f"row {int(np.flatnonzero(~finite)[0]) + 1} holds a number that is not finite", path=path, field=name
        )
    return value


def whole(numbers: Array, name: str, path: Path) -> IntArray:
    """Numbers that are meant as indices, as int64. InputError where one is not whole or beyond 2^51."""
    if (numbers != np.round(numbers)).any() or (np.abs(numbers) >= 2**51).any():
        bad = int(np.flatnonzero((numbers != np.round(numbers)) | (np.abs(numbers) >= 2**51))[0])
        raise InputError(f"row {bad + 1}: expected a whole number, found {numbers[bad]}", path=path, field=name)
    return np.asarray(numbers, np.int64)
