"""One solver, one problem, one process: what run.py starts.

    python benchmarks/measure.py PROBLEM ESTIMATE REPETITIONS MARGINALS(0|1) SOLVER:VARIANT

Prints a line of JSON after the solves and one more after the marginals, so that whoever stops it for being slow still
has the first. Peak memory is counted from just before the first build, when imports and the problem are in memory.
"""

import gc
import importlib
import json
import os
import sys
import time
from pathlib import Path

from memory import forget_peak, peak_mb
from problems import Problem


def main(problem_path: str, estimate_path: str, repetitions: int, wants_marginals: bool, solver: str) -> None:
    name, _, variant = solver.partition(":")
    module = importlib.import_module(f"peers.{name}")
    problem = Problem.load(Path(problem_path))
    module.warm(problem)
    gc.collect()
    before = forget_peak()
    rows: dict[str, list[float]] = {"build_ms": [], "solve_ms": [], "read_ms": [], "total_ms": [], "cpu_ms": []}
    peak = 0.0
    for repetition in range(repetitions + (repetitions > 1)):
        used, began = time.process_time(), time.perf_counter()
        model = module.build(problem, variant)
        built = time.perf_counter()
        solved_model, iterations = module.solve(model)
        solved = time.perf_counter()
        estimate = module.read(solved_model)
        ended, used = time.perf_counter(), time.process_time() - used
        if repetition == 0:
            peak = peak_mb() - before
        if repetition > 0 or repetitions == 1:  # the first of several warms caches up
            times = (built - began, solved - built, ended - solved, ended - began, used)
            for part, seconds in zip(rows, times, strict=True):
                rows[part].append(1e3 * seconds)
    estimate.save(Path(estimate_path))
    result = {"version": module.version(), "iterations": iterations, "peak_mb": peak, **rows}
    print(json.dumps(result), flush=True)
    if not wants_marginals or not hasattr(module, "marginals"):
        return
    taken = []
    for _ in range(1 if rows["solve_ms"][0] > 100.0 else 5):
        began = time.perf_counter()
        trace = module.marginals(solved_model)
        taken.append(1e3 * (time.perf_counter() - began))
    print(json.dumps({**result, "marginals_ms": taken, "trace": trace}), flush=True)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "2")
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4] == "1", sys.argv[5])
