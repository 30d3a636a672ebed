"""teamslam beside its peers on one landmark SLAM problem, interleaved in one run.

    python benchmarks/run.py --size small|medium|large --dim 2|3 [--style lawn_mower|random_walk] [--json FILE]

Every solver gets the same arrays and the same start (dead reckoning), stops by its own rule when less than 1e-8 of the
cost is to be gained (the peers once a step gained less than that, teamslam once the next step would, by how steps have
shrunk), and its answer is judged by one neutral cost in NumPy: a row whose chi2 differs by more than 1e-8 from the
least says so. Each measurement is a process of its own; rounds go through all solvers in turn, so that noise of the
machine falls on all alike. Times are medians over all rounds [ms], total = build + solve + read back, cpu the time of
all threads in it; marginals are all landmarks' covariances, linearised and factorised anew. Peak memory is what the
solver adds to its process [MB].
Solvers that are not installed, or do not end in time, are listed below the table with the reason.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from peers import native
from problems import SIZES, STYLES, Estimate, Problem, cost, generate

HERE = Path(__file__).parent
SAME_OPTIMUM = 1e-8
FAR_OFF = 1e-2  # more than another model of the same noise explains
ROUNDS = {"small": 5, "medium": 3, "large": 1}
REPETITIONS = {"small": 51, "medium": 3, "large": 1}
EVERYWHERE = ("small", "medium", "large")


@dataclass(frozen=True)
class Solver:
    """A row of SOLVERS: `module` of peers/ (or a program of native.PROGRAMS), a variant of it, the sizes at which it
    ends in time, and those at which its marginals do."""

    name: str
    module: str
    variant: str = ""
    package: str = ""  # what must be importable; nothing for programs in C++
    sizes: tuple[str, ...] = EVERYWHERE
    marginals: tuple[str, ...] = ("small", "medium")
    note: str = ""

    @property
    def is_native(self) -> bool:
        """Whether it is a program in C++."""
        return self.module in native.PROGRAMS

    def missing(self) -> str:
        """Why it cannot run here, or nothing."""
        if self.is_native:
            return native.missing(self.module)
        return "" if find_spec(self.package) else f"not installed; pip install {self.package}"


BEARINGS = "its own cost: bearing and range"
SOLVERS = (
    Solver("teamslam", "ours", package="teamslam", marginals=EVERYWHERE),
    Solver("teamslam:1thread", "ours", "1thread", package="teamslam", marginals=EVERYWHERE),
    Solver("ceres", "ceres", "amd"),
    Solver("ceres:metis", "ceres", "metis"),
    Solver("g2o", "g2o", "cholmod"),
    Solver("g2o:eigen", "g2o", "eigen"),
    Solver("g2opy", "g2opy_wheel", package="g2opy", sizes=("small", "medium"), note="no marginals in the wheel"),
    Solver("gtsam", "gtsam_wheel", package="gtsam", sizes=("small", "medium"), marginals=("small",), note=BEARINGS),
    Solver("gtsam:metis", "gtsam_wheel", "metis", package="gtsam", marginals=("small",), note=BEARINGS),
    Solver("pyceres", "pyceres_wheel", package="pyceres", sizes=("small",), marginals=("small",)),
    Solver("symforce", "symforce_wheel", package="symforce", sizes=("small",), marginals=("small",)),
)
DEFAULT = [s.name for s in SOLVERS if s.name != "teamslam:1thread"]


def main() -> None:
    options = parse()
    problem = generate(SIZES[options.size], options.dim, options.style, options.seed)
    chosen = [s for s in SOLVERS if s.name in options.solvers]
    absent = {s.name: reason for s in chosen if (reason := s.missing())}
    absent |= {s.name: f"not run at this size ({s.note or 'too slow'})" for s in chosen if options.size not in s.sizes}
    runners = [s for s in chosen if s.name not in absent]
    with tempfile.TemporaryDirectory() as folder:
        measured = measure_all(runners, problem, options, Path(folder), absent)
    rows = [summary(s, measured[s.name]) for s in runners if s.name in measured]
    rows.sort(key=lambda row: row["total_ms"])
    compare(rows)
    print_table(rows, absent, problem, options)
    if options.json:
        report = {
            "command": " ".join([Path(sys.executable).name, *sys.argv]),
            "size": options.size, "dim": options.dim, "style": options.style, "seed": options.seed,
            "rounds": options.rounds, "machine": machine(), "rows": rows, "absent": absent,
        }  # fmt: skip
        options.json.write_text(json.dumps(report, indent=1) + "\n")


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2)
    parser.add_argument("--style", choices=STYLES, default=STYLES[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, help="of all solvers in turn; by default as the size needs")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds for one measurement")
    parser.add_argument("--solvers", type=lambda text: text.split(","), default=DEFAULT, help=", ".join(DEFAULT))
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    unknown = set(options.solvers) - {s.name for s in SOLVERS}
    if unknown:
        parser.error(
            f"no solver is called {', '.join(sorted(unknown))}; there are {', '.join(s.name for s in SOLVERS)}"
        )
    options.rounds = options.rounds or ROUNDS[options.size]
    return options


# --- measuring ----------------------------------------------------------------------------------------------------


def measure_all(
    runners: list[Solver], problem: Problem, options: argparse.Namespace, folder: Path, absent: dict[str, str]
) -> dict[str, list[dict[str, Any]]]:
    """All rounds; a solver that fails once is left out from then on, with the reason in `absent`."""
    problem.save(folder / "problem.npz")
    problem.save_flat(folder / "problem.bin")
    measured: dict[str, list[dict[str, Any]]] = {}
    for number in range(options.rounds):
        for solver in runners:
            if solver.name in absent:
                continue
            if sys.stderr.isatty():
                print(f"round {number + 1}: {solver.name} ...", file=sys.stderr)
            wanted = options.size in solver.marginals and slow_marginals(measured.get(solver.name)) < 2000.0
            try:
                result = measure_once(solver, folder, REPETITIONS[options.size], wanted, options.timeout)
            except RuntimeError as problem_found:
                absent[solver.name] = str(problem_found)
                measured.pop(solver.name, None)
                continue
            result["chi2"] = cost(problem, Estimate.load(folder / "estimate", problem))
            measured.setdefault(solver.name, []).append(result)
    return measured


def slow_marginals(results: list[dict[str, Any]] | None) -> float:
    return max((t for r in results or [] for t in r.get("marginals_ms", [])), default=0.0)


def measure_once(solver: Solver, folder: Path, repetitions: int, marginals: bool, timeout_s: float) -> dict[str, Any]:
    """One process. Raises RuntimeError with the reason where it gives no result."""
    estimate = folder / "estimate"
    estimate.unlink(missing_ok=True)
    arguments = [str(estimate), str(repetitions), str(int(marginals))]
    if solver.is_native:
        program = native.compiled(solver.module)
        command = [str(program), str(folder / "problem.bin"), *arguments, solver.variant]
    else:
        name = f"{solver.module}:{solver.variant}"
        command = [sys.executable, str(HERE / "measure.py"), str(folder / "problem.npz"), *arguments, name]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s)
        said, ended = done.stdout, f"ended with {done.returncode}: {(done.stderr.strip().splitlines() or [''])[-1]}"
    except subprocess.TimeoutExpired as late:
        said, ended = (late.stdout or b"").decode(), f"no result in {timeout_s:.0f} s"
    lines = [line for line in said.splitlines() if line.startswith("{")]
    if not lines:
        raise RuntimeError(ended)
    return dict(json.loads(lines[-1]))


# --- telling ------------------------------------------------------------------------------------------------------


def summary(solver: Solver, results: list[dict[str, Any]]) -> dict[str, Any]:
    """The medians over all rounds, and the spread of the totals."""

    def pool(part: str) -> list[float]:
        return [t for r in results for t in r.get(part, [])]

    row: dict[str, Any] = {"solver": solver.name, "version": results[0]["version"]}
    for part in ("build_ms", "solve_ms", "read_ms", "total_ms", "cpu_ms", "marginals_ms"):
        row[part] = statistics.median(pool(part)) if pool(part) else None
    totals = pool("total_ms")
    return row | {
        "total_min_ms": min(totals),
        "total_max_ms": max(totals),
        "iterations": results[0]["iterations"],
        "peak_mb": statistics.median(r["peak_mb"] for r in results),
        "chi2": statistics.median(r["chi2"] for r in results),
        "note": solver.note,
    }


def compare(rows: list[dict[str, Any]]) -> None:
    """Add to each row how many times the fastest it takes, and whether it reached the same optimum."""
    fastest = min(row["total_ms"] for row in rows)
    thriftiest = min(row["cpu_ms"] for row in rows)
    quickest = min((row["marginals_ms"] for row in rows if row["marginals_ms"]), default=None)
    least = min(row["chi2"] for row in rows)
    for row in rows:
        row["ratio"] = row["total_ms"] / fastest
        row["cpu_ratio"] = row["cpu_ms"] / thriftiest
        row["marginals_ratio"] = row["marginals_ms"] / quickest if row["marginals_ms"] else None
        row["same_optimum"] = bool(row["chi2"] <= least * (1.0 + SAME_OPTIMUM))
        above = row["chi2"] / least - 1.0
        if above > FAR_OFF or not (row["same_optimum"] or row["note"]):
            row["note"] = f"did not reach the optimum: chi2 is {above:.1g} above. {row['note']}".strip()


def print_table(
    rows: list[dict[str, Any]], absent: dict[str, str], problem: Problem, options: argparse.Namespace
) -> None:
    """The rows as a Markdown table."""
    print(
        f"{options.size} {options.dim}D {options.style}, seed {options.seed}: {problem.robots.max() + 1} robots, "
        f"{len(problem.robots)} poses, {len(problem.start_P)} landmarks, {len(problem.seen)} sightings; "
        f"{options.rounds} round(s)\n\n{machine()}\n"
    )
    head = ["solver", "version", "build", "solve", "iterations", "total", "min - max", "ratio", "cpu", "ratio",
            "marginals", "ratio", "peak MB", "chi2", ""]  # fmt: skip
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for row in rows:
        cells = [
            row["solver"], row["version"], number(row["build_ms"]), number(row["solve_ms"]), str(row["iterations"]),
            number(row["total_ms"]), f"{number(row['total_min_ms'])} - {number(row['total_max_ms'])}",
            f"{row['ratio']:.2f}", number(row["cpu_ms"]), f"{row['cpu_ratio']:.2f}", number(row["marginals_ms"]),
            f"{row['marginals_ratio']:.1f}" if row["marginals_ratio"] else "-",
            f"{row['peak_mb']:.0f}", f"{row['chi2']:.4f}", row["note"],
        ]  # fmt: skip
        print(f"| {' | '.join(cells)} |")
    print()
    for name, reason in absent.items():
        print(f"- {name}: {reason}")


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def machine() -> str:
    """Processor, its count, and the system, in words."""
    info = Path("/proc/cpuinfo")
    names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")] \
        if info.exists() else []  # fmt: skip
    processor = names[0] if names else platform.processor() or platform.machine()
    return (
        f"{os.cpu_count()} x {processor}, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
    )


if __name__ == "__main__":
    main()
