"""Clocks and latencies planted in many rooms of the virtual lab: how far off what is found is, in its own sigmas.

    python benchmarks/clocks.py --seeds 12 --seconds 40 --images-hz 3

Rooms, robots, odometry and clocks are those of `teamslam film --preset clocks`: clocks off by 10 to 500 ms that drift
by 50 ppm, latencies of 10 to 120 ms by camera, of which the team file says nothing. Corners are where the lens has
them, with the noise that is stated (`tests/clocks_room.py`), so no image is drawn or looked at.
"""

import argparse
import os
import sys
from collections import defaultdict
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

import clocks_room
import teamslam as ts


def main() -> None:
    """Prints a line for each number, and the mean NEES/dof of the maps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--images-hz", type=float, default=3.0)
    asked = parser.parse_args()
    off: dict[str, list[tuple[float, float]]] = defaultdict(list)
    nees = []
    for seed in range(1, asked.seeds + 1):
        seen, file, made = clocks_room.filmed(seed, asked.seconds, asked.images_hz)
        result, planted = ts.run(clocks_room.read(seen, file)), made.clocks
        true = {"latency robot1, front": planted.latency_s[0], "latency robot2, front": planted.latency_s[1],
                "clock offset robot2": planted.offset_s[1], "clock drift robot2": planted.drift[1]}  # fmt: skip
        for one in result.unknowns.found:
            name = f"{one.unknown.name} {one.unknown.of}"
            off[name].append((one.value - true[name], one.sigma))
        nees.append(result.scores[0].consistency.nees.per_dof)
    for name, each in sorted(off.items()):
        error, sigma = np.array(each).T
        unit, scale = ("ppm", 1e6) if "drift" in name else ("ms", 1e3)
        print(
            f"{name:24} squares in sigmas {np.mean((error / sigma) ** 2):.2f}, "
            f"at most {np.abs(error / sigma).max():.1f} sigmas and {scale * np.abs(error).max():.2f} {unit} off; "
            f"sigmas {scale * sigma.min():.2f} to {scale * sigma.max():.2f} {unit}"
        )
    print(f"NEES/dof of the maps {np.mean(nees):.2f}, {min(nees):.2f} to {max(nees):.2f}")


if __name__ == "__main__":
    main()
