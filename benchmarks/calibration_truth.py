"""How far motion capture's headings are those of the robots: what of a map's NEES is the truth's own.

    python benchmarks/calibration_truth.py MRCLAM_Dataset6 MRCLAM_Dataset7 --out docs/benchmarks/calibration_truth.md

From the truth alone, and the robots' commands: how the heading wobbles within a second (rms of what a cubic leaves of
64 samples, the median of such windows; all frequencies from 2 Hz), at rest, on a straight drive and in turns; and the
angle from the heading to the direction of travel (the median over straight drives of a second and 8 cm and more). From
the map (full, calibrated): the mean error of heading, weighed by its deviations, and NEES/dof of single headings as
they are and with that mean, of each robot, taken out.
"""

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from calibration_logs import heading_errors
from teamslam.config import Config
from teamslam.geometry import Array, BoolArray
from teamslam.io import read
from teamslam.io.logs.mrclam_files import Ledger, read_odometry, read_robot_truth
from teamslam.model import robot_of
from teamslam.pipeline import run

LAG_S, WINDOW, FEWEST = 0.25, 64, 10
HEAD = """# How far motion capture's headings are those of the robots

Written by `{command}`.

```text
{what}
```

| log, robot | wobble: rest, straight, turn [mrad] | travel off heading | map's error [mrad] | NEES/dof | taken out |
|---|---|---|---|---|---|
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

    @property
    def travel(self) -> float:
        """The direction of travel beside the heading [rad]."""
        way = self.places[WINDOW:] - self.places[:-WINDOW]
        there = self.headings[WINDOW // 2 :][: len(way)]
        turned = np.abs(self.headings[WINDOW:] - self.headings[:-WINDOW])
        angle = np.angle(np.exp(1j * (np.arctan2(way[:, 1], way[:, 0]) - there)))
        straight = (np.hypot(*way.T) > 0.08) & (turned < 0.02) & (np.abs(angle) < 0.3)
        return float(np.median(angle[straight]))


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
    """One for each robot, and one for all."""
    result = run(read(log), Config(method="full"))
    assert result.truth is not None
    keys, error, sigma = heading_errors(result.map, result.truth)
    out, squares, without = [], [], []
    for robot, truth in truths(log).items():
        mine = robot_of(keys) == robot
        mean = np.average(error[mine], weights=sigma[mine] ** -2.0)
        squares.append((error[mine] / sigma[mine]) ** 2)
        without.append(((error[mine] - mean) / sigma[mine]) ** 2)
        still, fast, turns = np.abs(truth.v) < 1e-6, truth.v > 0.02, np.abs(truth.w)
        moods = (still & (turns < 1e-6), fast & (turns < 1e-6), turns > 0.05)
        wobble = ", ".join("-" if np.isnan(w) else f"{1e3 * w:.1f}" for w in map(truth.wobble, moods))
        out.append(
            f"| {log.name}, {robot} | {wobble} | {1e3 * truth.travel:+.1f} | {1e3 * mean:+.1f} "
            f"| {squares[-1].mean():.2f} | {without[-1].mean():.2f} |"
        )
    both = (np.concatenate(part).mean() for part in (squares, without))
    return [*out, f"| {log.name}, all | | | | " + " | ".join(f"{mean:.2f}" for mean in both) + " |"]


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
