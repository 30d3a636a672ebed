"""A dataset as a folder in the plain format: one CSV file for each table, nothing interpolated on the way back."""

import csv
import io
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.io.plain.columns import (
    POINT,
    POSE,
    components,
    covariance_columns,
    covariance_of,
    information_columns,
    upper,
    value_columns,
    write_poses,
    write_values,
)
from teamslam.io.plain.schema import FILE
from teamslam.model import (
    SQUARED,
    Dataset,
    Dropped,
    Names,
    Table,
    Values,
    index_of,
    is_landmark,
    is_pose,
    is_unnamed,
    landmark_number,
    robot_of,
)


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes a dataset into a folder (made where absent; files of the same names are replaced).

    Returns what the format has no place for: nothing. Raises InputError where the folder cannot be written, or where a
    name cannot stand in a file or belongs to two robots or landmarks.
    """
    folder, names = Path(path), dataset.names
    numbers = _landmark_numbers(dataset)
    robots = [{"name": names.robot(number), "dim": dim, "number": number} for number, dim in dataset.robots.items()]
    _check_names([str(robot["name"]) for robot in robots], "robots")
    files: dict[str, str] = {}
    team: dict[str, Any] = {"keyframes": "given", "tick_s": names.tick_s, "robot": robots}
    taken: dict[tuple[int, str], int] = {}
    if logs := [_log(part, names, files, taken) for table in dataset.tables for part in _parts(table)]:
        team["log"] = logs
    for what, values in (("truth", dataset.truth), ("initial", dataset.initial)):
        if values is not None:
            team[what] = _known(values, what, names, files)
    if numbers:
        team["landmarks"] = numbers
    if dataset.dropped:
        team["dropped"] = [{"count": left.count, "reason": left.reason} for left in dataset.dropped]
    files[FILE] = tomli_w.dumps(team)
    _write(files, folder)
    return ()


def _write(files: dict[str, str], folder: Path) -> None:
    """All files, or where one cannot be written none of those that were not there before."""
    made, fresh = [], not folder.exists()
    for name, text in files.items():
        path = folder / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            made += [] if path.exists() else [path]
            path.write_text(text, encoding="utf-8", newline="")
        except BaseException as error:
            for written in made:
                written.unlink(missing_ok=True)
            if fresh and folder.is_dir():
                folder.rmdir()
            if isinstance(error, OSError):
                raise InputError(f"cannot be written: {error.strerror or error}", path=path) from None
            raise


def lacks(dataset: Dataset) -> str | None:
    """What the plain format cannot hold of a log: nothing."""
    return None


# --- measurements -------------------------------------------------------------------------------------------------


def _parts(table: Table) -> list[Table]:
    """A table as it stands, or its sightings of landmarks and of robots as two: a file holds one of them."""
    of_landmarks = is_landmark(table.keys[:, -1])
    if of_landmarks.all() or not of_landmarks.any():
        return [table]
    return [table.select(of_landmarks), table.select(~of_landmarks)]


def _log(table: Table, names: Names, files: dict[str, str], taken: dict[tuple[int, str], int]) -> dict[str, Any]:
    """The [[log]] of a table, its CSV file put among `files`."""
    robot = names.robot(table.robot)
    file = _free_name(f"{table.source}_{robot}", files)
    log: dict[str, Any] = {"file": file, "model": table.model, "source": table.source, "robot": robot, "dim": table.dim}
    columns = _key_columns(table, names)
    columns |= dict(zip(value_columns(table.model, table.dim), _text(write_values(table)), strict=True))
    columns |= _noise(table, log)
    first = taken.get((table.robot, table.source), 0)
    if not np.array_equal(table.ids, np.arange(first, first + len(table))):
        columns["id"] = [str(number) for number in table.ids.tolist()]
    taken[table.robot, table.source] = max(first + len(table), int(table.ids.max(initial=-1)) + 1)
    if table.sensor is not None:
        log["sensor"] = dict(zip(POSE[table.sensor.dim], write_poses(table.sensor).tolist(), strict=True))
    if table.loss != SQUARED:
        log |= {"loss": table.loss.name, "loss_scale": table.loss.scale}
    files[file] = _csv(columns)
    return log


def _noise(table: Table, log: dict[str, Any]) -> dict[str, list[str]]:
    """The columns of a table's noise, or its place in the [[log]]: information where some of it is open."""
    names = components(table.model, table.dim)
    if (table.ranks < len(names)).any():
        rows = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
        information = np.swapaxes(rows, -1, -2) @ rows
        return dict(zip(information_columns(names), _text(upper(information)), strict=True))
    covariances = covariance_of(table.whitening)
    if len(covariances) == 1:
        log["covariance"] = covariances[0].tolist()
        return {}
    return dict(zip(covariance_columns(names), _text(upper(covariances)), strict=True))


def _key_columns(table: Table, names: Names) -> dict[str, list[str]]:
    """The columns that say who saw what, and when."""
    target, columns = table.keys[:, -1], dict[str, list[str]]()
    if not table.row.unary:
        observer = table.keys[:, 0]
        if (robot_of(observer) != table.robot).any():
            columns["observer"] = _robots(observer, names)
        if (robot_of(target) == robot_of(observer)).all():
            return columns | {"from_stamp": _stamps(observer, names), "to_stamp": _stamps(target, names)}
        columns["stamp"] = _stamps(observer, names)
    elif (robot_of(target) == table.robot).all():
        return {"stamp": _stamps(target, names)}
    if is_landmark(target).all():
        return columns | {"landmark": _named_landmarks(target, names)}
    return columns | {"other": _robots(target, names), "other_stamp": _stamps(target, names)}


# --- truth and initial values -------------------------------------------------------------------------------------


def _known(values: Values, what: str, names: Names, files: dict[str, str]) -> dict[str, list[str]]:
    """The [truth] or [initial] of some values, their CSV files put among `files`: one for each kind."""
    out: dict[str, list[str]] = {"robots": [], "landmarks": []}
    for kind, keys, data in values.parts():
        for who, mask in (("robots", is_pose(keys)), ("landmarks", is_landmark(keys))):
            if not mask.any():
                continue
            rows = np.flatnonzero(mask)
            columns = (
                {"robot": _robots(keys[rows], names), "stamp": _stamps(keys[rows], names)}
                if who == "robots"
                else {"landmark": _landmarks(keys[rows], names)}
            )
            numbers = write_poses(data[rows]) if isinstance(data, Pose) else data[rows]
            header = POSE[kind.dim] if kind.is_pose else POINT[kind.dim]
            file = _free_name(f"{what}_{who}", files)
            files[file] = _csv(columns | dict(zip(header, _text(numbers), strict=True)))
            out[who].append(file)
    return out


# --- names --------------------------------------------------------------------------------------------------------


def _landmark_numbers(dataset: Dataset) -> dict[str, int]:
    """The numbers that names alone do not tell, by name; InputError for a name that two landmarks share."""
    names = dataset.names
    keys = [dataset.landmark_keys, np.array(sorted(names.landmarks), np.int64)]
    keys += [v.layout.keys[is_landmark(v.layout.keys)] for v in (dataset.truth, dataset.initial) if v is not None]
    known = np.unique(np.concatenate(keys))
    numbers = known[~_bare(known, names)].tolist()
    called = {number: names.landmark(number) for number in numbers}
    _check_names(list(called.values()), "landmarks")
    seen = set(dataset.landmark_keys.tolist())
    return {name: n for n, name in called.items() if landmark_number(name) != n or (n not in seen and name != str(n))}


def _check_names(names: Sequence[str], noun: str) -> None:
    twins = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    if twins:
        raise InputError(f"two {noun} are called '{min(twins)}'; give each a name of its own")
    for name in names:
        if not name.strip() or name != name.strip() or name.startswith("#") or "\0" in name:
            raise InputError(f"'{name}' among the {noun} cannot be a name in a file: no blanks around it, no '#' first")


def _robots(keys: IntArray, names: Names) -> list[str]:
    return [names.robot(number) for number in robot_of(keys).tolist()]


def _named_landmarks(keys: IntArray, names: Names) -> list[str]:
    """Names of landmarks; nothing for one that nobody called by name."""
    return ["" if b else name for b, name in zip(_bare(keys, names).tolist(), _landmarks(keys, names), strict=True)]


def _bare(keys: IntArray, names: Names) -> BoolArray:
    """Which keys are of landmarks that nobody called by name."""
    return np.asarray(is_unnamed(keys) & ~np.isin(keys, list(names.landmarks)))


def _landmarks(keys: IntArray, names: Names) -> list[str]:
    return [names.landmark(number) for number in index_of(keys).tolist()]


def _stamps(keys: IntArray, names: Names) -> list[str]:
    """Stamps [s] in digits that read back to the same tick."""
    ticks = index_of(keys).tolist()
    if names.tick_s == 1e-6:
        return [f"{tick // 1_000_000}.{tick % 1_000_000:06d}" for tick in ticks]
    return [repr(tick * names.tick_s) if names.tick_s != 1.0 else str(tick) for tick in ticks]


# --- text ---------------------------------------------------------------------------------------------------------


def _text(numbers: Array) -> list[list[str]]:
    """Columns of numbers in the fewest digits that read back to the same bits."""
    return [[repr(number) for number in column] for column in numbers.T.tolist()]


def _csv(columns: dict[str, list[str]]) -> str:
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return out.getvalue()


def _free_name(stem: str, files: dict[str, str]) -> str:
    """A file name that is not taken, of letters that every system knows."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", stem) or "log"
    taken = {name.lower() for name in files}
    names = (f"{plain}{'' if k == 1 else f'_{k}'}.csv" for k in itertools.count(1))
    return next(name for name in names if name.lower() not in taken)
