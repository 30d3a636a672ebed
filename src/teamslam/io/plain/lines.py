"""Rows as a robot measures them: JSON objects, one a line, of what a folder in the plain format says of its files.

    {"file": "odometry.csv", "from_stamp": 0.0, "to_stamp": 0.1, "x": 0.104, "y": 0.002, "theta": 0.01}
    {"file": "landmarks.csv", "stamp": 0.1, "landmark": "door", "range": 3.93, "bearing": 0.6}

`file` names a [[log]] of team.toml; the rest are that file's columns, as formats.md describes them. `robot` and `id`
may be left out: rows of one source are counted then, and one that repeats one of the last `REMEMBERED` in every number
is that row again, as a link that is not sure of itself sends it. Every stamp is a pose as it stands (keyframes =
"given"): what was seen between two stamps of the odometry is told at one of them, or the odometry is told up to there
and on from there. The CSV files themselves need nothing but their header line; rows that they have are not read.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import read_csv
from teamslam.io.files.grid import Words
from teamslam.io.plain.reader import read_tables
from teamslam.io.plain.roster import NAMED, Roster
from teamslam.io.plain.schema import FILE, STREAMS, Log, read_team
from teamslam.model import Dataset, Names, Table, robot_of

REMEMBERED = 1000
_DECODER = msgspec.json.Decoder(dict[str, int | float | str | None])


class Lines:
    """What lines of one robot's rows are read by. `head`: its channels, as a Dataset of tables without rows; `names`:
    what everybody is called, landmarks as they are mentioned.

    Raises InputError where the folder does not describe rows that can be told one by one.
    """

    def __init__(self, folder: Path, robot: str | None = None) -> None:
        self._team, self.path = read_team(folder), folder / FILE
        self._roster = Roster(folder, self._team)
        self._count, self._taken = 0, dict[tuple[int, str], int]()
        known = {entry.name: number for number, entry in self._roster.entries.items()}
        if robot is None and len(known) == 1:
            robot = next(iter(known))
        if robot is None or robot not in known:
            raise InputError(
                f"say which robot this is, one of {', '.join(known)}; found {robot or 'none'}",
                path=self.path,
                field="robot",
            )
        self.robot, self._name = known[robot], robot
        self._logs: dict[str, tuple[int, Log]] = {}
        self._last: dict[tuple[object, ...], Table] = {}  # rows that brought no id, the newest last
        tables: list[Table] = []
        for place, log in enumerate(self._team.log):
            if log.robot not in (None, robot):
                continue
            if log.model in STREAMS:
                raise InputError(
                    f"{log.model} cannot be told row by row; tell increments between stamps (relative_pose)",
                    path=self.path, field=f"log[{place}].model",
                )  # fmt: skip
            own = msgspec.structs.replace(log, robot=robot)
            self._logs[log.file] = (place, own)
            empty = _without_rows(read_csv(folder / log.file, words=NAMED))
            tables += [
                t for t in read_tables(empty, own, self._team, self._roster, {}, place, []) if t.robot == self.robot
            ]
        self._names, self._known = self._roster.names, self._roster.known
        self.head = Dataset(self._roster.dims, tuple(tables), self._roster.names, origin=str(folder))

    @property
    def names(self) -> Names:
        """What everybody is called so far; the same record while nobody is new."""
        if self._roster.known != self._known:
            self._names, self._known = self._roster.names, self._roster.known
        return self._names

    def goes_on_after(self, tables: Iterable[Table], names: Mapping[int, str]) -> None:
        """Count rows on from those that were taken before, of landmarks with these names."""
        for name in names.values():
            self._roster.number_of(name)
        for table in tables:
            key = (table.robot, table.source)
            self._taken[key] = max(self._taken.get(key, 0), int(table.ids.max(initial=-1)) + 1)

    def pass_over(self) -> None:
        """Count a line that tells nothing, such as a blank one: complaints name the lines of what was sent."""
        self._count += 1

    def row(self, line: str | bytes) -> Table:
        """One line as a table of one row. Raises InputError with the number of the line, the field and the cure."""
        self._count += 1
        try:
            cells = _DECODER.decode(line)
        except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
            raise InputError(
                f"expected an object of names, numbers and words: {error}", path="stdin", line=self._count
            ) from None
        file = cells.pop("file", None)
        if file not in self._logs:
            known = ", ".join(self._logs)
            raise InputError(f"expected one of {known}; found {file}", path="stdin", line=self._count, field="file")
        if cells.get("robot", self._name) != self._name:
            raise InputError(
                f"this robot is {self._name}, found {cells['robot']}", path="stdin", line=self._count, field="robot"
            )
        told = (file, *sorted(cells.items(), key=lambda cell: cell[0]))
        if "id" not in cells and told in self._last:
            return self._last[told]
        place, log = self._logs[str(file)]
        csv = Csv(
            Path("stdin"), {name: self._column(name, cell) for name, cell in cells.items()}, np.array([self._count])
        )
        table = read_tables(csv, log, self._team, self._roster, self._taken, place)[0]
        if "id" not in cells:
            self._last[told] = table
            if len(self._last) > REMEMBERED:
                del self._last[next(iter(self._last))]
        return table

    def stamp_s(self, table: Table) -> float:
        """When a row was measured [s]: at the latest of its own poses; 0 where it is of none."""
        keys = table.keys[robot_of(table.keys) == table.robot]
        return float(self.names.stamps_s(keys).max(initial=0.0))

    def _column(self, name: str, cell: int | float | str | None) -> Array | Words | list[str]:
        if name in NAMED:
            word = "" if cell is None else str(cell)
            return Words.of([word]) if word else [""]
        if not isinstance(cell, int | float):
            raise InputError(f"expected a number, found {cell!r}", path="stdin", line=self._count, field=name)
        return np.array([float(cell)])


def _without_rows(csv: Csv) -> Csv:
    """A CSV file's columns, and none of its rows."""
    columns = {name: Words.of([]) if name in NAMED else np.zeros(0) for name in csv.columns}
    return Csv(csv.path, columns, csv.lines[:0])
