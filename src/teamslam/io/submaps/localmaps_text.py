"""Linear SLAM's local maps: a folder of text files localmap_1.txt, localmap_2.txt, ..., in the plane or in space.

A file holds the id of the frame, n, n lines `id value`, and the (n, n) information matrix. Ids below or at zero are
poses (-id; 3 rows in the plane, 6 in space: x, y, z, then the angles about z, y, x), ids above zero are features (2 or
3 rows). See `localmaps` for what becomes of them. Source: Zhao, Huang, Dissanayake, "Linear SLAM", IROS 2013.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.delimited import read_text
from teamslam.io.files.mat import whole
from teamslam.io.files.text import text_of, write_text
from teamslam.io.submaps.localmaps import check_definite, numbered, rates, submap_of
from teamslam.model import Dropped, Kind, Submap, index_of, is_pose, point_kind, pose_kind, robot_of
from teamslam.model.sparse import sp


def sniff(path: Path) -> bool:
    """A folder with localmap_1.txt, or one such file."""
    return bool(numbered(path, ".txt"))


def read(path: Path) -> list[Submap]:
    """The maps of a folder of Linear SLAM's text files (or one file) in order of their numbers."""
    found = numbered(path, ".txt")
    if not found:
        raise InputError("expected files localmap_1.txt, localmap_2.txt, ..., found none", path=path)
    return [_read_map(file, number) for number, file in found]


def _read_map(path: Path, number: int) -> Submap:
    rows = [(k, text.split()) for k, text in enumerate(read_text(path).split("\n"), 1) if text.strip()]
    base = int(whole(np.array(_numbers(path, *_row(path, rows, 0), 1, "frame")), "frame", path)[0])
    size = int(whole(np.array(_numbers(path, *_row(path, rows, 1), 1, "n")), "n", path)[0])
    if size < 1 or len(rows) != 2 + 2 * size:
        raise InputError(
            f"a map of n = {size} numbers needs {2 + 2 * max(size, 0)} lines (frame, n, n rows of the state, n rows of "
            f"the information matrix), found {len(rows)}",
            path=path,
            line=rows[min(1, len(rows) - 1)][0],
        )
    state = np.array([_numbers(path, *row, 2, "id value") for row in rows[2 : 2 + size]])
    information = np.array([_numbers(path, *row, size, "information") for row in rows[2 + size :]])
    ids = whole(state[:, 0], "id", path)
    _, counts = np.unique(ids[ids <= 0], return_counts=True)
    dim = 3 if len(counts) and (counts == 6).all() else 2
    if not len(counts):
        _, features = np.unique(ids, return_counts=True)
        dim = 3 if (features == 3).all() else 2
    check_definite(information, path, "information")
    return submap_of(path, abs(base), number, ids, state[:, 1], information, dim)


def write(submaps: Sequence[Submap], folder: Path) -> tuple[Dropped, ...]:
    """Writes localmap_1.txt, ... in Linear SLAM's format and returns what it cannot hold (names, sources, costs).

    Law: `read` gives the same bases, values and information, of robot 1. InputError for maps that the format has no
    words for: poses of several robots, landmarks with orientation, landmark 0, raw sightings.
    """
    for number, submap in enumerate(submaps, 1):
        write_text(folder / f"localmap_{number}.txt", _text(submap))
    return (
        Dropped(len(submaps), "names, sources, versions and costs of submaps: the text format has no place for them"),
    )


def _text(submap: Submap) -> str:
    if reason := _no_words_for(submap):
        raise InputError(
            f"submap {submap.id} holds {reason}, which Linear SLAM's text cannot say; write teamslam's own submap files"
        )
    dim, layout = submap.base_dim, submap.values.layout
    ids, numbers, jacobian = [], [], sp.eye_array(submap.dof).tolil()
    for key, kind, start in zip(layout.keys, layout.kinds, layout.dof_start[:-1], strict=True):
        if Kind(int(kind)).is_pose:
            pose = submap.values.pose(int(key))
            ids += [-int(index_of(key))] * pose.dof
            if dim == 2:
                numbers += pose.xytheta().tolist()
            else:
                angles = _angles(pose.rotation)
                numbers += [*pose.translation.tolist(), *angles.tolist()]
                jacobian[start + 3 : start + 6, start + 3 : start + 6] = rates(angles)
        else:
            ids += [int(key)] * dim
            numbers += np.asarray(submap.values.gather(np.asarray(key), Kind(int(kind)))).tolist()
    turned = jacobian.tocsr()
    information = (turned.T @ submap.information @ turned).toarray()
    information = 0.5 * (information + information.T)
    lines = [str(int(index_of(submap.base))), str(submap.dof)]
    lines += [f"{name} {text_of(number)}" for name, number in zip(ids, numbers, strict=True)]
    lines += [" ".join(text_of(number) for number in row) for row in information]
    return "\n".join(lines) + "\n"


def _no_words_for(submap: Submap) -> str | None:
    """What of a submap the format cannot say, or None."""
    keys, kinds, dim = submap.values.layout.keys, submap.values.layout.kinds, submap.base_dim
    if submap.base < 0:
        return "a frame that is no robot's pose"
    if len(np.unique(robot_of(submap.keys[is_pose(submap.keys)]))) > 1:
        return "poses of several robots"
    if submap.raw:
        return "raw sightings beside the map"
    if (keys == 0).any():
        return "landmark 0 (ids of features start at 1)"
    if (kinds != np.where(is_pose(keys), int(pose_kind(dim)), int(point_kind(dim)))).any():
        return "planar and spatial variables together, or landmarks with orientation"
    return None


def _angles(rotation: Array) -> Array:
    """The angles (a, b, c) about z, y, x of R = Rz(a) Ry(b) Rx(c)."""
    r = rotation
    return np.array([np.arctan2(r[1, 0], r[0, 0]), -np.arcsin(np.clip(r[2, 0], -1, 1)), np.arctan2(r[2, 1], r[2, 2])])


def _row(path: Path, rows: list[tuple[int, list[str]]], at: int) -> tuple[int, list[str]]:
    if at >= len(rows):
        raise InputError("the file ends too early: expected the id of the frame, then n", path=path)
    return rows[at]


def _numbers(path: Path, line: int, words: list[str], count: int, field: str) -> list[float]:
    if len(words) != count:
        raise InputError(f"expected {count} numbers, found {len(words)}", path=path, line=line, field=field)
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        found = " ".join(words)[:60]
        raise InputError(f"expected numbers, found '{found}'", path=path, line=line, field=field) from None
    if not np.isfinite(numbers).all():
        raise InputError("expected finite numbers", path=path, line=line, field=field)
    return numbers
