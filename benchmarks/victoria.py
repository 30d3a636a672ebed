"""Victoria Park from dead reckoning alone: splitting and joining beside solvers that start from the whole at once.

    python benchmarks/victoria.py [--json FILE]

The log is `VicPark_clean_data.mat`. chi2 is the sum of squared whitened residuals of eqs. (3) and (4), with the log's
own covariances, taken by one function for every row. From dead reckoning start: teamslam by parts (split, build, join,
full), teamslam's Gauss-Newton and Levenberg-Marquardt on the whole, GTSAM's Levenberg-Marquardt and dogleg on the whole
(sightings as bearing and range, its fastest factor). At the end GTSAM starts from teamslam's answer with exactly
the residuals of the log (custom factors): what it finds is at most a rounding away where the answer is a minimum.
"""

import argparse
import json
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import teamslam as ts
from datasets import VICTORIA_PARK, folder_of
from run import machine
from teamslam.joining.start.starts import reckoned
from teamslam.model import Dataset, Values
from teamslam.solver import Options, System, optimise


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    began = time.perf_counter()
    dataset = ts.read(folder_of(VICTORIA_PARK) / "VicPark_clean_data.mat")
    print(f"{machine()}\nread in {time.perf_counter() - began:.2f} s: {len(dataset.pose_keys[1])} poses, "
          f"{len(dataset.landmark_keys)} landmarks, {dataset.dof} numbers measured\n")  # fmt: skip
    print("| from dead reckoning | seconds | iterations | chi2 |\n|---|---|---|---|")
    start = reckoned(dataset, 1)
    rows = [row("dead reckoning, as it stands", dataset, start, 0.0, 0)]
    answer, seconds = by_parts(dataset)
    rows.append(row("teamslam: split, build, join, full", dataset, answer, seconds, 0))
    for rule in ("gauss_newton", "levenberg_marquardt"):
        rows.append(whole(dataset, start, rule))
    if find_spec("gtsam"):
        from peers import gtsam_park

        for name in ("LevenbergMarquardt", "Dogleg"):
            began = time.perf_counter()
            try:
                found, iterations = gtsam_park.optimum(dataset, start, name, exact=False)
            except RuntimeError as problem:
                failed = f"GTSAM: {name} ({str(problem).strip().splitlines()[0]})"
                rows.append(row(failed, dataset, start, time.perf_counter() - began, 0))
                continue
            rows.append(row(f"GTSAM: {name}", dataset, found, time.perf_counter() - began, iterations))
        began = time.perf_counter()
        found, iterations = gtsam_park.optimum(dataset, answer, "LevenbergMarquardt", exact=True)
        rows.append(row("GTSAM from teamslam's answer", dataset, found, time.perf_counter() - began, iterations))
        rows[-1]["moved_m"] = float(np.abs(found.state - answer.state).max())
    else:
        print("gtsam is not installed; pip install gtsam", file=sys.stderr)
    if "moved_m" in rows[-1]:
        print(f"\nGTSAM moved teamslam's answer by at most {rows[-1]['moved_m']:.2g} (metres, or entries of R).")
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")


def by_parts(dataset: Dataset) -> tuple[Values, float]:
    """The project's own way, from the log to the optimum, and how long it took."""
    began = time.perf_counter()
    joined = ts.join([ts.build(piece) for piece in ts.split(dataset)])
    best = ts.full(dataset, initial=joined)
    return best.map.all_values, time.perf_counter() - began


def whole(dataset: Dataset, start: Values, rule: str) -> dict[str, Any]:
    """teamslam's solver on the whole log at once."""
    began = time.perf_counter()
    system = System(start.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1], names=dataset.names)
    try:
        solution = optimise(system, start, Options(rule=rule, max_iterations=100))
    except ts.TeamslamError as problem:
        return row(f"teamslam: {rule} ({problem})", dataset, start, time.perf_counter() - began, 0)
    seconds = time.perf_counter() - began
    return row(f"teamslam: {rule} on the whole", dataset, solution.values, seconds, solution.iterations)


def row(name: str, dataset: Dataset, values: Values, seconds: float, iterations: int) -> dict[str, Any]:
    """One line of the table, judged by the models' own residuals in NumPy."""
    chi2 = sum(float(np.sum(table.whitened(values) ** 2)) for table in dataset.tables)
    print(f"| {name} | {seconds:.2f} | {iterations or '-'} | {chi2:.6f} |", flush=True)
    return {"solver": name, "seconds": seconds, "iterations": iterations, "chi2": chi2}


if __name__ == "__main__":
    main()
