"""Writing PyFG factor graphs: see `pyfg`."""

from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.io.files.text import rows_of_text, state_columns, text_of, write_text
from teamslam.io.graphs.edges import matching
from teamslam.io.graphs.information import covariance_of_whitening, has_covariance
from teamslam.io.graphs.pyfg_tags import RANGE, TAGS, VERTICES
from teamslam.io.graphs.rewording import no_word_for, reworded
from teamslam.io.graphs.symbols import UPPER_FIRST
from teamslam.model import (
    SQUARED,
    Dataset,
    Dropped,
    Kind,
    Table,
    Values,
    index_of,
    is_landmark,
    is_pose,
    pack,
    robot_of,
)


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes a PyFG file and returns what it has no place for: estimates, losses, other names, stamps without truth.

    Law: `read` gives the same measurements and truth, and the same keys where every pose has a true value or poses are
    counted. Ranges with bearings become points. InputError for what the format has no tag for (see `lacks`).
    """
    problem = lacks(dataset)
    if problem is not None:
        raise InputError(problem)
    parts, _, said = reworded(dataset, lambda table, ends: _tag(table, ends) is not None)
    words = _Words(dataset)
    truth = None if dataset.truth is None else matching(dataset.truth, dataset)[0]
    lines = [] if truth is None else words.vertices(truth)
    for table, ends in parts:
        lines += _measurements(table, str(_tag(table, ends)), words)
    write_text(path, "\n".join(lines) + "\n")
    return tuple(said) + _losses(dataset, truth)


def lacks(dataset: Dataset) -> str | None:
    """What PyFG has no word for in a log; None where it can be written."""
    _, without, _ = reworded(dataset, lambda table, ends: _tag(table, ends) is not None)
    return no_word_for(without, "PyFG") or UPPER_FIRST.lacks(dataset.robots, "PyFG's keys")


def _losses(dataset: Dataset, truth: Values | None) -> tuple[Dropped, ...]:
    poses = int(is_pose(dataset.layout.keys).sum())
    known = 0 if truth is None else int(is_pose(truth.layout.keys).sum())
    letters = {robot: str(UPPER_FIRST.letter(robot)) for robot in dataset.robots}
    others = {**{k: v for k, v in dataset.names.robots.items() if letters.get(k) != v}, **dataset.names.landmarks}
    unstamped = poses - known if dataset.names.tick_s != 1.0 else 0
    losses = [
        (unstamped, "stamps of poses without a true value: the poses are counted"),
        (0 if dataset.initial is None else len(dataset.initial), "estimates: PyFG holds true values only"),
        (sum(len(t) for t in dataset.tables if t.loss != SQUARED), "robust losses: PyFG has no place for them"),
        (len(others), "names: PyFG's are a letter and a count"),
    ]
    return tuple(Dropped(count, reason) for count, reason in losses if count)


class _Words:
    """The keys and stamps of variables as words: poses are counted, by their index or by their place in the way."""

    def __init__(self, dataset: Dataset) -> None:
        self._tick_s = dataset.names.tick_s
        self._poses = np.sort(dataset.layout.keys[is_pose(dataset.layout.keys)])
        robots = robot_of(self._poses)
        starts = np.flatnonzero(np.append(True, np.diff(robots) != 0)) if len(robots) else robots
        self._places = np.arange(len(robots)) - np.repeat(starts, np.diff(np.append(starts, len(robots))))

    def keys(self, keys: IntArray) -> list[str]:
        """Words of keys (n,)."""
        counts = index_of(keys)
        if self._tick_s != 1.0:
            poses = is_pose(keys)
            counts = counts.copy()
            counts[poses] = self._places[np.searchsorted(self._poses, keys[poses])]
        letters = [UPPER_FIRST.landmark, *UPPER_FIRST.robots]
        return [f"{letters[robot]}{n}" for robot, n in zip(robot_of(keys).tolist(), counts.tolist(), strict=True)]

    def stamps(self, keys: IntArray) -> list[str]:
        """Stamps [s] of pose keys (n,); 0 where poses are counted."""
        if self._tick_s == 1.0:
            return ["0.0"] * len(keys)
        return [text_of(index * self._tick_s) for index in index_of(keys).tolist()]

    def vertices(self, values: Values) -> list[str]:
        """The VERTEX lines of some values."""
        tags = {kind: tag for tag, (kind, _) in VERTICES.items()}
        lines = []
        for kind, keys, data in values.parts():
            stamps = [f"{stamp} " for stamp in self.stamps(keys)] if kind.is_pose else [""] * len(keys)
            states = rows_of_text(state_columns(pack(data), kind))
            rows = zip(stamps, self.keys(keys), states, strict=True)
            lines += [f"{tags[kind]} {stamp}{key} {state}" for stamp, key, state in rows]
        return lines


def _tag(table: Table, ends: tuple[Kind, ...]) -> str | None:
    """The tag that says what a table holds; None where there is none: landmarks of PyFG have no orientation."""
    oriented = any(end.is_pose and is_landmark(table.keys[:, k]).any() for k, end in enumerate(ends))
    if oriented or table.sensor is not None or not has_covariance(table.whitening):
        return None
    if table.model == "range" and {kind.dim for kind in ends} == {table.dim}:
        return RANGE
    return next((name for name, t in TAGS.items() if (t.model, t.dim, t.ends) == (table.model, table.dim, ends)), None)


def _measurements(table: Table, tag: str, words: _Words) -> list[str]:
    """The lines of one table."""
    rows = table.row.residual_rows(table.dim)
    covariances = np.broadcast_to(covariance_of_whitening(table.whitening), (len(table), rows, rows))
    kind = Kind(table.dim - 2) if table.row.measures_pose else Kind(table.dim)
    values = table.values if tag == RANGE else state_columns(table.values, kind)
    above = np.triu_indices(rows)
    numbers = rows_of_text(np.concatenate([values, covariances[:, above[0], above[1]]], -1))
    own = (robot_of(table.keys) == table.robot) & is_pose(table.keys)
    newest = np.where(own[:, -1], table.keys[:, -1], table.keys[:, 0])
    keys = [words.keys(table.keys[:, k]) for k in range(table.keys.shape[1])]
    return [f"{tag} {' '.join(row)}" for row in zip(words.stamps(newest), *keys, numbers, strict=True)]
