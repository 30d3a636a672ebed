"""From log files to a map with figures, stage by stage, beside what is done by hand today.

    python benchmarks/log_to_map.py [--preset 2d|planar] [--poses 10000 ...] [--limit 600] [--json F] [--page F]

A simulated team of 5 robots in one folder of CSV files. teamslam goes through its stages as `teamslam run` does, all of
them, figures included. By hand, in the plane: pandas reads the same files, robots are dead reckoned by NumPy, and
somebody's solver finds the optimum from there, by its own Levenberg-Marquardt until a step gains less than 1e-8 of the
cost: GTSAM from Python (sightings as bearing and range, which its wheel has compiled), Ceres and g2o in C++, fed by a
script. Nothing is said there of how sure the map is or whether it fits, and nothing is drawn. All are judged by one
cost: teamslam's F at each estimate. Each tool by hand has a process of its own, stopped after `--limit` seconds.
`teamslam, solve alone` is what the solver itself needs where somebody has read the log and gives a start: full least
squares over the same rows, all at once, one run with its analysis. Its start is every robot's dead reckoning from its
true first pose, and each landmark where it was first seen; making that is not counted.
Rows: `{tool, stage, seconds, cpu}` (cpu: processor seconds, of threads together, where they are known) and
`{tool, total, cost}`; what gives no map here stands under `absent` with the reason.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from compileall import compile_dir
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import teamslam as ts
from peers import native
from run import machine
from teamslam.geometry import Pose, concatenate
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.joining.start.targets import place_targets
from teamslam.model import Dataset, Kind, Values, landmark_key, pose_key, pose_kind
from teamslam.results import read_run
from teamslam.sim import PRESETS
from teamslam.solver import Options, Solution, System, optimise

T = TypeVar("T")
Row = dict[str, Any]
HERE = Path(__file__).parent
BY_HAND = {"pandas + GTSAM": "gtsam", "pandas + Ceres": "ceres", "pandas + g2o": "g2o"}


class Stages:
    """Seconds of each stage of one tool."""

    def __init__(self, tool: str) -> None:
        self.tool, self.rows = tool, list[Row]()

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        began, used = time.perf_counter(), time.process_time()
        result = work()
        seconds, cpu = time.perf_counter() - began, time.process_time() - used
        self.rows.append({"tool": self.tool, "stage": stage, "seconds": seconds, "cpu": cpu})
        return result

    def total(self, cost: float) -> Row:
        total = {"tool": self.tool, "total": sum(row["seconds"] for row in self.rows), "cost": cost}
        known = all("cpu" in row for row in self.rows)
        return {**total, "cpu": sum(row["cpu"] for row in self.rows)} if known else total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", choices=("2d", "planar"), default="2d")
    parser.add_argument("--poses", type=int, nargs="+", default=[10_000], help="of each of the 5 robots; sizes in turn")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds for each tool by hand")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--page", type=Path, help="write the tables as a page here")
    options = parser.parse_args()
    reports = [measured(options.preset, poses, options.limit) for poses in options.poses]
    text = "\n\n".join(table(options.preset, **report) for report in reports)
    print(f"{machine()}\n\n{text}")
    if options.json:
        whole = {"machine": machine(), "preset": options.preset, **reports[0], "more": reports[1:]}
        options.json.write_text(json.dumps(whole, indent=1) + "\n")
    if options.page:
        options.page.write_text(page(text), encoding="utf-8")


def measured(preset: str, poses: int, limit_s: float) -> Row:
    """The rows of all tools on one team, and what gave no map."""
    absent: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as work:
        log = Path(work) / "log"
        world = replace(PRESETS[preset], robots=5, poses=poses, landmarks=max(poses // 20, 20))
        ts.write(ts.simulate(world, 0), log, format="plain")
        dataset = ts.read(log)
        rows = [*whole(log, dataset, Path(work) / "out"), *alone(dataset), *ours(log, Path(work) / "map")]
        for tool, solver in BY_HAND.items():
            if preset != "2d":
                absent[tool] = "its programs here know no points in space seen from the plane"
            elif reason := missing(solver):
                absent[tool] = reason
            else:
                try:
                    rows += by_hand(tool, solver, log, dataset, Path(work), limit_s)
                except RuntimeError as problem:
                    absent[tool] = str(problem)
    return {"poses": poses, "rows": rows, "absent": absent}


def whole(log: Path, dataset: Dataset, out: Path) -> list[Row]:
    """The command, everything included, its code compiled as that of an installed package is."""
    compile_dir(Path(ts.__file__).parent, quiet=1)
    began, used = time.perf_counter(), os.times()
    command = [sys.executable, "-m", "teamslam", "run", str(log), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    seconds, now = time.perf_counter() - began, os.times()
    cpu = now.children_user + now.children_system - used.children_user - used.children_system
    stages = Stages("teamslam run")
    stages.rows.append({"tool": stages.tool, "stage": "everything", "seconds": seconds, "cpu": cpu})
    return finished(stages, dataset, read_run(out).maps[0].all_values)


def alone(dataset: Dataset) -> list[Row]:
    """The solver from a given start."""
    stages, start = Stages("teamslam, solve alone"), given(dataset)

    def solve() -> Solution:
        system = System(start.layout, tables=dataset.tables, fixed=start.layout.keys[:1], names=dataset.names)
        return optimise(system, start, Options(elsewhere=False))

    return finished(stages, dataset, stages("solve", solve).values)


def given(dataset: Dataset) -> Values:
    """Every robot's dead reckoning from its true first pose, and each landmark where it was first seen."""
    assert dataset.truth is not None
    ways: dict[Kind, list[tuple[np.ndarray, Pose]]] = {}
    for robot, dim in dataset.robots.items():
        way = dead_reckoning(dataset, robot)
        keys = way.layout.keys
        first, poses = dataset.truth.poses_of(keys[:1], dim), way.poses_of(keys, dim)
        ways.setdefault(pose_kind(dim), []).append((keys, first @ poses))
    of_kind: dict[Kind, tuple[np.ndarray, Pose | np.ndarray]] = {
        kind: (np.concatenate([keys for keys, _ in own]), concatenate([poses for _, poses in own]))
        for kind, own in ways.items()
    }
    return place_targets(Values.of(of_kind), dataset.tables, dataset.layout)


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


def missing(solver: str) -> str:
    """Why a tool cannot run here, or nothing."""
    wanted = ["pandas", *(["gtsam"] if solver == "gtsam" else [])]
    absent = [name for name in wanted if not find_spec(name)]
    if absent:
        return f"not installed; pip install {' '.join(absent)}"
    return "" if solver == "gtsam" else native.missing(solver)


def by_hand(tool: str, solver: str, log: Path, dataset: Dataset, work: Path, limit_s: float) -> list[Row]:
    """A tool's rows. Raises RuntimeError with the reason where it gives no map."""
    rows, found = work / "rows.json", work / "map.npz"
    if solver != "gtsam":
        native.compiled(solver)
    command = [sys.executable, str(HERE / "peers" / "by_hand.py"), solver, str(log), str(rows), str(found)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"no map in {limit_s:.0f} s") from None
    if done.returncode:
        raise RuntimeError(f"ended with {done.returncode}: {(done.stderr.strip().splitlines() or [''])[-1]}")
    stages = Stages(tool)
    stages.rows += [{"tool": tool, **row} for row in json.loads(rows.read_text())]
    return finished(stages, dataset, values_of(found))


def values_of(path: Path) -> Values:
    """A map that was made by hand."""
    with np.load(path) as file:
        ways = {int(name.split("_")[1]): file[name] for name in file.files if name.startswith("robot_")}
        names, marks = file["names"], file["marks"]
    keys = np.concatenate([pose_key(r, np.arange(len(way)) * 1_000_000) for r, way in ways.items()])
    poses = Pose.from_xytheta(np.concatenate(list(ways.values())))
    return Values.of({Kind.POSE2: (keys, poses), Kind.POINT2: (landmark_key(names), marks)})


def finished(stages: Stages, dataset: Dataset, values: Values) -> list[Row]:
    """The rows of a tool, its total last."""
    system = System(values.layout, tables=dataset.tables, fixed=values.layout.keys[:1], names=dataset.names)
    return [*stages.rows, stages.total(float(system.cost(values)))]


def table(preset: str, poses: int, rows: list[Row], absent: dict[str, str]) -> str:
    """Every tool's stages, and their totals, in words."""
    lines = [f"## 5 robots, {5 * poses:,} poses, preset {preset}", ""]
    lines += ["| tool | total [s] | processor [s] | cost F |", "|---|---:|---:|---:|"]
    lines += [f"| {r['tool']} | {r['total']:.2f} | {shown(r)} | {r['cost']:.3f} |" for r in rows if "total" in r]
    lines += [f"| {tool} | {why} | | |" for tool, why in absent.items()]
    lines += ["", "| tool | stage | seconds |", "|---|---|---:|"]
    lines += [f"| {r['tool']} | {r['stage']} | {r['seconds']:.2f} |" for r in rows if "stage" in r]
    return "\n".join(lines)


def shown(row: Row) -> str:
    """The processor seconds of a row, where they are known."""
    return f"{row['cpu']:.2f}" if "cpu" in row else ""


def page(text: str) -> str:
    """The tables with what they mean and the command that made them."""
    first, _, rest = __doc__.split("\n\n", 2)
    command = f"python {' '.join(sys.argv)}"
    return f"# From log to map\n\n{first}\n\n```bash\n{command}\n```\n\n{rest.strip()}\n\n{machine()}.\n\n{text}\n"


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
