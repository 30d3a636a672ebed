"""Raw logs that come with I-SLSJF's local maps: Victoria Park as clean relative measurements, and simulated runs.

Both are one planar robot (number 1) whose poses are counted from 0 at the start.

- `VicPark_clean_data.mat`: rows of 12 numbers. Odometry: 1, start pose, end pose, dx, dy, dphi, then the covariance's
  upper triangle; observation: 0, pose, feature, dx, dy, Pxx, Pxy, Pyy. Positions are in the frame of the (start) pose,
  so these are the residuals of the paper's eqs. (3) and (4) as they stand.
- simulated runs: `sensor_data.mat` with rows step, beacon, range, bearing (step k is seen from pose k - 1), and
  `store_speed.mat`, `store_turnrate.mat`, the measured speeds v_k, w_k of an interval of 0.3 s. The robot first turns,
  then drives: dx = s cos(t), dy = s sin(t), dphi = t with s = v dt, t = w dt. Its readme calls 0.02, 4 deg, 0.1 and 1
  deg variances; against the stated truth they are standard deviations [m/s, rad/s, m, rad], and are read as such. Two
  speeds cannot give a pose of three numbers full covariance: `slip_m` is the missing standard deviation in x and y.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import AnyArray, Array, IntArray, Pose
from teamslam.io.files.mat import matrix, read_mat, whole
from teamslam.io.files.options import options_of
from teamslam.model import Dataset, Kind, Names, Table, Values, landmark_key, pack, pose_key, whitening

ROBOT = 1
CLEAN = "VicPark_clean_data"
SIMULATED = ("sensor_data", "store_speed", "store_turnrate")


def sniff(path: Path) -> bool:
    """The clean Victoria Park log or its folder, or the folder of a simulated run."""
    if path.is_dir():
        return (path / f"{CLEAN}.mat").exists() or all((path / f"{name}.mat").exists() for name in SIMULATED)
    return path.name == f"{CLEAN}.mat"


@dataclass(frozen=True)
class Options:
    """What the reader may be told.

    `slip_m` [m] is used for simulated runs only: how far the robot may slide in a step, beyond its two speeds.
    """

    slip_m: float = 1e-3


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The log of one robot; `options` as in `Options`. InputError names the file, matrix and row at fault."""
    chosen = options_of(Options, options, reader="islsjf")
    if not chosen.slip_m > 0.0:
        raise InputError(f"expected a length above 0 m, found {chosen.slip_m}", field="slip_m")
    clean = path / f"{CLEAN}.mat" if path.is_dir() else path
    if path.is_dir() and not clean.exists():
        return _read_simulated(path, chosen.slip_m)
    return _read_clean(clean)


def _read_clean(path: Path) -> Dataset:
    rows = matrix(read_mat(path), CLEAN, 12, path)
    if not np.isin(rows[:, 0], (0, 1)).all():
        bad = int(np.flatnonzero(~np.isin(rows[:, 0], (0, 1)))[0])
        raise InputError(
            f"row {bad + 1} begins with {rows[bad, 0]}, expected 1 (odometry) or 0 (observation)",
            path=path,
            field=CLEAN,
        )
    odometry, sightings = rows[rows[:, 0] == 1], rows[rows[:, 0] == 0]
    ends = whole(odometry[:, 1:3].ravel(), CLEAN, path).reshape(-1, 2)
    seen = whole(sightings[:, 1:3].ravel(), CLEAN, path).reshape(-1, 2)
    _check_chain(ends, seen, path)
    return Dataset(
        {ROBOT: 2},
        (
            _odometry(pose_key(ROBOT, ends), odometry[:, 3:6], _symmetric(odometry[:, 6:12], 3), path),
            Table(
                robot=ROBOT,
                source="landmarks",
                model="point",
                dim=2,
                keys=np.stack([pose_key(ROBOT, seen[:, 0]), landmark_key(seen[:, 1])], -1),
                values=sightings[:, 3:5].copy(),
                whitening=_whitening(_symmetric(sightings[:, 5:8], 2), "observation", path),
                ids=np.arange(len(sightings)),
            ),
        ),
        Names(tick_s=1.0),
        origin=str(path),
    )


def _check_chain(ends: IntArray, seen: IntArray, path: Path) -> None:
    """Odometry 0 -> 1 -> 2 ..., every sighting from one of these poses."""
    steps = np.arange(len(ends))
    wrong = (ends != np.stack([steps, steps + 1], -1)).any(1)
    if wrong.any():
        bad = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"odometry row {bad + 1} goes from pose {ends[bad, 0]} to {ends[bad, 1]}, expected {bad} to {bad + 1}: "
            f"poses are counted from 0 without gaps",
            path=path,
            field=CLEAN,
        )
    outside = (seen[:, 0] < 0) | (seen[:, 0] > len(ends)) | (seen[:, 1] < 0)
    if outside.any():
        bad = int(np.flatnonzero(outside)[0])
        raise InputError(
            f"observation {bad + 1} sees feature {seen[bad, 1]} from pose {seen[bad, 0]}, but odometry knows the poses "
            f"0 to {len(ends)} and features are numbered from 0",
            path=path,
            field=CLEAN,
        )


def _read_simulated(folder: Path, slip_m: float) -> Dataset:
    interval, speed_sd, turn_sd, range_sd, bearing_sd = 0.3, 0.02, np.deg2rad(4.0), 0.1, np.deg2rad(1.0)
    speed, turn = (_only(folder / f"{name}.mat").ravel() for name in SIMULATED[1:])
    if len(speed) != len(turn):
        raise InputError(
            f"{len(speed)} speeds and {len(turn)} turn rates should be as many", path=folder / "store_speed.mat"
        )
    length, angle = speed * interval, turn * interval
    motion = np.stack([length * np.cos(angle), length * np.sin(angle), angle], -1)
    slopes = np.zeros((len(speed), 3, 2))  # of (dx, dy, dphi) in (speed, turn rate)
    slopes[:, 0, 0], slopes[:, 1, 0] = interval * np.cos(angle), interval * np.sin(angle)
    slopes[:, 0, 1], slopes[:, 1, 1] = -interval * motion[:, 1], interval * motion[:, 0]
    slopes[:, 2, 1] = interval
    covariance = slopes @ np.diag([speed_sd**2, turn_sd**2]) @ np.swapaxes(slopes, 1, 2)
    covariance += np.diag([slip_m**2, slip_m**2, 0.0])
    steps = np.arange(len(speed))
    path = folder / "sensor_data.mat"
    seen = _only(path)
    if seen.shape[1] < 4:
        raise InputError(f"expected columns step, beacon, range, bearing, found {seen.shape[1]}", path=path)
    names = whole(seen[:, :2].ravel(), "sensor_data", path).reshape(-1, 2)
    outside = (names[:, 0] < 1) | (names[:, 0] > len(speed) + 1) | (names[:, 1] < 0)
    if outside.any():
        bad = int(np.flatnonzero(outside)[0])
        raise InputError(f"row {bad + 1}: step {names[bad, 0]} is not one of 1 to {len(speed) + 1}", path=path)
    return Dataset(
        {ROBOT: 2},
        (
            _odometry(pose_key(ROBOT, np.stack([steps, steps + 1], -1)), motion, covariance, folder),
            Table(
                robot=ROBOT,
                source="landmarks",
                model="range_bearing",
                dim=2,
                keys=np.stack([pose_key(ROBOT, names[:, 0] - 1), landmark_key(names[:, 1])], -1),
                values=seen[:, 2:4].copy(),
                whitening=np.diag([1.0 / range_sd, 1.0 / bearing_sd])[None],
                ids=np.arange(len(seen)),
            ),
        ),
        Names(tick_s=1.0),
        truth=_simulated_truth(folder, len(speed) + 1, names[:, 1]),
        origin=str(folder),
    )


def _simulated_truth(folder: Path, poses: int, beacons: IntArray) -> Values | None:
    """The true poses and the true places of the beacons seen, where the folder holds them."""
    robot, marks = folder / "store_robotTrue.mat", folder / "store_beaconsTrue.mat"
    if not (robot.exists() and marks.exists()):
        return None
    states, places = _only(robot).T, _only(marks)
    if states.shape != (poses, 3) or places.shape[1] != 3:
        raise InputError(f"expected {poses} columns of x, y, heading, found {states.T.shape}", path=robot)
    numbers = whole(places[:, 0], "store_beaconsTrue", marks)
    known = np.isin(numbers, beacons)
    if len(np.unique(numbers[known])) != known.sum():
        raise InputError("a beacon stands twice", path=marks)
    return Values.of(
        {
            Kind.POSE2: (pose_key(ROBOT, np.arange(poses)), Pose.from_xytheta(states)),
            Kind.POINT2: (landmark_key(numbers[known]), places[known, 1:]),
        }
    )


def _only(path: Path) -> Array:
    """The matrix of a file that holds one, named like the file."""
    return matrix(read_mat(path), path.stem, None, path)


def _odometry(keys: IntArray, motion: Array, covariance: Array, path: Path) -> Table:
    return Table(
        robot=ROBOT,
        source="odometry",
        model="relative_pose",
        dim=2,
        keys=keys,
        values=pack(Pose.from_xytheta(motion)),
        whitening=_whitening(covariance, "odometry row", path),
        ids=np.arange(len(keys)),
    )


def _symmetric(rows: AnyArray, size: int) -> Array:
    out = np.zeros((len(rows), size, size))
    i, j = np.triu_indices(size)
    out[:, i, j] = out[:, j, i] = rows
    return out


def _whitening(covariance: Array, noun: str, path: Path) -> Array:
    try:
        return whitening(covariance)
    except ModelError as error:
        problem = str(error)
    for k, single in enumerate(covariance, 1):
        try:
            whitening(single)
        except ModelError as error:
            raise InputError(f"{noun} {k}: {str(error).replace('covariance 0', 'the covariance')}", path=path) from None
    raise InputError(problem, path=path)
