"""Robots that are killed (SIGKILL) at random moments and started anew, again and again, while they map and exchange.

    python benchmarks/kills.py [--kills 100] [--robots 4] [--poses 200] [--json FILE]

Each robot is a process with sockets and a journal of its own; any may be killed, at any time, also while it starts and
while it talks. Every second kill waits for its victim's journal to grow and strikes then: while it writes. In the end
all must hold the same, no journal may be damaged, nothing that a robot had told of may be gone, and all maps must be
the offline join of all rows, to the bit.
"""

import argparse
import json
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from crew import STARTS_S, Crew, local_places, team_of
from run import machine

PATIENCE_S = 600.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--speed", type=float, default=1.0, help="a pose a second at 1")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    robots = list(range(1, options.robots + 1))
    log, rng = team_of(options.robots, options.poses, options.seed), np.random.default_rng([options.seed, 4])
    with (
        tempfile.TemporaryDirectory() as folder,
        Crew(log, Path(folder), local_places(robots), extra=("--speed", str(options.speed))) as crew,
    ):
        for robot in robots:
            crew.start(robot)
        crew.until(lambda: all(crew.status(robot) for robot in robots), STARTS_S)
        told: dict[str, int] = {}
        writing = 0
        for number in range(options.kills):
            time.sleep(float(rng.exponential(options.poses / options.speed / options.kills)))
            victim = int(rng.choice(robots))
            writing += number % 2 and waited_for_ink(crew.folder / str(victim) / "journal.db-wal")
            for robot in robots:
                told |= {id_: max(v, told.get(id_, 0)) for id_, v in versions(crew.status(robot)).items()}
            crew.end(victim, signal.SIGKILL)
            crew.start(victim)
        same = crew.until(crew.same, PATIENCE_S)
        holds = versions(crew.status(robots[0]))
        codes = [crew.end(robot) for robot in robots]
        maps = crew.maps()
        offline = crew.offline_bits()
    row = {
        "kills": options.kills,
        "while_writing": int(writing),
        "same": same,
        "told_and_gone": sorted(id_ for id_, version in told.items() if holds.get(id_, -1) < version),
        "exit_codes": codes,
        "maps_equal": len(maps) == len(robots) and len(set(maps.values())) == 1,
        "equal_to_offline": set(maps.values()) == {offline},
    }
    print(f"{machine()}\n\n| kills | while it writes | told and gone | exit codes | maps equal | the offline join |")
    print("|---|---|---|---|---|---|")
    print(
        f"| {row['kills']} | {row['while_writing']} | {len(row['told_and_gone'])} | {codes} | {row['maps_equal']} "
        f"| {row['equal_to_offline']} |"
    )
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": [row]}, indent=1) + "\n")
    sys.exit(0 if row["equal_to_offline"] and not row["told_and_gone"] and not any(codes) else 1)


def versions(status: dict[str, Any]) -> dict[str, int]:
    """The newest version of each submap that a robot says it holds."""
    return {
        id_: int(version) for id_, _, version in (held.rpartition(", version ") for held in status.get("holds", ()))
    }


def waited_for_ink(file: Path) -> bool:
    """Wait for a file to be written to, for 2 s at most, and say whether it was."""
    before, until = _size(file), time.monotonic() + 2.0
    while time.monotonic() < until:
        if _size(file) != before:
            return True
    return False


def _size(file: Path) -> tuple[int, int]:
    try:
        found = file.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


if __name__ == "__main__":
    main()
