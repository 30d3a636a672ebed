"""UTIAS MRCLAM data sets: five planar robots, odometry commands, ranges and bearings to barcodes, motion capture.

A data set is a folder of text files (columns between blanks, `#` comments):

    Barcodes.dat               subject, barcode: subjects 1-5 are robots, others landmarks; differs from set to set
    RobotN_Odometry.dat        time [s], forward velocity [m/s], angular velocity [rad/s]: commands, held till the next
    RobotN_Measurement.dat     time [s], barcode (the header wrongly says subject), range [m], bearing [rad, left +]
    RobotN_Groundtruth.dat     time [s], x, y [m], heading [rad]                       optional
    Landmark_Groundtruth.dat   subject, x, y [m], x sd, y sd [m]                        optional

What becomes of it: one keyframe pose per camera image of a robot, and one wherever another robot saw it; odometry
between keyframes by `velocity.integrate`; sightings as `range_bearing` of landmarks and of robots (a robot's heading is
not seen). Truth is interpolated to the keyframes. Rows that say nothing (unknown barcodes, repeated stamps, stamps that
step back, sightings outside the odometry) are left out and counted in `Dataset.dropped`; a row that cannot be read is
an error.

Where the noise model's numbers come from (no truth was used; sets 1 and 6, five robots together):

- Sightings: published robust deviations, 0.13 m and 0.0085 rad of landmarks, 0.09 m and 0.007 rad of robots, with 1 to
  5 % gross outliers among the bearings: hence the Cauchy loss, at 2 sigmas.
- One image a second: the errors of successive images are not independent. Residuals of a fit to all images, in units
  of their robust deviation, have an autocorrelation in range of 0.87 at 0.2 s, 0.65 at 1.2 s, 0.5 at 2 s and 0.3 at
  5 s (in bearing 0.3, 0.18, 0.14, 0.1). Taken as independent, 4 images a second would make ranges far too certain, and
  odometry would have to give way. `image_every_s = 0` takes them all.
- Lag: the motion follows the commands, seen by the camera, a quarter of a second late. The likelihood has a clear
  maximum there, at 0.245 s in set 1 and at 0.26 s in set 6 (-2 log L lower than at no lag by 3,904 and 1,441; a
  first-order response does no better). Only the sum of the commands' lag and the images' delay can be seen without
  truth; it is laid on the commands, and `delay_s` is 0.
- Odometry: densities of greatest marginal likelihood (Laplace) given the above. Turn 0.107 (set 1) and 0.105 to 0.117
  rad/sqrt(rad) (set 6, images 1, 2 and 3 s apart); forward 0.0064 m/sqrt(s) with 0.077 m/sqrt(m), and 0.014 with 0.064,
  which at 0.06 m/s are nearly the same. The rest is next to nothing, and kept at small floors so that a robot at rest
  has a covariance.

Source: Leung, Halpern, Barfoot, Liu, "The UTIAS multi-robot cooperative localization and mapping dataset", IJRR 30(8),
2011.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.stamps import keyframe_of, merge
from teamslam.frontend.velocity import VelocityNoise, integrate
from teamslam.geometry import Array, BoolArray, IntArray, Pose, concatenate
from teamslam.io.files.delimited import Columns, read_columns
from teamslam.io.files.options import options_of
from teamslam.model import (
    Dataset,
    Dropped,
    Kind,
    Loss,
    Names,
    Table,
    Values,
    index_of,
    landmark_key,
    pack,
    pose_key,
    whitening,
)

ROBOTS = range(1, 6)
TICKS_PER_S = 1_000_000
TRUTH_GAP = TICKS_PER_S // 5  # motion capture runs at about 100 Hz; across longer holes there is no truth
BARCODE = ("subject", "barcode")
ODOMETRY = ("time", "forward velocity", "angular velocity")
MEASUREMENT = ("time", "barcode", "range", "bearing")
TRUTH = ("time", "x", "y", "orientation")
LANDMARK = ("subject", "x", "y", "x std-dev", "y std-dev")


@dataclass(frozen=True)
class Options:
    """What the reader of MRCLAM may be told.

    `delay_s` is how long before its stamp an image was taken, `odometry_lag_s` how long after its stamp a command takes
    effect. Of each robot's images one is used every `image_every_s`; images less than `merge_s` apart are one. Standard
    deviations of a sighting of a landmark and of a robot [m, rad], with the loss they are under; the densities of the
    odometry's noise are those of `velocity.VelocityNoise` (`odometry_forward` and so on).
    """

    delay_s: float = 0.0
    odometry_lag_s: float = 0.25
    image_every_s: float = 1.0
    merge_s: float = 0.005
    landmark_range_m: float = 0.13
    landmark_bearing_rad: float = 0.0085
    robot_range_m: float = 0.09
    robot_bearing_rad: float = 0.007
    loss: str = "cauchy"
    loss_scale: float = 2.0
    odometry_forward: float = 0.01
    odometry_sideways: float = 0.001
    odometry_turn: float = 0.001
    odometry_forward_per_metre: float = 0.07
    odometry_turn_per_radian: float = 0.11

    def __post_init__(self) -> None:
        for name in ("landmark_range_m", "landmark_bearing_rad", "robot_range_m", "robot_bearing_rad",
                     "odometry_forward", "odometry_sideways", "odometry_turn"):  # fmt: skip
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"expected a number above 0, found {getattr(self, name)}", field=name)
        for name in ("merge_s", "image_every_s", "odometry_forward_per_metre", "odometry_turn_per_radian"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise InputError(f"expected a number of 0 or more, found {getattr(self, name)}", field=name)
        for name in ("delay_s", "odometry_lag_s"):
            if not abs(getattr(self, name)) < 3600.0:
                raise InputError(f"expected a number of seconds below an hour, found {getattr(self, name)}", field=name)
        Loss(self.loss, self.loss_scale)

    @property
    def odometry(self) -> VelocityNoise:
        """The odometry's noise."""
        return VelocityNoise(
            forward=self.odometry_forward,
            sideways=self.odometry_sideways,
            turn=self.odometry_turn,
            forward_per_metre=self.odometry_forward_per_metre,
            turn_per_radian=self.odometry_turn_per_radian,
        )


@dataclass(frozen=True, eq=False)
class _Odometry:
    """A robot's commands at rising ticks."""

    ticks: IntArray  # (n,)
    velocities: Array  # (n, 2)

    def covers(self, ticks: IntArray) -> BoolArray:
        return np.asarray((ticks >= self.ticks[0]) & (ticks <= self.ticks[-1]))


@dataclass(frozen=True, eq=False)
class _Sightings:
    """What a robot saw: `ids` are the rows of its measurement file, `subjects` who was seen."""

    ids: IntArray
    ticks: IntArray
    subjects: IntArray
    range_bearing: Array  # (n, 2)

    def select(self, mask: BoolArray) -> "_Sightings":
        return _Sightings(self.ids[mask], self.ticks[mask], self.subjects[mask], self.range_bearing[mask])


class _Ledger:
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


def sniff(path: Path) -> bool:
    """True for a folder with MRCLAM's barcodes and odometry."""
    return (path / "Barcodes.dat").is_file() and any((path / f"Robot{n}_Odometry.dat").is_file() for n in ROBOTS)


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The team's log in an MRCLAM folder; `options` as in `Options`.

    Robots keep their numbers, landmarks their subject numbers; pose indices are microseconds. InputError names file,
    line and field of what cannot be read.
    """
    chosen = options_of(Options, options, reader="mrclam")
    path = Path(path)
    ledger = _Ledger()
    subjects = _read_barcodes(path / "Barcodes.dat")
    odometry = _read_team(path, chosen.odometry_lag_s, ledger)
    sightings = {robot: _sightings(robot, path, subjects, odometry, chosen, ledger) for robot in odometry}
    keyframes = _keyframes(odometry, sightings, chosen.merge_s)
    tables = [
        table for robot in odometry for table in _tables(robot, odometry[robot], sightings[robot], keyframes, chosen)
    ]
    dataset = Dataset(dict.fromkeys(odometry, 2), tuple(tables), Names(), dropped=ledger.dropped, origin=str(path))
    return _with_truth(dataset, path)


# --- the files ----------------------------------------------------------------------------------------------------


def _read_barcodes(path: Path) -> dict[int, int]:
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


def _read_team(path: Path, lag_s: float, ledger: _Ledger) -> dict[int, _Odometry]:
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
        team[robot] = _Odometry(ticks[lasts] + round(lag_s * TICKS_PER_S), velocities[lasts])
    if not team:
        raise InputError("no RobotN_Odometry.dat here (N from 1 to 5); expected the folder of an MRCLAM set", path=path)
    return team


def _sightings(
    robot: int,
    path: Path,
    subjects: Mapping[int, int],
    odometry: Mapping[int, _Odometry],
    options: Options,
    ledger: _Ledger,
) -> _Sightings:
    """What a robot saw that has a pose to hang on, in the images that are used."""
    seen = _read_sightings(robot, path / f"Robot{robot}_Measurement.dat", subjects, options.delay_s, ledger)
    seen = _within_odometry(robot, seen, odometry, ledger)
    images = merge(seen.ticks, round(options.merge_s * TICKS_PER_S))
    used = merge(images, max(round(options.image_every_s * TICKS_PER_S) - 1, 0))
    in_use = np.isin(keyframe_of(images, seen.ticks), used)
    reason = f"robot {robot}: sightings in images less than {options.image_every_s:g} s after the last one used"
    return seen.select(ledger.keep(in_use, reason))


def _read_sightings(robot: int, path: Path, subjects: Mapping[int, int], delay_s: float, ledger: _Ledger) -> _Sightings:
    """The sightings of known barcodes, at the time the image was taken."""
    found = read_columns(path, MEASUREMENT)
    barcodes = _whole(found, 1, path, MEASUREMENT)
    seen = np.array([subjects.get(code, -1) for code in barcodes.tolist()], np.int64)
    ticks = _ticks(found, path)
    all_rows = _Sightings(np.arange(len(ticks)), ticks - round(delay_s * TICKS_PER_S), seen, found.values[:, 2:])
    known = all_rows.select(ledger.keep(seen >= 0, f"robot {robot}: sightings of unknown barcodes (misreads)"))
    ahead = known.select(
        ledger.keep(*_never_back(known.ticks, f"robot {robot}: sightings whose stamps step back in time"))
    )
    return ahead.select(
        ledger.keep(ahead.range_bearing[:, 0] > 0.0, f"robot {robot}: sightings at a range of 0 or less")
    )


def _within_odometry(robot: int, seen: _Sightings, odometry: Mapping[int, _Odometry], ledger: _Ledger) -> _Sightings:
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


# --- the tables ---------------------------------------------------------------------------------------------------


def _keyframes(
    odometry: Mapping[int, _Odometry], sightings: Mapping[int, _Sightings], merge_s: float
) -> dict[int, IntArray]:
    """Where each robot needs a pose: when it saw something, and when it was seen."""
    return {
        robot: merge(
            np.concatenate([sightings[robot].ticks, *(s.ticks[s.subjects == robot] for s in sightings.values())]),
            round(merge_s * TICKS_PER_S),
        )
        for robot in odometry
    }


def _tables(
    robot: int, odometry: _Odometry, seen: _Sightings, keyframes: Mapping[int, IntArray], options: Options
) -> list[Table]:
    """Odometry and sightings of one robot."""
    ticks = keyframes[robot]
    tables = []
    if len(ticks) > 1:
        increments, covariances = integrate(odometry.ticks, odometry.velocities, ticks, options.odometry)
        keys = pose_key(robot, ticks)
        tables.append(
            Table(robot, "odometry", "relative_pose", 2, np.stack([keys[:-1], keys[1:]], -1),
                  pack(Pose.from_xytheta(increments)), whitening(covariances), np.arange(len(ticks) - 1))
        )  # fmt: skip
    of_robots = np.isin(seen.subjects, list(ROBOTS))
    for source, mask, sigmas in (
        ("landmarks", ~of_robots, (options.landmark_range_m, options.landmark_bearing_rad)),
        ("robots", of_robots, (options.robot_range_m, options.robot_bearing_rad)),
    ):
        if not mask.any():
            continue
        part = seen.select(mask)
        targets = landmark_key(part.subjects)
        for other, frames in keyframes.items():
            of_other = part.subjects == other
            targets[of_other] = pose_key(other, keyframe_of(frames, part.ticks[of_other]))
        keys = np.stack([pose_key(robot, keyframe_of(ticks, part.ticks)), targets], -1)
        noise = np.diag(1.0 / np.array(sigmas))[None]
        loss = Loss(options.loss, options.loss_scale)
        tables.append(Table(robot, source, "range_bearing", 2, keys, part.range_bearing, noise, part.ids, loss=loss))
    return tables


# --- truth --------------------------------------------------------------------------------------------------------


def _with_truth(dataset: Dataset, path: Path) -> Dataset:
    """The dataset with motion capture's poses at its keyframes and surveyed landmarks, as far as there are any."""
    robots = [_robot_truth(path / f"Robot{robot}_Groundtruth.dat", keys) for robot, keys in dataset.pose_keys.items()]
    keys, poses = zip(*robots, strict=True)
    marks, places = _landmark_truth(path / "Landmark_Groundtruth.dat", dataset.landmark_keys)
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    if sum(map(len, keys)):
        parts[Kind.POSE2] = np.concatenate(keys), concatenate(list(poses))
    if len(marks):
        parts[Kind.POINT2] = marks, places
    return replace(dataset, truth=Values.of(parts)) if parts else dataset


def _robot_truth(path: Path, keys: IntArray) -> tuple[IntArray, Pose]:
    """The keyframes of a robot that motion capture saw, and its poses there."""
    if not path.is_file():
        return keys[:0], Pose.identity(2, (0,))
    found = read_columns(path, TRUTH)
    stamps, first = np.unique(_ticks(found, path), return_index=True)
    poses, good = interpolate(stamps, Pose.from_xytheta(found.values[first, 1:]), index_of(keys), TRUTH_GAP)
    return keys[good], poses[np.flatnonzero(good)]


def _landmark_truth(path: Path, keys: IntArray) -> tuple[IntArray, Array]:
    """The landmarks among `keys` that were surveyed, and where they are."""
    if not path.is_file():
        return keys[:0], np.zeros((0, 2))
    found = read_columns(path, LANDMARK)
    surveyed, first = np.unique(landmark_key(_whole(found, 0, path, LANDMARK)), return_index=True)
    known = np.isin(surveyed, keys)
    return surveyed[known], found.values[first[known], 1:3]
