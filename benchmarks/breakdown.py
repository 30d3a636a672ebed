"""Where teamslam's own time goes, size by size, against what this machine's arithmetic and memory allow.

    python benchmarks/breakdown.py [--sizes small,medium] [--repetitions 9]

One thread, the least of all repetitions [ms]. The limits: a factorisation cannot take less than its flops at the speed
of a large matrix product (measured here), nor than reading and writing the factor once at the speed of a copy.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy, which is to measure one thread

import argparse
import time
from collections.abc import Callable

import numpy as np

from peers import ours
from problems import SIZES, Problem, generate
from run import machine
from teamslam import kernel
from teamslam.solver import System


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=lambda text: text.split(","), default=["small", "medium"])
    parser.add_argument("--repetitions", type=int, default=9)
    options = parser.parse_args()
    product, copy = product_gflops(), copy_gbytes()
    print(f"{machine()}; one thread: matrix product {product:.1f} GF/s, copy {copy:.1f} GB/s\n")
    columns = [
        parts(generate(SIZES[size], dim, "lawn_mower", 0), options.repetitions, product, copy)
        for size in options.sizes
        for dim in (2, 3)
    ]
    print(f"| | {' | '.join(f'{size} {dim}D' for size in options.sizes for dim in (2, 3))} |")
    print(f"|---|{'---:|' * len(columns)}")
    for name in columns[0]:
        print(f"| {name} | {' | '.join(column[name] for column in columns)} |")


def parts(problem: Problem, repetitions: int, product: float, copy: float) -> dict[str, str]:
    """One column: what each part of a solve takes."""

    def least(call: Callable[[], object]) -> float:
        times = []
        for _ in range(repetitions):
            began = time.perf_counter()
            call()
            times.append(1e3 * (time.perf_counter() - began))
        return min(times)

    kernel.set_threads(1)
    model = ours.build(problem, "1thread")
    system, start = model.system, model.start
    at, places = system.linearise(start), start.positions(system.free.keys, 3)
    factor = system.factor(start)
    factor.factorise(at.hessian.numbers)
    step = factor.solve(at.gradient)
    found = kernel.Factor(kernel.Analysis(system.pattern, positions=places)).statistics
    factorise = least(lambda: factor.factorise(at.hessian.numbers))

    def fresh() -> System:
        return System(start.layout, tables=system.tables, fixed=model.poses[:1])

    return {
        "build: tables, values, problem": f"{least(lambda: ours.build(problem, '1thread')):.3g}",
        "pattern (once)": f"{least(lambda: fresh().pattern) - least(fresh):.3g}",
        "order and analyse (once)": f"{least(lambda: kernel.Analysis(system.pattern, positions=places)):.3g}",
        "linearise": f"{least(lambda: system.linearise(start)):.3g}",
        "factorise": f"{factorise:.3g}",
        "solve": f"{least(lambda: factor.solve(at.gradient)):.3g}",
        "retract": f"{least(lambda: system.retract(start, step)):.3g}",
        "all marginals": f"{least(factor.marginals):.3g}",
        "marginals of landmarks": f"{least(lambda: factor.marginals(system.free.index(model.marks))):.3g}",
        "whole solve": f"{least(lambda: ours.solve(model)):.3g}",
        "steps": str(ours.solve(model)[1]),
        "order": found.ordering.replace("_", " "),
        "numbers in L": f"{found.nonzeros:,}",
        "flops of a factorisation": f"{found.flops / 1e6:,.1f} M",
        "factorise [GF/s]": f"{found.flops / factorise / 1e6:.1f}",
        "limit of flops": f"{found.flops / product / 1e6:.3g}",
        "limit of memory": f"{2.0 * 8.0 * found.nonzeros / copy / 1e6:.3g}",
    }


def product_gflops() -> float:
    """Of a matrix product of 1,000 rows and columns."""
    a = np.random.default_rng(0).normal(size=(1000, 1000))
    return 2.0 * 1000**3 / 1e9 / _least(lambda: a @ a)


def copy_gbytes() -> float:
    """Read and written, of 64 MB."""
    a = np.zeros(8_000_000)
    b = np.empty_like(a)
    return 2.0 * a.nbytes / 1e9 / _least(lambda: np.copyto(b, a))


def _least(call: Callable[[], object]) -> float:
    times = []
    for _ in range(10):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return min(times)


if __name__ == "__main__":
    main()
