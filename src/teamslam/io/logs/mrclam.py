"""UTIAS MRCLAM data sets: five planar robots, odometry commands, ranges and bearings to barcodes, motion capture.

What becomes of the rows that `mrclam_files` reads: one keyframe pose per camera image of a robot, and one wherever
another robot saw it; odometry between keyframes by `velocity.integrate`; sightings as `range_bearing` of landmarks and
of robots (a robot's heading is not seen). Truth is interpolated to the keyframes.

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
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.io.files.options import options_of
from teamslam.io.logs.mrclam_files import (
    ROBOTS,
    TICKS_PER_S,
    Ledger,
    Odometry,
    Sightings,
    read_barcodes,
    read_landmark_truth,
    read_odometry,
    read_robot_truth,
    read_sightings,
    within_odometry,
)
from teamslam.model import (
    Dataset,
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

TRUTH_GAP = TICKS_PER_S // 5  # motion capture runs at about 100 Hz; across longer holes there is no truth


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
    ledger = Ledger()
    subjects = read_barcodes(path / "Barcodes.dat")
    odometry = read_odometry(path, chosen.odometry_lag_s, ledger)
    sightings = {robot: _sightings(robot, path, subjects, odometry, chosen, ledger) for robot in odometry}
    keyframes = _keyframes(odometry, sightings, chosen.merge_s)
    tables = [
        table for robot in odometry for table in _tables(robot, odometry[robot], sightings[robot], keyframes, chosen)
    ]
    dataset = Dataset(dict.fromkeys(odometry, 2), tuple(tables), Names(), dropped=ledger.dropped, origin=str(path))
    return _with_truth(dataset, path)


def _sightings(
    robot: int,
    path: Path,
    subjects: Mapping[int, int],
    odometry: Mapping[int, Odometry],
    options: Options,
    ledger: Ledger,
) -> Sightings:
    """What a robot saw that has a pose to hang on, in the images that are used."""
    seen = read_sightings(robot, path / f"Robot{robot}_Measurement.dat", subjects, options.delay_s, ledger)
    seen = within_odometry(robot, seen, odometry, ledger)
    images = merge(seen.ticks, round(options.merge_s * TICKS_PER_S))
    used = merge(images, max(round(options.image_every_s * TICKS_PER_S) - 1, 0))
    in_use = np.isin(keyframe_of(images, seen.ticks), used)
    reason = f"robot {robot}: sightings in images less than {options.image_every_s:g} s after the last one used"
    return seen.select(ledger.keep(in_use, reason))


# --- the tables ---------------------------------------------------------------------------------------------------


def _keyframes(
    odometry: Mapping[int, Odometry], sightings: Mapping[int, Sightings], merge_s: float
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
    robot: int, odometry: Odometry, seen: Sightings, keyframes: Mapping[int, IntArray], options: Options
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
    stamps, seen = read_robot_truth(path)
    if not len(stamps):
        return keys[:0], seen
    poses, good = interpolate(stamps, seen, index_of(keys), TRUTH_GAP)
    return keys[good], poses[np.flatnonzero(good)]


def _landmark_truth(path: Path, keys: IntArray) -> tuple[IntArray, Array]:
    """The landmarks among `keys` that were surveyed, and where they are."""
    subjects, places = read_landmark_truth(path)
    known = np.isin(landmark_key(subjects), keys)
    return landmark_key(subjects[known]), places[known]
