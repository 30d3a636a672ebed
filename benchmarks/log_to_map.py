"""From log files to a map with figures, stage by stage, beside what is done by hand today.

    python benchmarks/log_to_map.py [--preset 2d|planar] [--poses 10000] [--json FILE] [--page FILE]

A simulated team of 5 robots in one folder of CSV files. teamslam goes through its stages as `teamslam run` does. By
hand: pandas reads the same files, robots are dead reckoned, and GTSAM solves from there (sightings as bearing and
range, which its wheel has compiled; in the plane only). Both are judged by one cost: teamslam's F at each estimate.
Rows: `{tool, stage, seconds}` and `{tool, total, cost}`; what cannot run here stands under `absent` with the reason.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import teamslam as ts
from run import machine
from teamslam.model import Dataset, Values
from teamslam.sim import PRESETS
from teamslam.solver import System

T = TypeVar("T")
Row = dict[str, Any]


class Stages:
    """Seconds of each stage of one tool."""

    def __init__(self, tool: str) -> None:
        self.tool, self.rows = tool, list[Row]()

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        began = time.perf_counter()
        result = work()
        self.rows.append({"tool": self.tool, "stage": stage, "seconds": time.perf_counter() - began})
        return result

    def total(self, cost: float) -> Row:
        return {"tool": self.tool, "total": sum(row["seconds"] for row in self.rows), "cost": cost}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", choices=("2d", "planar"), default="2d")
    parser.add_argument("--poses", type=int, default=10_000, help="of each of the 5 robots")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--page", type=Path, help="write the table as a page here")
    options = parser.parse_args()
    absent = {"g2o, Ceres": "their programs of benchmarks/peers know no sightings between robots"}
    with tempfile.TemporaryDirectory() as work:
        log = Path(work) / "log"
        world = replace(PRESETS[options.preset], robots=5, poses=options.poses, landmarks=max(options.poses // 20, 20))
        ts.write(ts.simulate(world, 0), log, format="plain")
        dataset = ts.read(log)
        rows = ours(log, Path(work) / "map")
        if options.preset != "2d":
            absent["pandas + GTSAM"] = "its wheel has no compiled factor for points in space seen from the plane"
        elif not (find_spec("gtsam") and find_spec("pandas")):
            absent["pandas + GTSAM"] = "not installed; pip install gtsam pandas"
        else:
            from peers.by_hand import from_files

            stages = Stages("pandas + GTSAM")
            rows += [*stages.rows, *finished(stages, dataset, from_files(log, dataset, stages))]
    text = table(rows, absent, options)
    print(text)
    if options.json:
        report = {
            "machine": machine(),
            "preset": options.preset,
            "poses": options.poses,
            "rows": rows,
            "absent": absent,
        }
        options.json.write_text(json.dumps(report, indent=1) + "\n")
    if options.page:
        options.page.write_text(f"# From log to map\n\n{text}\n", encoding="utf-8")


def ours(log: Path, out: Path) -> list[Row]:
    """teamslam's stages."""
    from teamslam.config import Config
    from teamslam.results import Record, draw_record, write_record

    stages = Stages("teamslam")
    dataset = stages("read", lambda: ts.read(log))
    stages("split", lambda: ts.split(dataset))
    result = ts.run(dataset)
    names = {"building submaps": "build, with starts", "joining submaps": "join"}
    stages.rows += [{"tool": stages.tool, "stage": names.get(k, k), "seconds": v} for k, v in result.seconds.items()]
    record = stages("report", lambda: Record.of(result))
    stages("covariances of all poses", lambda: [covariances.all for covariances in record.covariances])
    stages("write", lambda: write_record(record, Config(), out))
    stages("figures", lambda: draw_record(record, out / "figures"))
    return finished(stages, dataset, result.map.all_values)


def finished(stages: Stages, dataset: Dataset, values: Values) -> list[Row]:
    """The rows of a tool, its total last."""
    system = System(values.layout, tables=dataset.tables, fixed=values.layout.keys[:1], names=dataset.names)
    return [*stages.rows, stages.total(float(system.cost(values)))]


def table(rows: list[Row], absent: dict[str, str], options: argparse.Namespace) -> str:
    lines = [f"{machine()}, `{' '.join([Path(sys.executable).name, *sys.argv])}`", ""]
    lines += [f"5 robots, {5 * options.poses:,} poses, preset {options.preset}.", ""]
    lines += ["| tool | stage | seconds |", "|---|---|---|"]
    lines += [f"| {r['tool']} | {r['stage']} | {r['seconds']:.2f} |" for r in rows if "stage" in r]
    lines += ["", "| tool | total [s] | cost F |", "|---|---|---|"]
    lines += [f"| {r['tool']} | {r['total']:.2f} | {r['cost']:.3f} |" for r in rows if "total" in r]
    return "\n".join([*lines, "", *(f"Not run: {name}: {why}." for name, why in absent.items())])


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
