"""Writing JSON robot logs: see `jrl`."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.text import write_text
from teamslam.io.graphs.edges import matching
from teamslam.io.graphs.information import covariance_of_whitening, has_covariance
from teamslam.io.graphs.jrl_factors import FACTORS
from teamslam.io.graphs.jrl_noise import covariance_there
from teamslam.io.graphs.jrl_values import written, written_bearing_range, written_range
from teamslam.io.graphs.naming import note_of
from teamslam.io.graphs.rewording import Part, no_word_for, reworded
from teamslam.io.graphs.symbols import LOWER_FIRST, join_symbol
from teamslam.model import SQUARED, Dataset, Dropped, Kind, Table, Values, index_of, is_pose, pack, robot_of

NOTE = "teamslam"  # an entry that other programs pass over: names and the length of a tick


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes a JRL file and returns what it has no place for: losses.

    Law: `read` gives the same measurements, truth, estimates and names; a robot's rows are put in the order of time.
    Points become ranges with bearings. InputError for what has no factor type in JRL (see `lacks`).
    """
    problem = lacks(dataset)
    if problem is not None:
        raise InputError(problem)
    parts, _, said = reworded(dataset, lambda table, ends: _factor(table, ends) is not None)
    letters = letters_of(dataset.robots)
    content: dict[str, Any] = {
        "name": path.stem,
        NOTE: note_of(dataset.names),
        "robots": [letters[robot] for robot in sorted(dataset.robots)],
        "measurements": {letters[robot]: _entries(parts, robot, letters) for robot in sorted(dataset.robots)},
    }
    for name, values in (("groundtruth", dataset.truth), ("initialization", dataset.initial)):
        kept = matching(values, dataset)[0]
        if kept is not None:
            content[name] = values_by_robot(kept, letters)
    write_text(path, json.dumps(content, allow_nan=False) + "\n")
    robust = sum(len(t) for t in dataset.tables if t.loss != SQUARED)
    losses = [Dropped(robust, "robust losses: JRL has no place for them")] if robust else []
    return (*said, *losses)


def lacks(dataset: Dataset) -> str | None:
    """What JRL has no word for in a log; None where it can be written."""
    _, without, _ = reworded(dataset, lambda table, ends: _factor(table, ends) is not None)
    return no_word_for(without, "JRL") or LOWER_FIRST.lacks(dataset.robots, "JRL's keys")


def letters_of(robots: Iterable[int]) -> dict[int, str]:
    """The letters of robots that all have one (see `Alphabet.lacks`)."""
    return {robot: str(LOWER_FIRST.letter(robot)) for robot in robots}


def _symbol(key: int, letters: dict[int, str]) -> int:
    return join_symbol(letters[int(robot_of(key))] if is_pose(key) else LOWER_FIRST.landmark, int(index_of(key)))


def _entries(parts: Sequence[Part], robot: int, letters: dict[int, str]) -> list[dict[str, Any]]:
    """A robot's factors, one entry for each time, which is the newest of its own poses in the factor."""
    stamped: dict[int, list[dict[str, Any]]] = {}
    for table, ends in parts:
        if table.robot == robot:
            for stamp, factor in _factors(table, str(_factor(table, ends)), letters):
                stamped.setdefault(stamp, []).append(factor)
    return [{"stamp": stamp, "measurements": stamped[stamp]} for stamp in sorted(stamped)]


def _factor(table: Table, ends: tuple[Kind, ...]) -> str | None:
    """The type of factor that says what a table holds; None where there is none."""
    if table.sensor is not None or not has_covariance(table.whitening):
        return None
    return next((n for n, f in FACTORS.items() if (f.model, f.dim, f.ends) == (table.model, table.dim, ends)), None)


def _factors(table: Table, name: str, letters: dict[int, str]) -> list[tuple[int, dict[str, Any]]]:
    """The factors of one table with their times."""
    factor = FACTORS[name]
    covariances = np.broadcast_to(covariance_of_whitening(table.whitening), (len(table), factor.rows, factor.rows))
    own = robot_of(table.keys) == table.robot
    stamps = np.where(own, index_of(table.keys), -1).max(1)
    out = []
    for keys, value, covariance, stamp in zip(table.keys.tolist(), table.values, covariances, stamps, strict=True):
        names = ["key"] if len(keys) == 1 else ["key1", "key2"]
        out.append(
            (
                max(int(stamp), 0),
                {
                    "type": name,
                    **{n: _symbol(key, letters) for n, key in zip(names, keys, strict=True)},
                    "prior" if len(keys) == 1 else "measurement": _measured(value, factor.model, factor.value_kind),
                    "covariance": covariance_there(covariance, value, factor.model, factor.dim).ravel().tolist(),
                },
            )
        )
    return out


def _measured(value: Array, model: str, kind: Kind) -> dict[str, Any]:
    if model == "range":
        return written_range(float(value[0]))
    if model == "range_bearing":
        return written_bearing_range(value, kind.dim)
    return written(value, kind)


def values_by_robot(values: Values, letters: dict[int, str]) -> dict[str, list[dict[str, Any]]]:
    """Values robot by robot; landmarks stand with the lowest robot."""
    out: dict[str, list[dict[str, Any]]] = {letters[robot]: [] for robot in sorted(letters)}
    first = letters[min(letters)]
    for kind, keys, data in values.parts():
        for key, row in zip(keys.tolist(), pack(data), strict=True):
            owner = letters[int(robot_of(key))] if is_pose(key) else first
            out[owner].append({"key": _symbol(key, letters), **written(row, kind)})
    return out
