"""Local maps of other submap joiners, as submaps: what their file formats share.

A local map holds the robot's end pose and the features seen, in the frame of its start pose; map k starts where map
k - 1 ends, so the end pose of one is the base of the next: the chain of keys pose_key(robot, 0), (robot, 1), ...
Feature ids hold for the whole set. A state vector comes with one id a number: poses at or below zero (-id), features
above.

In the plane the chart of these files is that of teamslam. In space they add to angles a, b, c where
R = Rz(a) Ry(b) Rx(c); the information is turned into the mixed chart with dw = E(a, b, c) d(abc).
"""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import (
    Kind,
    Names,
    Sources,
    Stretch,
    Submap,
    Values,
    landmark_key,
    point_kind,
    pose_key,
    pose_kind,
)
from teamslam.model.sparse import sp

ROBOT = 1
SOURCE = "local maps"
NUMBERED = re.compile(r"(?:localmap|local_map|map)_?(\d+)", re.IGNORECASE)


def submap_of(
    path: Path, base: int, number: int, ids: IntArray, numbers: Array, information: Array, dim: int
) -> Submap:
    """The submap of a state vector with ids (poses at or below zero), its rows put in the order of a layout."""
    if base in (-ids[ids <= 0]).tolist():
        raise InputError(f"pose {base} is the frame of this map and stands among its variables too", path=path)
    parts: dict[Kind, tuple[list[int], list[Array], list[IntArray]]] = {}
    changes = np.flatnonzero(np.diff(ids)) + 1
    seen: set[int] = set()
    for rows in np.split(np.arange(len(ids)), changes):
        name = int(ids[rows[0]])
        size = (3 if dim == 2 else 6) if name <= 0 else dim
        noun = f"pose {-name}" if name <= 0 else f"feature {name}"
        if len(rows) != size:
            raise InputError(f"{noun} has {len(rows)} rows, expected {size} in {dim}D", path=path)
        if name in seen:
            raise InputError(f"{noun} stands twice; give every variable one place", path=path)
        seen.add(name)
        kind = pose_kind(dim) if name <= 0 else point_kind(dim)
        keys, values, places = parts.setdefault(kind, ([], [], []))
        keys.append(int(pose_key(ROBOT, -name) if name <= 0 else landmark_key(name)))
        values.append(numbers[rows])
        places.append(rows)
    pieces: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    order: list[IntArray] = []
    jacobian = np.eye(len(ids))
    for kind in sorted(parts):
        keys, values, places = parts[kind]
        sorting = np.argsort(keys)
        table = np.stack(values)
        pieces[kind] = (np.array(keys, np.int64), _poses(table) if kind.is_pose else table)
        order += [places[k] for k in sorting]
        if kind is Kind.POSE3:
            if (np.abs(np.cos(table[:, 4])) < 1e-6).any():
                raise InputError(
                    "a pose's second angle is at 90 degrees, where its angles are not determined", path=path
                )
            for rows, row in zip(places, table, strict=True):
                jacobian[np.ix_(rows[3:], rows[3:])] = np.linalg.inv(rates(row[3:]))
    if dim == 3:
        information = jacobian.T @ information @ jacobian
    rows = np.concatenate(order)
    information = 0.5 * (information + information.T)[np.ix_(rows, rows)]
    return Submap(
        id=f"{ROBOT}/{number}",
        version=1,
        base=int(pose_key(ROBOT, base)),
        base_dim=dim,
        values=Values.of(pieces),
        information=sp.csr_array(information),
        sources=Sources({Stretch(ROBOT, SOURCE, number, number + 1)}),
        names=Names(tick_s=1.0),
        rows=len(ids),
    )


def _poses(table: Array) -> Pose:
    """Poses from rows (n, 3) x, y, heading or (n, 6) x, y, z and the angles about z, y, x."""
    if table.shape[1] == 3:
        return Pose.from_xytheta(table)
    a, b, c = table[:, 3], table[:, 4], table[:, 5]
    sa, ca, sb, cb, sc, cc = np.sin(a), np.cos(a), np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    rotation = np.stack(
        [
            np.stack([ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc], -1),
            np.stack([sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc], -1),
            np.stack([-sb, cb * sc, cb * cc], -1),
        ],
        -2,
    )
    return Pose(rotation, table[:, :3].copy())


def rates(angles: Array) -> Array:
    """E (3, 3) with dw = E d(abc): the body's turning from the angles'. Singular at b = +-90 degrees."""
    _, b, c = angles
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    return np.array([[-sb, 0.0, 1.0], [cb * sc, cc, 0.0], [cb * cc, -sc, 0.0]])


def check_definite(matrix: Array, path: Path, field: str) -> None:
    scale = np.abs(matrix).max(initial=0.0)
    if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-6 * scale:
        raise InputError("the matrix is not symmetric", path=path, field=field)
    try:
        np.linalg.cholesky(0.5 * (matrix + matrix.T))
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0])
        raise InputError(
            f"the matrix is not positive definite (smallest eigenvalue {smallest:.3g}); "
            f"a map that its measurements do not determine cannot be joined",
            path=path,
            field=field,
        ) from None


def numbered(path: Path, suffix: str) -> list[tuple[int, Path]]:
    """The numbered map files of a folder, or the one file, by rising number."""
    files = [path] if path.is_file() else sorted(path.glob(f"*{suffix}")) if path.is_dir() else []
    found = [
        (int(name.group(1)), file)
        for file in files
        if file.suffix == suffix and (name := NUMBERED.fullmatch(file.stem)) and len(name.group(1)) < 10
    ]
    return sorted(found)


def chain(path: Path, suffix: str) -> list[tuple[int, Path]]:
    """The numbered files, where map k must follow map k - 1. InputError for a gap or none at all."""
    found = numbered(path, suffix)
    if not found:
        raise InputError(f"expected files localmap_1{suffix}, localmap_2{suffix}, ..., found none", path=path)
    for (before, _), (after, file) in pairwise(found):
        if after != before + 1:
            raise InputError(
                f"map {after} should start where map {after - 1} ends, but the file before it is map {before}; "
                f"add the missing maps or read the two stretches apart",
                path=file,
            )
    if found[0][0] < 1:
        raise InputError("maps are numbered from 1", path=found[0][1])
    return found
