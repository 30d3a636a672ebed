"""A team that maps and talks for long over links that come and go: memory, file handles and threads must stay flat.

    python benchmarks/soak.py [--minutes 30] [--robots 3] [--json FILE]

Robots are processes in network namespaces (`ether`) with a loss of 5 %; pairs are torn apart all the time. They drive
for the first half of the time and stand for the second, and go on talking throughout. Of each, resident memory, open
handles and threads are read every second; a column holds their medians in six spans of the time, the first of which
starts when all are there, and the share of a span in which the robot was busy with exact rounds. While a robot drives
its memory grows with its finished submaps; while it stands it must not.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from crew import STARTS_S, Crew, team_of
from ether import Ether, Weather, in_a_namespace
from networks import PORT, Cuts
from run import machine

SPANS = 6
GROWS_MB, GROWS = 2.0, 4  # while it stands: more than this is a leak


def main() -> None:
    in_a_namespace()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    samples, in_rounds, same, equal = soaked(options)
    rows = [
        {
            "robot": robot,
            "what": what,
            "spans": [round(statistics.median(part), 1) for part in np.array_split(of, SPANS)],
        }
        for robot, found in samples.items()
        for what, of in zip(("memory_mb", "handles", "threads"), np.array(found).T, strict=True)
    ]
    rounds = {
        robot: [round(float(np.mean(part)), 2) for part in np.array_split(b, SPANS)] for robot, b in in_rounds.items()
    }
    print(f"{machine()}\n\n| robot | | {' | '.join(str(n + 1) for n in range(SPANS))} |\n|{'---|' * (SPANS + 2)}")
    for row in rows:
        print(f"| {row['robot']} | {row['what']} | {' | '.join(map(str, row['spans']))} |")
    for robot, shares in rounds.items():
        print(f"| {robot} | in rounds | {' | '.join(map(str, shares))} |")
    flat = all(row["spans"][-1] - row["spans"][-2] <= (GROWS_MB if "mb" in row["what"] else GROWS) for row in rows)
    print(f"\nflat while it stands: {flat}; all hold the same: {same}; the offline join: {equal}")
    if options.json:
        record = {"machine": machine(), "minutes": options.minutes, "rows": rows, "in_rounds": rounds, "flat": flat}
        options.json.write_text(json.dumps(record | {"same": same, "equal_to_offline": equal}, indent=1) + "\n")
    sys.exit(0 if flat and same and equal else 1)


def soaked(options: argparse.Namespace) -> tuple[dict[int, list[list[float]]], dict[int, list[bool]], bool, bool]:
    """Samples by robot, whether it was in rounds then, whether all held the same in the end, and whether that is the
    offline join."""
    seconds, robots = 60.0 * options.minutes, list(range(1, options.robots + 1))
    log = team_of(options.robots, max(24, round(seconds / 2)), options.seed)
    places = {robot: f"{Ether.address(robot)}:{PORT}" for robot in robots}
    samples: dict[int, list[list[float]]] = {robot: [] for robot in robots}
    in_rounds: dict[int, list[bool]] = {robot: [] for robot in robots}
    with (
        tempfile.TemporaryDirectory() as folder,
        Ether(robots, Weather(loss=0.05), options.seed) as ether,
        Crew(log, Path(folder), places, ether.inside, ("--speed", str(max(1.0, 48 / seconds)))) as crew,
    ):
        for robot in robots:
            crew.start(robot)
        crew.until(lambda: all(crew.status(robot) for robot in robots), STARTS_S)
        cuts, ends = Cuts(np.random.default_rng([options.seed, 5]), robots, ether), time.monotonic() + seconds
        while time.monotonic() < ends:
            cuts.now()
            crew.refuse_the_dead()
            for robot in robots:
                samples[robot].append(used(crew.processes[robot].pid))
                in_rounds[robot].append(bool(crew.status(robot).get("rounds", {}).get("busy")))
            time.sleep(1.0)
        cuts.heal()
        same = crew.until(crew.same, 120.0)
        for robot in robots:
            crew.end(robot)
        equal = set(crew.maps().values()) == {crew.offline_bits()}
    return samples, in_rounds, same, equal


def used(process: int) -> list[float]:
    """Resident memory [MB], handles and threads of a process."""
    place = Path(f"/proc/{process}")
    words: dict[str, Any] = dict(
        line.split(":", 1) for line in (place / "status").read_text().splitlines() if ":" in line
    )
    return [int(words["VmRSS"].split()[0]) / 1e3, len(list((place / "fd").iterdir())), int(words["Threads"])]


if __name__ == "__main__":
    main()
