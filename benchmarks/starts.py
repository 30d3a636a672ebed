"""How often the full least squares from our own start reaches the cost of a start from the truth.

    python benchmarks/starts.py [--teams 10000] [--first-seed 0] [--workers 2] [--out docs/benchmarks/starts.md]

Teams of the paper's simulation at its highest noise (0.3 and 0.4, metres and radians), a quarter each of its two
scenarios with 4 and 12 poses a robot; team n of each has seed `first-seed` + n. Ours: `teamslam.full(dataset)`, which
sees the measurements alone. Truth: the same least squares from the true values. A team counts as reached where our
cost is at most (1 + 1e-6) times the truth's.
"""

import argparse
import os
import platform
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import teamslam
from teamslam.joining import full
from teamslam.sim.paper import NOISE_LEVELS, SCENARIOS, PaperOptions, simulate_paper
from teamslam.solver import System, optimise

POSES = (4, 12)
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Outcome:
    """One team: both costs, what joined, and the seconds that ours took."""

    seed: int
    ours: float
    from_truth: float
    components: int
    converged: bool
    seconds: float

    @property
    def reached(self) -> bool:
        """Whether our cost is the truth start's, or lower."""
        return self.components == 1 and self.ours <= (1.0 + TOLERANCE) * self.from_truth

    @property
    def lower(self) -> bool:
        """Whether ours is lower than the truth start's."""
        return self.reached and self.ours < (1.0 - TOLERANCE) * self.from_truth


def one_team(scenario: str, poses: int, seed: int) -> Outcome:
    """Both solves of one simulated team."""
    dataset = simulate_paper(PaperOptions(scenario, poses, *NOISE_LEVELS[-1]), seed)
    began = time.perf_counter()
    found = full(dataset)
    seconds = time.perf_counter() - began
    assert dataset.truth is not None
    base = found.map.base
    truth = dataset.truth.only(dataset.layout.keys)
    truth = truth.transform(truth.pose(base).inverse())
    reference = optimise(System(truth.layout, tables=dataset.tables, fixed=np.array([base])), truth)
    return Outcome(seed, found.map.cost, reference.cost, len(found.components), found.converged, seconds)


def cell(scenario: str, poses: int, seeds: range, pool: ProcessPoolExecutor) -> list[Outcome]:
    """All teams of one scenario and length."""
    return list(pool.map(one_team, [scenario] * len(seeds), [poses] * len(seeds), seeds, chunksize=25))


def row(scenario: str, poses: int, outcomes: Sequence[Outcome]) -> str:
    """One line of the table."""
    n = len(outcomes)
    reached, lower = sum(o.reached for o in outcomes), sum(o.lower for o in outcomes)
    split_up, open_ = sum(o.components > 1 for o in outcomes), sum(not o.converged for o in outcomes)
    median_ms = 1e3 * float(np.median([o.seconds for o in outcomes]))
    return (
        f"| {scenario} | {poses} | {n} | {reached} | {100.0 * reached / n:.2f} % | {lower} | {split_up} | {open_} "
        f"| {median_ms:.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, default=10_000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    first = arguments.first_seed
    seeds = range(first, first + arguments.teams // (len(SCENARIOS) * len(POSES)))
    lines = [
        "| scenario | poses | teams | reached | share | lower than truth | in pieces | not converged | median ms |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    everything: list[Outcome] = []
    missed: list[str] = []
    print("\n".join(lines), flush=True)
    with ProcessPoolExecutor(arguments.workers) as pool:
        for scenario in SCENARIOS:
            for poses in POSES:
                outcomes = cell(scenario, poses, seeds, pool)
                everything += outcomes
                lines.append(row(scenario, poses, outcomes))
                missed += [
                    f"- {scenario}, {poses} poses, seed {o.seed}: {o.ours:.3f}; from the truth {o.from_truth:.3f}"
                    for o in outcomes
                    if not o.reached
                ]
                print(lines[-1], flush=True)
    reached = sum(o.reached for o in everything)
    summary = f"{reached} of {len(everything)} teams reached ({100.0 * reached / len(everything):.2f} %)."
    print("\n".join([*missed, summary]))
    if arguments.out:
        arguments.out.write_text(page(lines, missed, summary, seeds, arguments.workers))


def page(lines: Sequence[str], missed: Sequence[str], summary: str, seeds: range, workers: int) -> str:
    """The page of the documentation: what was done, the table, what was missed."""
    assert __doc__ is not None
    teams = len(seeds) * len(SCENARIOS) * len(POSES)
    first = f" --first-seed {seeds.start}" if seeds.start else ""
    title, _, what = __doc__.strip().split("\n\n", 2)
    return "\n".join(
        [
            f"# {title.removesuffix('.')}",
            "",
            f"Measured by `python benchmarks/starts.py --teams {teams}{first} --workers {workers}` on a machine with "
            f"{os.cpu_count()} cores; teamslam {teamslam.__version__}, NumPy {np.__version__}, "
            f"Python {platform.python_version()}. Milliseconds are those of one team's `full`, other work beside it.",
            "",
            what,
            "",
            *lines,
            "",
            f"**{summary}**",
            "",
            *(["Costs where it was missed:", "", *missed, ""] if missed else []),
        ]
    )


if __name__ == "__main__":
    main()
