"""A run's results as CSV for spreadsheets and pandas: trajectories, landmarks, team transforms; with covariances.

All are in the frame of the map's base pose: component 1 is the map of the lowest robot. Covariances are upper
triangles, columns `cov_a_b`, of the errors [x y heading] of planar poses, [x y z rx ry rz] of spatial ones
(translation in the map's frame, rotation in the body's own), [x y] or [x y z] of points. The base pose is the frame:
its covariance is 0.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from teamslam.answers.columns import POSE_COLUMNS, POSE_ERRORS, triangle
from teamslam.geometry import Array, IntArray, lift_tangent
from teamslam.io.files.text import rows_of_text
from teamslam.model import Kind, Submap, index_of, pose_kind
from teamslam.results.record import Record
from teamslam.solver import Covariances, Step


def write_trajectory_table(record: Record, path: Path) -> None:
    """All robots' poses, a row a pose, in time order."""
    dim = _pose_dim(record)
    lines: list[str] = []
    for number, submap, covariances in _components(record):
        for robot in submap.robots_in_it:
            who = [number, submap.names.robot(robot)]
            lines += _pose_lines(who, submap, submap.trajectory_keys(robot), covariances, dim)
    _write(path, ("component", "robot", "stamp_s", *POSE_COLUMNS[dim], *triangle(POSE_ERRORS[dim])), lines)


def write_landmarks(record: Record, path: Path) -> None:
    """All landmarks, a row a landmark; a tag's orientation is in map.npz."""
    dim = max((_landmark_dim(m) for m in record.maps), default=2)
    axes = ("x", "y", "z")[:dim]
    lines: list[str] = []
    for number, submap, covariances in _components(record):
        keys = submap.landmark_keys
        places = submap.all_values.positions(keys, dim)
        rows = rows_of_text(
            np.concatenate([places, _upper(_place_covariances(submap, keys, covariances, dim))], -1), ","
        )
        names = [submap.names.landmark(landmark) for landmark in index_of(keys).tolist()]
        lines += [f"{_cells([number, name])},{row}" for name, row in zip(names, rows, strict=True)]
    _write(path, ("component", "landmark", *(f"{a}_m" for a in axes), *triangle(axes)), lines)


def write_team(record: Record, path: Path) -> None:
    """Where each robot's own frame (its first pose) lies in the map: the transforms of the team."""
    dim = _pose_dim(record)
    lines: list[str] = []
    for number, submap, covariances in _components(record):
        for robot in submap.robots_in_it:
            who = [number, submap.names.describe(submap.base), submap.names.robot(robot)]
            lines += _pose_lines(who, submap, submap.trajectory_keys(robot)[:1], covariances, dim)
    columns = ("component", "map_frame", "robot", "stamp_s", *POSE_COLUMNS[dim], *triangle(POSE_ERRORS[dim]))
    _write(path, columns, lines)


def write_histories(histories: Sequence[Sequence[Step]], path: Path) -> None:
    """The solver's steps, a row a step, component by component."""
    header = ("component", "step", "cost", "decrement_sigma", "step_norm", "damping", "accepted", "seconds")
    rows = (
        [number, n, s.cost, s.decrement, s.step_norm, s.damping, int(s.accepted), s.seconds]
        for number, history in enumerate(histories, start=1)
        for n, s in enumerate(history)
    )
    _write(path, header, map(_cells, rows))


def read_histories(path: Path, components: int) -> tuple[tuple[Step, ...], ...]:
    """The steps that `write_histories` wrote, of so many components."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    steps = [
        Step(
            cost=float(row[2]),
            decrement=float(row[3]),
            step_norm=float(row[4]),
            damping=float(row[5]),
            accepted=row[6] == "1",
            seconds=float(row[7]),
        )
        for row in rows
    ]
    owners = [int(row[0]) for row in rows]
    return tuple(
        tuple(step for step, owner in zip(steps, owners, strict=True) if owner == number)
        for number in range(1, components + 1)
    )


# --- parts of a row -------------------------------------------------------------------------------------------------


def _components(record: Record) -> Iterator[tuple[int, Submap, Covariances]]:
    for number, (submap, covariances) in enumerate(zip(record.maps, record.covariances, strict=True), start=1):
        yield number, submap, covariances


def _pose_dim(record: Record) -> int:
    """2 where every robot moves in the plane, else 3: planar poses are then written as spatial ones."""
    spatial = any((m.values.layout.kinds == Kind.POSE3).any() or m.base_dim == 3 for m in record.maps)
    return 3 if spatial else 2


def _landmark_dim(submap: Submap) -> int:
    layout = submap.values.layout
    kinds = layout.kinds[layout.index(submap.landmark_keys)]
    return 3 if (kinds % 2 == 1).any() else 2


def _pose_lines(who: Sequence[object], submap: Submap, keys: IntArray, covariances: Covariances, dim: int) -> list[str]:
    """The lines of some poses: who they are of, stamp, pose, covariance."""
    stamps = [f"{stamp:.6f}" for stamp in submap.names.stamps_s(keys).tolist()]
    poses = submap.all_values.poses_of(keys, dim).numbers()
    rows = rows_of_text(np.concatenate([poses, _upper(_pose_covariances(submap, keys, covariances, dim))], -1), ",")
    called = _cells(who)
    return [f"{called},{stamp},{row}" for stamp, row in zip(stamps, rows, strict=True)]


def _pose_covariances(submap: Submap, keys: IntArray, covariances: Covariances, dim: int) -> Array:
    """The covariances of poses (n, dof, dof) in the chart of `dim`; planar ones among spatial cannot tilt or rise."""
    dof = pose_kind(dim).dof
    out = np.zeros((len(keys), dof, dof))
    for at, blocks in _stacks(submap, keys, covariances):
        own = 2 if blocks.shape[-1] == 3 else 3
        lift = lift_tangent(own, dim)
        out[at] = lift @ blocks @ lift.T
    return out


def _place_covariances(submap: Submap, keys: IntArray, covariances: Covariances, dim: int) -> Array:
    """The covariances (n, dim, dim) of where landmarks are; planar ones among spatial do not rise."""
    out = np.zeros((len(keys), dim, dim))
    kinds = submap.all_values.layout.kinds[submap.all_values.layout.index(keys)]
    for at, blocks in _stacks(submap, keys, covariances):
        own = int(2 + kinds[at[0]] % 2)
        out[at, :own, :own] = blocks[:, :own, :own]
    return out


def _stacks(submap: Submap, keys: IntArray, covariances: Covariances) -> Iterator[tuple[IntArray, Array]]:
    """The covariances (m, dof, dof) of the variables of each kind, and their places (m,) among `keys`; that of the
    base, which is the frame, is 0 and left out."""
    layout = submap.values.layout
    places = np.flatnonzero(keys != submap.base)
    blocks, kinds = covariances.blocks(keys[places]), layout.kinds[layout.index(keys[places])]
    for kind in np.unique(kinds):
        own = np.flatnonzero(kinds == kind)
        yield places[own], np.array([blocks[k] for k in own.tolist()])


def _upper(blocks: Array) -> Array:
    """The upper triangles (n, k) of matrices (n, d, d)."""
    rows, columns = np.triu_indices(blocks.shape[-1])
    return np.asarray(blocks[:, rows, columns])


def _cells(cells: Sequence[object]) -> str:
    """A line of CSV, without its end."""
    line = io.StringIO(newline="")
    csv.writer(line, lineterminator="").writerow(cells)
    return line.getvalue()


def _write(path: Path, header: Sequence[str], lines: Iterable[str]) -> None:
    path.write_text("\n".join([",".join(header), *lines, ""]), encoding="utf-8", newline="")
