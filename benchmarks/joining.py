"""Joining beside full least squares on the same log: what Algorithm 2 costs once the robots have built their submaps.

    python benchmarks/joining.py [--poses 10000] [--repetitions 6] [--json FILE] [--page FILE]

Simulated teams of 5 robots. *join*: `teamslam.join(submaps)`, all of it: interiors eliminated, submaps placed, solved,
interiors put back. *join, whole*: the same with nothing eliminated. *full, solve*: the whole log's least squares from
the frames and values that the join started with (structure, iterations). *full, all*: `teamslam.full(log)`, which is
`run --method full`: the submaps that its start needs are built and joined too. *exactness*: how far the join is from
full. Least of all repetitions, taken in turns, in one process, so with what submaps keep once it was asked for (their
information, at the first join). Costs are F over all measurements at each map.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import teamslam as ts
from run import machine
from teamslam.joining import with_exactness
from teamslam.joining.exact.cost import cost_of
from teamslam.joining.join import interiors
from teamslam.joining.join.gauge import anchor
from teamslam.joining.join.interiors import members_of
from teamslam.joining.join.join import in_order
from teamslam.joining.join.optimum import usable_rows
from teamslam.joining.join.start_values import start_values
from teamslam.joining.place.place import place
from teamslam.joining.place.stack import Stack
from teamslam.model import Dataset, Submap, Values
from teamslam.sim import PRESETS, simulate
from teamslam.solver import System, optimise

T = TypeVar("T")
HEAD = (
    "| log | what | seconds | of the full solve | iterations | cost F |",
    "|---|---|---:|---:|---:|---:|",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000, help="of each of the 5 robots")
    parser.add_argument("--repetitions", type=int, default=6)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--page", type=Path, help="write the table as a page here")
    options = parser.parse_args()
    rows = [row for preset in ("2d", "planar") for row in measure(preset, options.poses, options.repetitions)]
    lines = [*HEAD, *(line(row) for row in rows)]
    print(f"{machine()}, teamslam {ts.__version__}\n\n" + "\n".join(lines))
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
    if options.page:
        options.page.write_text(page(lines))


def measure(preset: str, poses: int, repetitions: int) -> list[dict[str, Any]]:
    """The rows of one team."""
    log = simulate(replace(PRESETS[preset], robots=5, poses=poses, landmarks=max(poses // 20, 20)), 0)
    pieces = ts.split(log)
    submaps = [ts.build(piece) for piece in pieces]
    start, fixed = started(submaps)
    ordered = in_order(submaps)
    spared = [member.joined for member in members_of(ordered)]
    name = f"{preset}, {5 * poses} poses, {sum(map(len, log.tables))} measurements"
    rows: dict[str, dict[str, Any]] = {}

    def timed(what: str, work: Callable[[], T]) -> T:
        began = time.perf_counter()
        result = work()
        seconds = time.perf_counter() - began
        row = rows.setdefault(what, {"log": name, "what": what, "seconds": seconds, "iterations": None, "cost": None})
        row["seconds"] = min(row["seconds"], seconds)
        return result

    for _ in range(repetitions):
        joined = timed("join", lambda: ts.join(submaps))
        with mock.patch.object(interiors, "worth_it", lambda inside, unknowns: inside < 0):
            whole = timed("join, whole", lambda: ts.join(submaps))
        solution, cost = timed("full, solve", lambda: solved(log, start, fixed))
        timed("exactness", partial(with_exactness, joined, list(zip(pieces, submaps, strict=True))))
        timed("of the join: eliminating interiors", lambda: members_of(ordered))
        timed("of the join: placing submaps", lambda: place(spared))
    best = timed("full, all", lambda: ts.full(log))
    assert all(len(found.components) == 1 and found.converged for found in (joined, whole, best))
    for what, found in {"join": joined, "join, whole": whole, "full, all": best}.items():
        rows[what]["iterations"] = found.components[0].solution.iterations
        rows[what]["cost"] = cost_of(found.map, log.tables).cost
    rows["full, solve"] |= {"iterations": solution, "cost": cost}
    for row in rows.values():
        row["of_full_solve"] = row["seconds"] / rows["full, solve"]["seconds"]
    return list(rows.values())


def started(submaps: list[Submap]) -> tuple[Values, np.ndarray]:
    """The values that a join of all submaps starts with, and what is held fixed. A join finds these itself, and its
    time counts there; full least squares is given them."""
    ordered = in_order(submaps)
    (cluster,) = place(ordered).clusters
    members = [ordered[number] for number in cluster.members]
    start, fixed, _ = anchor(start_values(Stack.of(members), cluster.frames), members[0], [])
    return start, fixed


def solved(log: Dataset, start: Values, fixed: np.ndarray) -> tuple[int, float]:
    """Iterations and cost of the whole log's least squares from a start."""
    tables, _ = usable_rows(log.tables, start.layout)
    found = optimise(System(start.layout, tables=tables, fixed=fixed, names=log.names), start)
    assert found.converged
    return found.iterations, found.cost


def line(row: dict[str, Any]) -> str:
    iterations = "" if row["iterations"] is None else row["iterations"]
    cost = "" if row["cost"] is None else f"{row['cost']:.4f}"
    return (
        f"| {row['log']} | {row['what']} | {row['seconds']:.3f} | {row['of_full_solve']:.2f} | {iterations} | {cost} |"
    )


def page(lines: list[str]) -> str:
    said = __doc__.split("\n\n", 2)
    return "\n".join(
        [
            "# Joining beside full least squares",
            "",
            said[0] + "\n\n```bash\npython benchmarks/joining.py --page docs/benchmarks/joining.md\n```\n",
            said[2].strip(),
            "",
            f"{machine()}, teamslam {ts.__version__}.",
            "",
            *lines,
            "",
        ]
    )


if __name__ == "__main__":
    main()
