"""The files of an MRCLAM data set: commands, sightings and motion capture, as rows with rising stamps.

A data set is a folder of text files (columns between blanks, `#` comments):

    Barcodes.dat               subject, barcode: subjects 1-5 are robots, others landmarks; differs from set to set
    RobotN_Odometry.dat        time [s], forward velocity [m/s], angular velocity [rad/s]: commands, held till the next
    RobotN_Measurement.dat     time [s], barcode (the header wrongly says subject), range [m], bearing [rad, left +]
    RobotN_Groundtruth.dat     time [s], x, y [m], heading [rad]                       optional
    Landmark_Groundtruth.dat   subject, x, y [m], x sd, y sd [m]                        optional

Rows that say nothing (unknown barcodes, repeated stamps, stamps that step back, ranges of zero, sightings outside the
odometry) are left out and counted in a `Ledger`; a row that cannot be read is an error. Ticks are microseconds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.io.files.delimited import Columns, read_columns
from teamslam.model import Dropped

ROBOTS = range(1, 6)
TICKS_PER_S = 1_000_000
BARCODE = ("subject", "barcode")
ODOMETRY = ("time", "forward velocity", "angular velocity")
MEASUREMENT = ("time", "barcode", "range", "bearing")
TRUTH = ("time", "x", "y", "orientation")
LANDMARK = ("subject", "x", "y", "x std-dev", "y std-dev")


@dataclass(frozen=True, eq=False)
class Odometry:
    """A robot's commands at rising ticks."""

    ticks: IntArray  # (n,)
    velocities: Array  # (n, 2)

    def covers(self, ticks: IntArray) -> BoolArray:
        return np.asarray((ticks >= self.ticks[0]) & (ticks <= self.ticks[-1]))


@dataclass(frozen=True, eq=False)
class Sightings:
    """What a robot saw: `ids` are the rows of its measurement file, `subjects` who was seen."""

    ids: IntArray
    ticks: IntArray
    subjects: IntArray
    range_bearing: Array  # (n, 2)

    def select(self, mask: BoolArray) -> "Sightings":
        return Sightings(self.ids[mask], self.ticks[mask], self.subjects[mask], self.range_bearing[mask])


class Ledger:
    """Counts what is left out, by reason."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def keep(self, good: BoolArray, reason: str) -> BoolArray:
        """The mask itself, after counting the rows that it leaves out."""
        if lost := int(np.count_nonzero(~good)):
            self._counts[reason] = self._counts.get(reason, 0) + lost
        return good

    @property
    def dropped(self) -> tuple[Dropped, ...]:
        return tuple(Dropped(count, reason) for reason, count in self._counts.items())


def read_barcodes(path: Path) -> dict[int, int]:
    """The subject of each barcode."""
    found = read_columns(path, BARCODE)
    subjects, barcodes = _whole(found, 0, path, BARCODE), _whole(found, 1, path, BARCODE)
    if not len(subjects):
        raise InputError("no barcodes; expected lines of subject and barcode", path=path)
    for numbers, name in ((subjects, "subject"), (barcodes, "barcode")):
        values, counts = np.unique(numbers, return_counts=True)
        if (counts > 1).any():
            twice = int(values[counts > 1][0])
            line = int(found.lines[np.flatnonzero(numbers == twice)[1]])
            raise InputError(f"{name} {twice} stands twice; each belongs to one line", path=path, line=line, field=name)
    return dict(zip(barcodes.tolist(), subjects.tolist(), strict=True))


def read_odometry(path: Path, lag_s: float, ledger: Ledger) -> dict[int, Odometry]:
    """The odometry of every robot whose file is there, at the times when commands take effect."""
    team = {}
    for robot in ROBOTS:
        file = path / f"Robot{robot}_Odometry.dat"
        if not file.is_file():
            continue
        found = read_columns(file, ODOMETRY)
        ticks = _ticks(found, file)
        good = ledger.keep(*_never_back(ticks, f"robot {robot}: odometry stamps that step back in time"))
        ticks, velocities = ticks[good], found.values[good, 1:]
        # Of several commands at one stamp only the last one lasts.
        lasts = ledger.keep(
            np.append(np.diff(ticks) > 0, True)[: len(ticks)], f"robot {robot}: repeated odometry stamps"
        )
        if np.count_nonzero(lasts) < 2:
            raise InputError("expected at least two lines of odometry at different times", path=file)
        team[robot] = Odometry(ticks[lasts] + round(lag_s * TICKS_PER_S), velocities[lasts])
    if not team:
        raise InputError("no RobotN_Odometry.dat here (N from 1 to 5); expected the folder of an MRCLAM set", path=path)
    return team


def read_sightings(robot: int, path: Path, subjects: Mapping[int, int], delay_s: float, ledger: Ledger) -> Sightings:
    """The sightings of known barcodes, at the time the image was taken."""
    found = read_columns(path, MEASUREMENT)
    barcodes = _whole(found, 1, path, MEASUREMENT)
    seen = np.array([subjects.get(code, -1) for code in barcodes.tolist()], np.int64)
    ticks = _ticks(found, path)
    all_rows = Sightings(np.arange(len(ticks)), ticks - round(delay_s * TICKS_PER_S), seen, found.values[:, 2:])
    known = all_rows.select(ledger.keep(seen >= 0, f"robot {robot}: sightings of unknown barcodes (misreads)"))
    ahead = known.select(
        ledger.keep(*_never_back(known.ticks, f"robot {robot}: sightings whose stamps step back in time"))
    )
    return ahead.select(
        ledger.keep(ahead.range_bearing[:, 0] > 0.0, f"robot {robot}: sightings at a range of 0 or less")
    )


def within_odometry(robot: int, seen: Sightings, odometry: Mapping[int, Odometry], ledger: Ledger) -> Sightings:
    """The sightings at which the observer, and the robot seen, have odometry: a pose to hang the sighting on."""
    seen = seen.select(
        ledger.keep(odometry[robot].covers(seen.ticks), f"robot {robot}: sightings outside its odometry")
    )
    seen = seen.select(ledger.keep(seen.subjects != robot, f"robot {robot}: sightings of itself"))
    for other in ROBOTS:
        of_other = seen.subjects == other
        if other not in odometry:
            good, reason = ~of_other, f"robot {robot}: sightings of robot {other}, whose odometry file is absent"
        else:
            good = ~of_other | odometry[other].covers(seen.ticks)
            reason = f"robot {robot}: sightings of robot {other} outside its odometry"
        seen = seen.select(ledger.keep(good, reason))
    return seen


def read_robot_truth(path: Path) -> tuple[IntArray, Pose]:
    """Ticks (n,), rising, and where motion capture saw a robot then, Poses (n,); none where there is no file."""
    if not path.is_file():
        return np.zeros(0, np.int64), Pose.identity(2, (0,))
    found = read_columns(path, TRUTH)
    stamps, first = np.unique(_ticks(found, path), return_index=True)
    return stamps, Pose.from_xytheta(found.values[first, 1:])


def read_landmark_truth(path: Path) -> tuple[IntArray, Array]:
    """The subjects of surveyed landmarks (n,), rising, and where they are (n, 2); none where there is no file."""
    if not path.is_file():
        return np.zeros(0, np.int64), np.zeros((0, 2))
    found = read_columns(path, LANDMARK)
    surveyed, first = np.unique(_whole(found, 0, path, LANDMARK), return_index=True)
    return surveyed, found.values[first, 1:3]


def _whole(found: Columns, column: int, path: Path, names: tuple[str, ...]) -> IntArray:
    numbers = found.values[:, column]
    bad = np.flatnonzero((numbers != np.round(numbers)) | (np.abs(numbers) > 2**31) | (numbers < 0))
    if len(bad):
        raise InputError(
            f"expected a whole number of 0 or more, found {numbers[bad[0]]:g}",
            path=path, line=int(found.lines[bad[0]]), field=names[column],
        )  # fmt: skip
    return numbers.astype(np.int64)


def _ticks(found: Columns, path: Path) -> IntArray:
    """Stamps as microseconds."""
    seconds = found.values[:, 0]
    bad = np.flatnonzero((seconds < 0.0) | (seconds > 2.2e9))
    if len(bad):
        raise InputError(
            f"expected a time in seconds from 0 to 2.2e9 (year 2039), found {seconds[bad[0]]:g}",
            path=path, line=int(found.lines[bad[0]]), field="time",
        )  # fmt: skip
    return np.round(seconds * TICKS_PER_S).astype(np.int64)


def _never_back(ticks: IntArray, reason: str) -> tuple[BoolArray, str]:
    """Which stamps are not before an earlier row's, so that a clock that steps back tells no time twice; the reason."""
    return np.asarray(ticks >= np.maximum.accumulate(ticks)) if len(ticks) else np.zeros(0, bool), reason
