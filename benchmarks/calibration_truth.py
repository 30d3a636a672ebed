"""How far motion capture's headings are those of the robots: what of a map's NEES is the truth's own.

    python benchmarks/calibration_truth.py MRCLAM_Dataset6 MRCLAM_Dataset7 --out docs/benchmarks/calibration_truth.md

From the truth alone, and the robots' commands: how the heading wobbles within a second (rms of what a cubic leaves of
64 samples, the median of such windows; all frequencies from 2 Hz), at rest, on a straight drive and in turns; and the
angle from the heading to the direction of travel (the median over straight drives of 1.5 s and 10 cm and more). Two
witnesses of the true heading that do not know each other, in windows of ten seconds: that angle, from the true places
alone, and where the robot's camera sees surveyed landmarks from there (images taken 40 ms before their stamps). By how
much each wanders from window to window (1.48 times the median deviation), and their correlation: where both wander
together, it is the true heading that does. From the map (full, calibrated): the mean error of heading, weighed by its
deviations, and NEES/dof of single headings as they are, with that mean, of each robot, taken out, and as they are where
images are read as taken 40 ms before their stamps (`delay_s` 0.04 and as much less lag of the commands, which is the
same map): the truth then is that of when the image was taken. The last row is without the robot of which both witnesses
wander together most.
"""

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from calibration_logs import heading_errors
from teamslam.config import Config
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io import read
from teamslam.io.logs.mrclam_files import (
    Ledger,
    Sightings,
    read_barcodes,
    read_landmark_truth,
    read_odometry,
    read_robot_truth,
    read_sightings,
)
from teamslam.model import robot_of
from teamslam.pipeline import run

LAG_S, WINDOW, FEWEST = 0.25, 64, 10
DELAY_S, TOGETHER_S, SEEN = 0.04, 10.0, 3
STEP_S, DRIVE_S, DRIVE_M, STRAIGHT_RAD = 0.5, 1.5, 0.1, 0.03
HEAD = """# How far motion capture's headings are those of the robots

Written by `{command}`.

```text
{what}
```

| log, robot | wobble: rest, straight, turn [mrad] | travel off heading | wanders: travel, camera [mrad] | together \
| map's error [mrad] | NEES/dof | taken out | 40 ms |
|---|---|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Truth:
    """The truth of one robot: stamps (n,) [s], places (n, 2), headings (n,) [rad], and commands v, w (n,) there."""

    stamps: Array
    places: Array
    headings: Array
    v: Array
    w: Array

    def wobble(self, which: BoolArray) -> float:
        """rms [rad] of what a cubic leaves of a second, in the median of windows; nan of few."""
        taper, time = np.hanning(WINDOW), np.linspace(-1.0, 1.0, WINDOW)
        spectra = [
            np.abs(np.fft.rfft(taper * (part - np.polyval(np.polyfit(time, part, 3), time)))) ** 2
            for start in range(0, len(which) - WINDOW, WINDOW)
            if which[start : start + WINDOW].all() and np.ptp(self.stamps[start : start + WINDOW]) < 1.2
            for part in [self.headings[start : start + WINDOW]]
        ]
        if len(spectra) < FEWEST:
            return float("nan")
        density = np.median(spectra, 0) * 2.0 / np.log(2.0) / (WINDOW * (taper**2).sum())
        return float(np.sqrt(density[2:].sum()))

    def travel(self, lasting_s: float, least_m: float) -> tuple[Array, Array]:
        """The direction of travel beside the heading [rad], and when, on straight drives that last so long."""
        begin = np.arange(self.stamps[0], self.stamps[-1] - lasting_s, STEP_S)
        (x, y, turned), middle = self._at(begin + lasting_s) - self._at(begin), begin + lasting_s / 2.0
        angle = _angle(np.arctan2(y, x) - self._at(middle)[2])
        straight = (np.hypot(x, y) > least_m) & (np.abs(turned) < STRAIGHT_RAD) & (np.abs(angle) < 0.3)
        return angle[straight], middle[straight]

    def _at(self, stamps: Array) -> Array:
        """Places and heading at other stamps (3, n)."""
        return np.stack([np.interp(stamps, self.stamps, part) for part in (*self.places.T, self.headings)])

    def camera(self, seen: Sightings, marks: IntArray, places: Array) -> tuple[Array, Array]:
        """What sightings of surveyed landmarks say of the heading beside it [rad], and when."""
        stamps = seen.ticks * 1e-6
        here = np.isin(seen.subjects, marks) & (stamps > self.stamps[0]) & (stamps < self.stamps[-1])
        stamps, bearings = stamps[here], seen.range_bearing[here, 1]
        from_here = places[np.searchsorted(marks, seen.subjects[here])]
        *there, heading = self._at(stamps)
        x, y = from_here.T - np.stack(there)
        return _angle(np.arctan2(y, x) - bearings - heading), stamps

    def windows(self, told: tuple[Array, Array], fewest: int) -> Array:
        """The median of what was told, window by window; nan of few."""
        angles, stamps = told
        which = ((stamps - self.stamps[0]) / TOGETHER_S).astype(int)
        every = range(int(np.ptp(self.stamps) / TOGETHER_S) + 1)
        return np.array([np.median(angles[which == k]) if (which == k).sum() >= fewest else np.nan for k in every])


def _angle(angle: Array) -> Array:
    return np.asarray(np.angle(np.exp(1j * angle)))


def _wander(windows: Array) -> float:
    return float(1.48 * np.nanmedian(np.abs(windows - np.nanmedian(windows))))


def truths(log: Path) -> dict[int, Truth]:
    """Those of a log, by robot."""
    out = {}
    for robot, commands in read_odometry(log, LAG_S, Ledger()).items():
        ticks, poses = read_robot_truth(log / f"Robot{robot}_Groundtruth.dat")
        at = np.clip(np.searchsorted(commands.ticks, ticks, "right") - 1, 0, None)
        places = poses.xytheta()
        out[robot] = Truth(ticks * 1e-6, places[:, :2], np.unwrap(places[:, 2]), *commands.velocities[at].T)
    return out


def rows(log: Path) -> list[str]:
    """One for each robot, one for all, and one for all but one."""
    keys, error, sigma = headings(log, 0.0)
    late, late_error, late_sigma = headings(log, DELAY_S)
    subjects, (marks, places) = (
        read_barcodes(log / "Barcodes.dat"),
        read_landmark_truth(log / "Landmark_Groundtruth.dat"),
    )
    out, parts, wander = [], [], {}
    for robot, truth in truths(log).items():
        mine, also = robot_of(keys) == robot, robot_of(late) == robot
        mean = np.average(error[mine], weights=sigma[mine] ** -2.0)
        parts.append([(error[mine] / sigma[mine]) ** 2, ((error[mine] - mean) / sigma[mine]) ** 2])
        parts[-1].append((late_error[also] / late_sigma[also]) ** 2)
        still, fast, turns = np.abs(truth.v) < 1e-6, truth.v > 0.02, np.abs(truth.w)
        moods = (still & (turns < 1e-6), fast & (turns < 1e-6), turns > 0.05)
        wobble = ", ".join("-" if np.isnan(w) else f"{1e3 * w:.1f}" for w in map(truth.wobble, moods))
        seen = read_sightings(robot, log / f"Robot{robot}_Measurement.dat", subjects, DELAY_S, Ledger())
        course = truth.travel(DRIVE_S, DRIVE_M)
        travel = truth.windows(course, SEEN)
        camera = truth.windows(truth.camera(seen, marks, places), SEEN)
        both = np.isfinite(travel + camera)
        together = np.corrcoef(travel[both], camera[both])[0, 1]
        wander[robot] = np.cov(travel[both], camera[both])[0, 1]
        out.append(
            f"| {log.name}, {robot} | {wobble} | {1e3 * np.median(course[0]):+.1f} "
            f"| {1e3 * _wander(travel):.1f}, {1e3 * _wander(camera):.1f} | {together:+.2f} of {both.sum()} "
            f"| {1e3 * mean:+.1f} | " + " | ".join(f"{part.mean():.2f}" for part in parts[-1]) + " |"
        )
    worst = max(wander, key=wander.__getitem__)
    for who, which in (("all", wander), (f"all but {worst}", wander.keys() - {worst})):
        chosen = [part for robot, part in zip(wander, parts, strict=True) if robot in which]
        means = " | ".join(f"{np.concatenate(part).mean():.2f}" for part in zip(*chosen, strict=True))
        out.append(f"| {log.name}, {who} | | | | | | {means} |")
    return out


def headings(log: Path, delay_s: float) -> tuple[IntArray, Array, Array]:
    """The poses of the map whose headings are known, their errors and their deviations [rad]."""
    result = run(read(log, delay_s=delay_s, odometry_lag_s=LAG_S - delay_s), Config(method="full"))
    assert result.truth is not None
    return heading_errors(result.map, result.truth)


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = "python benchmarks/calibration_truth.py " + " ".join(log.name for log in asked.logs)
    page = HEAD.format(command=command, what="\n\n".join((__doc__ or "").strip().split("\n\n")[2:]))
    page += "".join(line + "\n" for log in asked.logs for line in rows(log))
    print(page)
    if asked.out:
        asked.out.write_text(page)


if __name__ == "__main__":
    main()
