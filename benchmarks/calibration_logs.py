"""Whether covariances are honest on real logs, as their noise is stated and calibrated, and what calibrating costs.

    python benchmarks/calibration_logs.py MRCLAM_Dataset6 MRCLAM_Dataset7 --out docs/benchmarks/calibration_logs.md

NEES/dof of landmarks together, with a frame fitted; of each pose's position and heading and of each landmark, on
average, after one alignment of the whole team, whose own uncertainty is counted (the map's covariance goes through the
alignment, by 400 draws); of all variables together. RMSE of robots and landmarks in metres. The cost is the processor's
time that calibrating and mapping once more take, beside that of building and joining (or of full least squares) in the
same process, on one thread: the least of three runs.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from teamslam.config import Config, JoinOptions
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io import read
from teamslam.metrics import score
from teamslam.metrics.frames import Aligned, align_team
from teamslam.model import Dataset, Submap, Values, is_landmark, is_pose
from teamslam.pipeline import Result, run
from teamslam.solver import Covariances

METHODS = {"join": Config(), "exact": Config(join=JoinOptions(exact=True)), "full": Config(method="full")}
EXTRA = ("calibration", "once more, put right")
SOLVE = ("building submaps", "joining submaps", "joining in rounds", "full least squares")
DRAWS = 400
HEAD = """# Calibration on real logs

Written by `{command}`.

```text
{what}
```

| log, method | | landmarks | position | heading | each landmark | whole | RMSE robots, landmarks | cost |
|---|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Map, score and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = "python benchmarks/calibration_logs.py " + " ".join(log.name for log in asked.logs)
    page = HEAD.format(command=command, what="\n\n".join((__doc__ or "").strip().split("\n\n")[2:]))
    print(page, end="")
    for log in asked.logs:
        for method in asked.methods:
            for line in rows(log.name, method, read(log), asked.runs):
                print(line, flush=True)
                page += line + "\n"
    if asked.out:
        asked.out.write_text(page)


def rows(name: str, method: str, log: Dataset, runs: int) -> Iterator[str]:
    """As the noise is stated, and calibrated."""
    for calibrate in (False, True):
        costs = []
        for _ in range(runs if calibrate else 1):
            spent = Spent()
            result = run(log, replace(METHODS[method], calibrate=calibrate), spent)
            costs.append(spent.cost)
        label = "| calibrated" if calibrate else f"{name}, {method} | as stated"
        yield f"| {label} | {scores(result)} | {f'{min(costs):.0%}' if calibrate else ''} |"


class Spent:
    """The processor's seconds of each stage, heard as a run tells its progress."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage, self._began = "", time.process_time()

    def __call__(self, stage: str, done: int, of: int) -> None:
        now = time.process_time()
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._began
        self._stage, self._began = stage, now

    @property
    def cost(self) -> float:
        """Of calibrating, beside that of the solve."""
        extra, solve = (sum(self.seconds.get(name, 0.0) for name in names) for names in (EXTRA, SOLVE))
        return extra / solve


def scores(result: Result) -> str:
    """The cells of one run."""
    *nees, robots, landmarks = numbers(result)
    rmse = ", ".join("" if np.isnan(x) else f"{x:.4f}" for x in (robots, landmarks))
    marks, position, heading, landmark, whole = ("" if np.isnan(x) else f"{x:.2f}" for x in nees)
    return f"{marks} | {position} | {heading} | {landmark} | {whole} | {rmse}"


def numbers(result: Result) -> list[float]:
    """NEES/dof of landmarks, positions, headings, each landmark and the whole, and the RMSE of robots and of landmarks
    [m] of one run; NaN where there is no truth of it."""
    assert result.truth is not None
    found, truth, map = result.scores[0], result.truth, result.map
    marks = score(map, truth.select(is_landmark(truth.layout.keys)), covariances=None).nees_per_dof
    aligned = align_team(map, truth)
    assert aligned is not None
    told = (marks, *one_by_one(map, aligned), found.nees_per_dof, found.robot_position_rmse_m, found.landmark_rmse_m)
    return [float("nan") if x is None else float(x) for x in told]


def one_by_one(map: Submap, aligned: Aligned) -> tuple[float, float, float]:
    """NEES/dof of single positions and headings of robots and of single landmarks of a map in the plane, on average."""
    keys, (shift, turn) = aligned.keys, _drawn(map, aligned)
    error = aligned.positions(keys)[:, :2] @ _turned(aligned.pose)
    covariance = np.einsum("nid,njd->nij", shift, shift) / DRAWS
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]) / 2
    oriented = aligned.known_poses(keys)
    heading = aligned.turns(oriented)[:, 2] ** 2 / np.mean(turn[np.isin(keys, oriented)] ** 2, -1)
    marks, robots = is_landmark(keys), is_pose(keys)
    return _mean(nees[robots]), _mean(heading), _mean(nees[marks])


def heading_errors(map: Submap, truth: Values) -> tuple[IntArray, Array, Array]:
    """The poses of a map in the plane whose headings are known, their errors and their deviations [rad], aligned."""
    aligned = align_team(map, truth)
    assert aligned is not None
    oriented = aligned.known_poses(aligned.keys)
    turn = _drawn(map, aligned)[1][np.isin(aligned.keys, oriented)]
    return oriented, aligned.turns(oriented)[:, 2], np.sqrt(np.mean(turn**2, -1))


def _drawn(map: Submap, aligned: Aligned) -> tuple[Array, Array]:
    """Errors of positions (n, 2, DRAWS) and headings (n, DRAWS) as the map has them, each draw aligned."""
    free = map.values.layout
    keys = aligned.keys
    here = free.contains(keys)
    draws = Covariances.of_map(map).draws(np.random.default_rng(0).standard_normal((free.dof, DRAWS)))
    at = free.dof_start[:-1][free.index(keys[here])]
    shift = np.zeros((len(keys), 2, DRAWS))
    shift[here] = draws[at[:, None] + np.arange(2)]
    turn = np.zeros((len(keys), DRAWS))
    poses = here & is_pose(keys)
    turn[poses] = draws[free.dof_start[:-1][free.index(keys[poses])] + 2]
    places = map.all_values.positions(keys, 2)
    swung = np.stack([-places[:, 1], places[:, 0]], -1).reshape(-1, 1)
    moved = np.concatenate([np.tile(np.eye(2), (len(keys), 1)), swung], 1)
    fit = -np.linalg.lstsq(moved, shift.reshape(-1, DRAWS), rcond=None)[0]
    return shift + (moved @ fit).reshape(shift.shape), turn + fit[2]


def _turned(pose: Pose) -> Array:
    return np.asarray(pose.rotation)[:2, :2]


def _mean(numbers: Array) -> float:
    return float(np.mean(numbers)) if len(numbers) else float("nan")


if __name__ == "__main__":
    main()
