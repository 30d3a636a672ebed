"""How joining by a tree grows with the team: time and memory against poses, and what happens when workers die.

    python benchmarks/growth.py run --work /tmp/growth --workers 2        # writes /tmp/growth/*.json, resumes
    python benchmarks/growth.py draw --work /tmp/growth                   # table and figure into docs/

Logs are made first, one file a robot (see growing_team.py), and are not part of the time. What is timed is from log
files to the estimate of every pose and landmark on disk. Every size runs in a process of its own. Memory is sampled
every 0.1 s: the resident memory of all its processes together, and of the largest; pages that processes share count
in each.
"""

import argparse
import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import numpy as np

from growing_team import Team, write_log
from teamslam.geometry import align
from teamslam.model import pose_key
from teamslam.scale.cluster import Cluster, Processes, Workers, crew
from teamslam.scale.tree import join_in_tree
from teamslam.scale.treemap import TreeMap

DOCS = Path(__file__).parents[1] / "docs"
MORE_ROBOTS = [(1, 1_000), (1, 3_000), (1, 10_000), (3, 10_000), (10, 10_000), (32, 10_000), (100, 10_000)]
LONGER_LOGS = [(100, 100), (100, 300), (100, 1_000), (100, 3_000)]
KILLED = [("processes", 100, 1_000), ("dask", 100, 1_000)]
LARGEST = [("dask", 100, 10_000)]


class Memory:
    """The resident memory [MB] of this process and all below it: the most in all, and the most of any one."""

    def __init__(self) -> None:
        self.together = self.largest = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sample, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """No more samples."""
        self._stop.set()
        self._thread.join()

    def _sample(self) -> None:
        while not self._stop.wait(0.1):
            sizes = [resident_mb(pid) for pid in (os.getpid(), *below(os.getpid()))]
            self.together, self.largest = max(self.together, sum(sizes)), max(self.largest, *sizes)


def resident_mb(pid: int) -> float:
    """The resident memory of a process; 0 where it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def below(pid: int) -> list[int]:
    """All processes started by a process, and by those."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        children = [int(c) for task in tasks for c in (task / "children").read_text().split()]
    except OSError:
        return []
    return [p for child in children for p in (child, *below(child))]


@contextmanager
def workers_of(kind: str, count: int) -> Iterator[tuple[Workers, Callable[[], list[int]]]]:
    """Workers, and who they are (process ids) once they run."""
    if kind == "processes":
        yield Processes(count), lambda: [p for p in below(os.getpid()) if "spawn_main" in command_of(p)]
        return
    from distributed import LocalCluster

    cluster = LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None, silence_logs=50)
    try:
        yield Cluster(cluster.scheduler_address), lambda: [nanny.pid for nanny in cluster.workers.values()]
    finally:
        cluster.close()


def cpu_seconds() -> float:
    """Processor time of this process and of those below it that have ended."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def command_of(pid: int) -> str:
    """The command line of a process."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def measure(team: Team, work: Path, kind: str, count: int, kill: bool) -> dict[str, object]:
    """One run: what it took and what came out."""
    logs, folder = work / f"logs_{team.robots}_{team.poses}", work / f"join_{kind}_{team.robots}_{team.poses}"
    with crew(Processes(count)) as makers:
        files = makers.each(write_log, [(team, robot, logs) for robot in range(1, team.robots + 1)])
    shutil.rmtree(folder, ignore_errors=True)
    stages: dict[str, float] = {}
    killed: list[int] = []
    cpu = cpu_seconds()
    with workers_of(kind, count) as (workers, pids):
        memory, began = Memory(), time.perf_counter()

        def tell(stage: str, done: int, of: int) -> None:
            stages.setdefault(stage, time.perf_counter() - began)
            if kill and not killed and done >= of // 2 and done:
                killed.append(pids()[0])
                os.kill(killed[0], signal.SIGKILL)

        tree = join_in_tree(files, folder, workers=workers, progress=tell)
        seconds = time.perf_counter() - began
        memory.stop()
    starts = [*stages.values(), seconds]
    component = tree.joined.components[0].map
    out: dict[str, object] = {
        "workers": kind,
        "count": count,
        "robots": team.robots,
        "poses_each": team.poses,
        "poses": team.robots * team.poses,
        "killed": len(killed),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds() - cpu,
        "stages": {name: starts[n + 1] - starts[n] for n, name in enumerate(stages)},
        "memory_mb": memory.together,
        "largest_mb": memory.largest,
        "components": len(tree.joined.components),
        "root_unknowns": component.dof,
        "chi2": component.chi2,
        "dof": component.rows - component.dof,
        "disk_mb": sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 2**20,
        "position_rmse_m": position_rmse(tree, team),
        "load": os.getloadavg()[0],
    }
    shutil.rmtree(folder)
    return out


def position_rmse(tree: TreeMap, team: Team) -> float:
    """Of all poses of the team [m], after one rigid fit of the whole map."""
    estimates, truths = [], []
    for robot in range(1, team.robots + 1):
        keys = pose_key(robot, np.arange(team.poses) * 1_000_000)
        estimates.append(tree.values(robot=robot).positions(keys, 2))
        truths.append(team.way(robot).translation)
    estimate, truth = np.concatenate(estimates), np.concatenate(truths)
    moved = align(estimate, truth).pose.act(estimate)
    return float(np.sqrt(np.mean(np.sum((moved - truth) ** 2, -1))))


# --- all of them ------------------------------------------------------------------------------------------------------


def run(work: Path, count: int) -> None:
    """Every size, each in a process of its own; those measured before are left."""
    work.mkdir(parents=True, exist_ok=True)
    plain = [("processes", robots, poses, False) for robots, poses in MORE_ROBOTS[:-1] + LONGER_LOGS]
    killed = [(*row, True) for row in KILLED]
    largest = [("processes", *MORE_ROBOTS[-1], False), *((*row, True) for row in LARGEST)]
    for kind, robots, poses, kill in [*plain, *killed, *largest]:
        file = work / f"{kind}_{robots}_{poses}{'_killed' if kill else ''}.json"
        if file.exists():
            continue
        command = [sys.executable, __file__, "one", "--work", str(work), "--workers", str(count), "--kind", kind]
        command += ["--robots", str(robots), "--poses", str(poses), *(["--kill"] if kill else [])]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        file.write_text(done.stdout.splitlines()[-1] + "\n")
        print(done.stdout.splitlines()[-1], flush=True)


def machine() -> str:
    """What it ran on."""
    names = [
        line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    packages = ", ".join(f"{name} {version(name)}" for name in ("teamslam", "numpy", "scipy", "distributed"))
    return f"{len(names)} x {names[0]}, {memory:.0f} GB, Python {platform.python_version()}, {packages}"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "one", "draw"))
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kind", choices=("processes", "dask"), default="processes")
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--poses", type=int, default=1_000)
    parser.add_argument("--kill", action="store_true")
    given = parser.parse_args()
    if given.what == "run":
        run(given.work, given.workers)
    elif given.what == "one":
        team = Team(given.robots, given.poses)
        print(json.dumps(measure(team, given.work, given.kind, given.workers, given.kill)))
    else:
        from growth_page import draw

        draw([json.loads(file.read_text()) for file in sorted(given.work.glob("*.json"))], machine(), DOCS)


if __name__ == "__main__":
    main()
