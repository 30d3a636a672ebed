"""Exact joining against the full least squares that finds its way by itself, on simulated teams and on logs.

    python benchmarks/exact.py [LOG ...]

Exact: `teamslam.exact_join(teamslam.split(log))`. Full: `teamslam.full(log, initial=start)` to rounding, where `start`
is the ordinary join, and once more from that join with every unknown moved at random by a millimetre and a milliradian.
*gap* is what the exact join says of itself (the decrease of cost still to be had, over the cost); *cost* and *estimate*
are the largest differences between it and the two full solutions, the estimate's in metres and radians. *rounds* are
those in which all robots linearise, that of the join itself and those given up (curvature that turned out indefinite)
among them; bytes count eight for every number sent in them, up and down, and for every part of a step that was tried.
Simulated teams: 4 robots of 60 poses with `simulate`'s noise, seed 0.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import teamslam
from teamslam.joining import Joined, exact_join, full
from teamslam.sim import Options as Scenario
from teamslam.sim import simulate
from teamslam.solver import Options

TO_ROUNDING = Options(decrement=1e-12, cost_share=0.0)
SPACES = {"2d": "simulated, 2D", "planar": "simulated, planar", "3d": "simulated, 3D"}
MOVED = 1e-3  # [m], [rad]
HEAD = (
    "| log | submaps | components | rounds | bytes, up and down | gap | cost, relative | estimate | "
    "farthest from the one-round join [sigma] |",
    "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
)


@dataclass(frozen=True)
class Row:
    """One log: the exact join's own account, and the largest differences to the full least squares."""

    name: str
    submaps: int
    components: int
    rounds: int
    bytes: int
    gap: float
    cost: float
    estimate: float
    moved: float

    def __str__(self) -> str:
        return (
            f"| {self.name} | {self.submaps} | {self.components} | {self.rounds} | {self.bytes:,} | {self.gap:.0e} "
            f"| {self.cost:.0e} | {self.estimate:.0e} | {self.moved:.2g} |"
        )


def perturbed(joined: Joined, size: float) -> Joined:
    """The same map, every unknown moved at random."""
    rng = np.random.default_rng(0)
    parts = []
    for component in joined.components:
        values = component.map.values
        moved = values.retract(size * rng.standard_normal(values.layout.dof))
        parts.append(replace(component, map=replace(component.map, values=moved)))
    return replace(joined, components=tuple(parts))


def measure(name: str, log: teamslam.Dataset) -> Row:
    """The exact join of a log and both full solutions."""
    pieces = teamslam.split(log)
    exact = exact_join(pieces)
    start = teamslam.join([teamslam.build(piece) for piece in pieces])
    others = [full(log, initial=begin, options=TO_ROUNDING) for begin in (start, perturbed(start, MOVED))]
    pairs = [(a, b) for o in others for a, b in zip(exact.components, o.components, strict=True)]
    reports = [c.exactness for c in exact.components if c.exactness is not None]
    return Row(
        name,
        len(pieces),
        len(exact.components),
        max(r.rounds for r in reports),
        sum(r.bytes for r in reports),
        max(r.relative_cost_gap for r in reports),
        max(abs(a.map.cost - b.map.cost) / b.map.cost for a, b in pairs),
        max(float(np.abs(a.map.values.minus(b.map.values)).max()) for a, b in pairs),
        max(r.join_shift_sigma for r in reports),
    )


def logs(paths: list[Path]) -> Iterator[tuple[str, teamslam.Dataset]]:
    """Simulated teams, then those read."""
    for space, name in SPACES.items():
        yield name, simulate(Scenario(space=space, robots=4), 0)
    for path in paths:
        yield path.stem, teamslam.read(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    arguments = parser.parse_args()
    print("\n".join(HEAD), flush=True)
    for name, log in logs(arguments.logs):
        print(measure(name, log), flush=True)


if __name__ == "__main__":
    main()
