"""Truth and initial values: where robots were at their keyframes, and where landmarks are, as far as files say."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import on_a_smooth_way
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import read_csv
from teamslam.io.plain.columns import POINT, POSE, kind_of, read_poses, ticks_of
from teamslam.io.plain.roster import NAMED, Roster
from teamslam.io.plain.schema import Known, Team
from teamslam.model import Dataset, Kind, Values, index_of, pose_key, pose_kind


def read_known(
    folder: Path, known: Known, team: Team, roster: Roster, dataset: Dataset, notes: list[str]
) -> Values | None:
    """The values in files of robots and of landmarks; None where there are no files.

    In mode 'interpolate' they are those of the dataset's variables: robots' samples are interpolated to their keyframes
    across at most `truth_gap_s`. In mode 'given' they are the rows as they stand. Words on files whose stamps are not
    the log's are added to `notes`.
    """
    parts = [
        part
        for name in _files(known.robots)
        for part in _robots(read_csv(folder / name, words=NAMED), team, roster, dataset, notes)
    ] + [
        _landmarks(read_csv(folder / name, words=NAMED), team, roster, dataset, notes)
        for name in _files(known.landmarks)
    ]
    if not parts:
        return None
    by_kind = {kind: [part[1:] for part in parts if part[0] == kind] for kind in {part[0] for part in parts}}
    keys = np.concatenate([part[1] for part in parts])
    values, counts = np.unique(keys, return_counts=True)
    if (counts > 1).any():
        twice = dataset.names.describe(int(values[counts > 1][0]))
        raise InputError(f"{twice} stands in two files; give its place once", path=folder)
    return Values.of({kind: _together(pieces) for kind, pieces in by_kind.items()})


def _files(names: str | list[str]) -> list[str]:
    return [names] if isinstance(names, str) else names


def _together(pieces: Sequence[tuple[IntArray, Pose | Array]]) -> tuple[IntArray, Pose | Array]:
    keys, data = zip(*pieces, strict=True)
    poses = [part for part in data if isinstance(part, Pose)]
    return np.concatenate(keys), concatenate(poses) if poses else np.concatenate(data)


def _robots(
    csv: Csv, team: Team, roster: Roster, dataset: Dataset, notes: list[str]
) -> list[tuple[Kind, IntArray, Pose]]:
    """Poses of robots, those of each robot by themselves; `notes` hears of robots at other times."""
    kind = kind_of(csv, poses_only=True)
    notes += csv.notes_of_others(["robot", "stamp", *POSE[kind.dim]])
    robots, ticks, poses = roster.robots(csv, "robot"), ticks_of(csv, "stamp", team.tick_s), read_poses(csv, kind.dim)
    out = []
    for robot in np.unique(robots).tolist():
        rows = np.flatnonzero(robots == robot)
        rows = rows[np.argsort(ticks[rows], kind="stable")]
        again = np.flatnonzero(np.diff(ticks[rows]) == 0)
        if len(again):
            raise csv.fail(int(rows[again[0] + 1]), "this robot has a pose at this stamp already", "stamp")
        dim = roster.dims[robot]
        if dim > kind.dim:
            name = roster.names.robot(robot)
            raise csv.fail(int(rows[0]), f"robot {name} moves in space; its poses need x, y, z, qw, qx, qy, qz")
        samples = poses[rows] if dim == kind.dim else Pose.from_xytheta(poses[rows].xytheta())
        keys = pose_key(robot, ticks[rows])
        if team.keyframes == "interpolate":
            keys = dataset.pose_keys[robot]
            gap = round(team.truth_gap_s / team.tick_s)
            span = ticks[rows[[0, -1]]] * team.tick_s
            samples, good = on_a_smooth_way(ticks[rows], samples, index_of(keys), gap)
            if len(keys) and not good.any():
                poses_s = dataset.names.stamps_s(keys[[0, -1]])
                notes.append(
                    f"{csv.path}: robot {roster.names.robot(robot)} is at {span[0]:.3f} to {span[1]:.3f} s here, and "
                    f"its poses are at {poses_s[0]:.3f} to {poses_s[1]:.3f} s: nothing here is of use; do both clocks "
                    f"count from one zero, and are rows at most truth_gap_s apart?"
                )
            keys, samples = keys[good], samples[np.flatnonzero(good)]
        out.append((pose_kind(dim), keys, samples))
    return out


def _landmarks(
    csv: Csv, team: Team, roster: Roster, dataset: Dataset, notes: list[str]
) -> tuple[Kind, IntArray, Pose | Array]:
    """Points, or poses of landmarks with orientation; of more than is asked, what is asked."""
    kind = kind_of(csv, poses_only=False)
    notes += csv.notes_of_others(["landmark", *(POSE[kind.dim] if kind.is_pose else POINT[kind.dim])])
    keys = roster.landmarks(csv)
    _, first = np.unique(keys, return_index=True)
    again = np.setdiff1d(np.arange(len(keys)), first)
    if len(again):
        raise csv.fail(int(again[0]), "this landmark stands here already", "landmark")
    data: Pose | Array = read_poses(csv, kind.dim) if kind.is_pose else csv.numbers(*POINT[kind.dim])
    seen = dataset.layout.contains(keys)
    if team.keyframes == "given" or not seen.any():
        return (kind, keys, data) if team.keyframes == "given" else (kind, keys[:0], data[np.arange(0)])
    kinds = dataset.layout.kinds[dataset.layout.index(keys[seen])]
    wanted = Kind(int(kinds.max()))
    if (kinds != wanted).any():
        raise InputError("landmarks of several kinds need a file for each kind", path=csv.path)
    rows = np.flatnonzero(seen)
    if wanted.dim > kind.dim or (wanted.is_pose and not kind.is_pose):
        need = ", ".join(POSE[wanted.dim] if wanted.is_pose else POINT[wanted.dim])
        raise csv.fail(int(rows[0]), f"this landmark was measured with {need}; its place here needs them too")
    if wanted.is_pose and isinstance(data, Pose):
        data = data if wanted.dim == kind.dim else Pose.from_xytheta(data.xytheta())
    elif isinstance(data, Pose):
        data = data.translation[:, : wanted.dim]
    else:
        data = data[:, : wanted.dim]
    return wanted, keys[seen], data[rows]
