"""Writing JSON robot logs: see `jrl`."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.garbage import uncollected
from teamslam.io.files.json_text import encoded, finite
from teamslam.io.files.text import write_text
from teamslam.io.graphs.edges import matching
from teamslam.io.graphs.information import covariance_of_whitening, has_covariance
from teamslam.io.graphs.jrl_factors import FACTORS
from teamslam.io.graphs.jrl_noise import covariance_there
from teamslam.io.graphs.jrl_values import written, written_bearings_ranges, written_ranges
from teamslam.io.graphs.naming import note_of
from teamslam.io.graphs.rewording import Part, no_word_for, reworded
from teamslam.io.graphs.symbols import LOWER_FIRST
from teamslam.model import SQUARED, Dataset, Dropped, Kind, Table, Values, index_of, pack, robot_of

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
    with uncollected():
        content: dict[str, Any] = {
            "name": path.stem,
            NOTE: note_of(dataset.names),
            "robots": [letters[robot] for robot in sorted(dataset.robots)],
            "measurements": {letters[robot]: _entries(parts, robot) for robot in sorted(dataset.robots)},
        }
        for name, values in (("groundtruth", dataset.truth), ("initialization", dataset.initial)):
            kept = matching(values, dataset)[0]
            if kept is not None:
                content[name] = values_by_robot(kept, letters)
        write_text(path, encoded(content) + "\n")
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


def _entries(parts: Sequence[Part], robot: int) -> list[dict[str, Any]]:
    """A robot's factors, one entry for each time, which is the newest of its own poses in the factor."""
    stamped: dict[int, list[dict[str, Any]]] = {}
    for table, ends in parts:
        if table.robot == robot:
            for stamp, factor in zip(_stamps(table), _factors(table, str(_factor(table, ends))), strict=True):
                stamped.setdefault(stamp, []).append(factor)
    return [{"stamp": stamp, "measurements": stamped[stamp]} for stamp in sorted(stamped)]


def _factor(table: Table, ends: tuple[Kind, ...]) -> str | None:
    """The type of factor that says what a table holds; None where there is none."""
    if table.sensor is not None or not has_covariance(table.whitening):
        return None
    return next((n for n, f in FACTORS.items() if (f.model, f.dim, f.ends) == (table.model, table.dim, ends)), None)


def _stamps(table: Table) -> list[int]:
    """The time of each row."""
    own = robot_of(table.keys) == table.robot
    return list(np.maximum(np.where(own, index_of(table.keys), -1).max(1), 0).tolist())


def _factors(table: Table, name: str) -> list[dict[str, Any]]:
    """The factors of one table."""
    factor = FACTORS[name]
    covariances = np.broadcast_to(covariance_of_whitening(table.whitening), (len(table), factor.rows, factor.rows))
    theirs = finite(covariance_there(covariances, table.values, factor.model, factor.dim).reshape(len(table), -1))
    values = _measured(table.values, factor.model, factor.value_kind)
    rows = zip(LOWER_FIRST.symbols(table.keys).tolist(), values, theirs, strict=True)
    if len(factor.ends) == 1:
        return [{"type": name, "key": keys[0], "prior": value, "covariance": noise} for keys, value, noise in rows]
    return [
        {"type": name, "key1": first, "key2": second, "measurement": value, "covariance": noise}
        for (first, second), value, noise in rows
    ]


def _measured(values: Array, model: str, kind: Kind) -> list[dict[str, Any]]:
    if model == "range":
        return written_ranges(values[:, 0])
    if model == "range_bearing":
        return written_bearings_ranges(values, kind.dim)
    return written(values, kind)


def values_by_robot(values: Values, letters: dict[int, str]) -> dict[str, list[dict[str, Any]]]:
    """Values robot by robot; landmarks stand with the lowest robot."""
    out: dict[str, list[dict[str, Any]]] = {letters[robot]: [] for robot in sorted(letters)}
    owners = {0: letters[min(letters)], **letters}
    for kind, keys, data in values.parts():
        rows = zip(robot_of(keys).tolist(), LOWER_FIRST.symbols(keys).tolist(), written(pack(data), kind), strict=True)
        for robot, symbol, row in rows:
            out[owners[robot]].append({"key": symbol, **row})
    return out
