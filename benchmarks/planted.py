"""How often a mistake in a log is named, and how often one that nobody made: planted by hundreds, counted by kind.

    python benchmarks/planted.py --count 200                       simulated logs with a mistake each
    python benchmarks/planted.py --count 200 --innocent            ... and without one
    python benchmarks/planted.py --real MRCLAM_Dataset6 MRCLAM_Dataset7          every mistake in published logs
    python benchmarks/planted.py --count 200 --info                what `teamslam info` says, before a map is made
    python benchmarks/planted.py --seed 12                         what is said of one

What is planted is in tests/planted.py.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

import teamslam as ts
from planted import MISTAKES, Plant, draw, outcome, plant_in, said_by_info, said_by_run

OUTCOMES = ("right", "silent", "false")


def simulated(first: int, count: int, innocent: bool) -> Iterator[tuple[str, Plant]]:
    """The plants of some seeds."""
    for seed in range(first, first + count):
        plant = draw(seed, "" if innocent else None)
        if plant is not None:
            yield str(seed), plant


def real(paths: list[Path], innocent: bool) -> Iterator[tuple[str, Plant]]:
    """Every mistake in each log, in one robot's sensor or in all robots'."""
    for path in paths:
        log = ts.read(path)
        if innocent:
            yield path.name, Plant(log, "", (), (), path.name)
            continue
        for number, mistake in enumerate(MISTAKES):
            plant = plant_in(log, mistake, np.random.default_rng([number, 5]), path.name)
            if plant is not None:
                yield f"{path.name} {mistake}", plant


def main() -> None:
    """Count, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--innocent", action="store_true")
    parser.add_argument("--info", action="store_true")
    parser.add_argument("--real", type=Path, nargs="*", default=[])
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    first, count = (asked.seed, 1) if asked.seed is not None else (asked.first, asked.count)
    plants = real(asked.real, asked.innocent) if asked.real else simulated(first, count, asked.innocent)
    rows = []
    for name, plant in plants:
        began = time.process_time()
        causes = (said_by_info if asked.info else said_by_run)(plant.log)
        rows.append({"name": name, "mistake": plant.mistake or "none", "outcome": outcome(plant, causes)})
        rows[-1] |= {"robots": plant.robots, "world": plant.world, "seconds": round(time.process_time() - began, 2)}
        rows[-1]["said"] = [cause.sentence for cause in causes]
        if rows[-1]["outcome"] != "right" or asked.seed is not None:
            print(json.dumps(rows[-1]), flush=True)
    counts = Counter((row["mistake"], row["outcome"]) for row in rows)
    print(f"{'mistake':28}" + "".join(f"{name:>8}" for name in OUTCOMES))
    for mistake in sorted({row["mistake"] for row in rows}):
        print(f"{mistake:28}" + "".join(f"{counts[mistake, name]:8}" for name in OUTCOMES))
    print(f"{'all':28}" + "".join(f"{sum(r['outcome'] == name for r in rows):8}" for name in OUTCOMES))
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
