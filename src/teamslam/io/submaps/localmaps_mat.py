"""I-SLSJF's local maps: a folder of localmap_1.mat, localmap_2.mat, ... in the plane.

`localmap_st` (n, 2) has rows (id, value): the end pose as three rows x, y, heading of id 0, then x, y for each feature;
`localmap_P` (n, n) is its covariance. See `localmaps` for what becomes of them.
"""

from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.mat import matrix, read_mat, whole
from teamslam.io.submaps.localmaps import chain, check_definite, numbered, submap_of
from teamslam.model import Submap


def sniff(path: Path) -> bool:
    """A folder with localmap_1.mat, or one such file."""
    return bool(numbered(path, ".mat"))


def read(path: Path) -> list[Submap]:
    """The maps of an I-SLSJF folder (or one file) in order. InputError names the file and the field at fault."""
    return [_read_map(file, number) for number, file in chain(path, ".mat")]


def _read_map(path: Path, number: int) -> Submap:
    content = read_mat(path)
    state = matrix(content, "localmap_st", 2, path)
    covariance = matrix(content, "localmap_P", len(state), path)
    if covariance.shape[0] != len(state):
        raise InputError(
            f"{len(state)} rows of localmap_st need a covariance ({len(state)}, {len(state)}), "
            f"found {covariance.shape}",
            path=path,
            field="localmap_P",
        )
    ids = whole(state[:, 0], "localmap_st", path)
    if not (ids[:3] == 0).all() or len(ids) < 3 or (ids[3:] <= 0).any():
        raise InputError(
            "the first three rows should have id 0 (the end pose) and all others the ids of features, above 0",
            path=path,
            field="localmap_st",
        )
    ids = np.where(ids == 0, -number, ids)
    information = _inverse(covariance, path, "localmap_P")
    return submap_of(path, number - 1, number, ids, state[:, 1], information, 2)


def _inverse(covariance: Array, path: Path, field: str) -> Array:
    from scipy.linalg import cho_factor, cho_solve

    check_definite(covariance, path, field)
    factor = cho_factor(0.5 * (covariance + covariance.T), lower=True)
    return np.asarray(cho_solve(factor, np.eye(len(covariance))))
