"""Corners of tags: all frames and tags by least squares over all corners, beside Ceres and GTSAM from their wheels.

    python benchmarks/corners.py [--frames 10000] [--tags 40] [--seed 0] [--rounds 3] [--limit 600] [--json FILE]

The problem is that of corner_problem.py, the solvers are those of peers/corners.py. Each stops when a step gains less
than 1e-8 of the cost; all are judged by one neutral cost. Ceres and GTSAM call a cost function in Python for each tag
in each frame, as people write it who use them from Python: nearly all of their time goes there. Each measurement is a
process of its own, and rounds go through all solvers in turn. Where others use the machine, the seconds of processors
that a process took, on all its threads, tell more than those of the clock.

Each measurement is told as it ends, and stands in `--json` from then on; the table is of the medians. A solver that is
not installed, gives no result in `--limit` seconds of processors or ends without one stands below the table, and under
`absent`, with the reason, and is not asked again.
"""

import argparse
import json
import multiprocessing
import signal
import statistics
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from corner_problem import cost, problem
from peers.corners import SOLVERS

FIELDS = ("solver", "version", "build_s", "solve_s", "processor_s", "steps", "cost", "tags_mm")
HEAD = """| solver | build [s] | solve [s] | both, processors [s] | steps | cost | tags off [mm] |
|---|---:|---:|---:|---:|---:|---:|"""
Row = dict[str, Any]


def main() -> None:
    asked = parse()
    of, _ = problem(asked.frames, asked.tags, asked.seed)
    said = f"{len(of.frames.T)} frames, {len(of.tags.T)} tags, {len(of.frame)} sightings of four corners"
    print(said, flush=True)
    absent = {name: reason for name in asked.solvers if (reason := missing(name))}
    rows: list[Row] = []
    for number in range(asked.rounds):
        for name in asked.solvers:
            if name in absent:
                continue
            try:
                rows.append(measured(name, (asked.frames, asked.tags, asked.seed), asked.limit))
                print(f"round {number + 1}: {line(rows[-1:])}", file=sys.stderr, flush=True)
            except RuntimeError as problem_found:
                absent[name] = str(problem_found)
                print(f"round {number + 1}: {name}: {problem_found}", file=sys.stderr, flush=True)
            if asked.json:
                report = {"problem": said, "rounds": asked.rounds, "limit_s": asked.limit, "rows": rows}
                asked.json.write_text(json.dumps(report | {"absent": absent}, indent=1) + "\n")
    print(table(rows, absent))


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--tags", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of processors for one measurement")
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    parser.add_argument("--json", type=Path, help="write the numbers here too, as they come")
    return parser.parse_args()


def missing(solver: str) -> str:
    """Why it cannot run here, or nothing."""
    package = SOLVERS[solver][0]
    return "" if find_spec(package) else f"not installed; pip install {package}"


# --- measuring --------------------------------------------------------------------------------------------------------


def measured(solver: str, of: tuple[int, int, int], limit_s: float) -> Row:
    """One solver, once, on the problem of so many frames and tags and a seed. RuntimeError where it gives no result."""
    apart = multiprocessing.get_context("spawn")
    here, there = apart.Pipe(duplex=False)
    process = apart.Process(target=_measure, args=(there, solver, *of, limit_s))
    process.start()
    there.close()
    try:
        row: Row = here.recv()
    except EOFError:
        process.join()
        if process.exitcode == -signal.SIGPROF:
            raise RuntimeError(f"no result in {limit_s:g} s of processors") from None
        raise RuntimeError(f"ended without a result (exit status {process.exitcode})") from None
    finally:
        process.kill()
        process.join()
    return row


def _measure(to: Connection, solver: str, frames: int, tags: int, seed: int, limit_s: float) -> None:
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    of, truth = problem(frames, tags, seed)
    package, solve = SOLVERS[solver]
    began = time.process_time()
    ways, walls, steps, build_s, solve_s = solve(of)
    processor_s = time.process_time() - began
    off = float(1e3 * np.sqrt(np.mean(np.sum((walls.T - truth.T) ** 2, -1))))
    numbers = (build_s, solve_s, processor_s, steps, cost(of, ways, walls), off)
    to.send(dict(zip(FIELDS, (solver, version(package), *numbers), strict=True)))


# --- telling ----------------------------------------------------------------------------------------------------------


def table(rows: Sequence[Row], absent: dict[str, str]) -> str:
    """The medians of each solver that gave a result each time, and what is absent."""
    names = [name for name in dict.fromkeys(row["solver"] for row in rows) if name not in absent]
    lines = [f"| {line([row for row in rows if row['solver'] == name])} |" for name in names]
    return "\n".join([HEAD, *lines, *(f"{name}: {reason}" for name, reason in absent.items())])


def line(mine: Sequence[Row]) -> str:
    """The cells of one solver."""
    build, solve, both = (statistics.median(row[part] for row in mine) for part in FIELDS[2:5])
    last = mine[-1]
    cells = (f"{last['solver']} {last['version']}", f"{build:.2f}", f"{solve:.2f}", f"{both:.2f}", last["steps"])
    return " | ".join(map(str, (*cells, f"{last['cost']:.4f}", f"{last['tags_mm']:.3f}")))


if __name__ == "__main__":
    main()
