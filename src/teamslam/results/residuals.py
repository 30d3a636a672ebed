"""residuals.csv: what every row of the log leaves at the map.

component         the map that it belongs to
robot, source     who measured, and which of its logs (odometry, landmarks, robots, ...)
model, row        the kind of measurement, and the row's number in that log
stamp_s           of the pose it was taken from, the later of two; empty where there is none (a surveyed landmark)
target            what was seen: 'landmark 7', 'robot 3'; of odometry, the robot itself
weight            the loss's, 1 for the squared loss: near 0 where the row was taken for an outlier
u_1, u_2, ...     the whitened residual W e, e = z (-) h, in the order of the model's parts: where the noise of the
                  parts is not correlated, each part in its own standard deviations
"""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from teamslam.answers.residuals import Residuals, residuals_in_words
from teamslam.errors import InputError
from teamslam.io.files.letters import Letters, fixed, integers, lines, significant, words
from teamslam.trust import Verdict


def residuals_of(verdict: Verdict) -> tuple[Residuals, ...]:
    """What a verdict rests on, in words and stamps."""
    return tuple(
        residuals_in_words(component, rows.table, rows.whitened, rows.weight, verdict.names)
        for component, part in enumerate(verdict.parts, start=1)
        for rows in part.rows
    )


def write_residuals(residuals: Sequence[Residuals], path: Path) -> None:
    """The table, a row a measurement."""
    widest = max((part.whitened.shape[-1] for part in residuals), default=0)
    head = ("component", "robot", "source", "model", "row", "stamp_s", "target", "weight")
    with path.open("wb") as file:
        file.write(_line([*head, *(f"u_{n + 1}" for n in range(widest))]).encode())
        for part in residuals:
            file.writelines(lines(_columns(part, widest)))


def _columns(part: Residuals, widest: int) -> list[Letters]:
    whose = _cells([part.component, part.robot, part.source, part.model])
    return [
        words([whose], np.zeros(len(part.row), np.int64)),
        integers(part.row),
        fixed(part.stamp_s, 6),
        words([_cells([target]) for target in part.targets], part.target),
        significant(part.weight, 4),
        *(significant(u, 5) for u in part.whitened.T),
        *(words([""], np.zeros(len(part.row), np.int64)) for _ in range(widest - part.whitened.shape[-1])),
    ]


def _cells(cells: Iterable[object]) -> str:
    return _line(cells).strip("\n")


def _line(cells: Iterable[object]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue()


def read_residuals(path: Path) -> tuple[Residuals, ...]:
    """The table that `write_residuals` wrote, numbers to its digits. ValueError where it is another table."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        next(rows)
        found: dict[tuple[str, ...], list[list[str]]] = {}
        for cells in rows:
            found.setdefault(tuple(cells[:4]), []).append(cells[4:])
    return tuple(_part(words, cells) for words, cells in found.items())


def residuals_in(folder: Path) -> tuple[Residuals, ...]:
    """What lies in a run folder; nothing where it holds none. InputError where the file is another's."""
    path = folder / "residuals.csv"
    try:
        return read_residuals(path) if path.exists() else ()
    except (ValueError, csv.Error, StopIteration) as error:
        raise InputError(f"not a table of residuals: {error}", path=path) from None


def _part(words: tuple[str, ...], cells: list[list[str]]) -> Residuals:
    row, stamp, target, weight, *whitened = zip(*cells, strict=True)
    targets, which = np.unique(target, return_inverse=True)
    return Residuals(
        component=int(words[0]),
        robot=words[1],
        source=words[2],
        model=words[3],
        row=np.array(row, np.int64),
        stamp_s=np.array([float(s or "nan") for s in stamp]),
        target=np.asarray(which),
        targets=tuple(targets.tolist()),
        weight=np.array(weight, float),
        whitened=np.array([u for u in whitened if u[0]], float).reshape(-1, len(cells)).T,
    )
