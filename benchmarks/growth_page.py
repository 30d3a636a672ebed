"""The figures that growth.py measured, as a table and a picture for the documentation."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

Row = dict[str, Any]
SERIES = {"more robots of 10,000 poses": "o-", "100 robots, longer logs": "s--"}

PAGE = """# How joining grows

Joining by a tree (`teamslam.scale.join_in_tree`; `--workers`, `--cluster` on the command line), measured from log files
on disk to the estimate of every pose and landmark on disk. A made-up team, each robot mowing its own cell of one field
(`benchmarks/growing_team.py`): odometry with 0.02 m and 0.002 rad a step, about eight landmarks in view of each pose
with 0.1 m, neighbours share the landmarks along their common edge and see each other where they meet.

![Time and memory against poses](../images/growth.png)

{table}

{slopes}

- *memory* is the resident memory of all processes together, *largest* that of the largest one; pages that processes
  share count in each. It hardly follows the number of poses: what a worker holds is one robot's log, or what a group
  shares with others. The root of the largest team has {root} unknowns.
- *chi2 / dof* should be 1 within {spread:.4f} (one standard deviation at the largest team). *position RMSE* is over all
  poses, after one rigid fit of the whole map to the truth.
- *killed*: one worker killed (SIGKILL) when half of the submaps were built.
  {same}
- *processor time* is that of all processes. *load* is the load average of the machine at the end of the run: other
  work ran beside, on the same processors, so that time varies with it and processor time tells the growth better.

{machine}.
Command:

    python benchmarks/growth.py run --work /tmp/growth --workers 2
    python benchmarks/growth.py draw --work /tmp/growth
"""


def draw(rows: list[Row], machine: str, docs: Path) -> None:
    """Write docs/benchmarks/growth.md and docs/images/growth.png."""
    rows = sorted(rows, key=lambda r: (r["poses"], r["robots"], r["workers"], r["killed"]))
    whole = [r for r in rows if r["workers"] == "processes" and not r["killed"]]
    series = {
        "more robots of 10,000 poses": [r for r in whole if r["poses_each"] == 10_000 or r["robots"] == 1],
        "100 robots, longer logs": [r for r in whole if r["robots"] == 100],
    }
    figure(series, rows).savefig(docs / "images" / "growth.png", dpi=110)
    largest = max(whole, key=lambda r: r["poses"])
    page = PAGE.format(
        table=table(rows),
        slopes="\n".join(slope_line(name, part) for name, part in series.items()),
        root=f"{largest['root_unknowns']:,}",
        spread=np.sqrt(2.0 / largest["dof"]),
        machine=machine,
        same=same(rows),
    )
    (docs / "benchmarks" / "growth.md").write_text(page, encoding="utf-8")


def same(rows: list[Row]) -> str:
    """Whether runs of one team, with and without a worker killed, came to one result: chi2 and RMSE, to the bit."""
    results: dict[tuple[int, int], set[tuple[float, float]]] = {}
    for r in rows:
        results.setdefault((r["robots"], r["poses_each"]), set()).add((r["chi2"], r["position_rmse_m"]))
    teams = {(r["robots"], r["poses_each"]) for r in rows if r["killed"]}
    if all(len(results[team]) == 1 for team in teams):
        return "chi2 and RMSE of these runs and of those without are equal to the last bit."
    return "chi2 and RMSE of these runs differ from those without."


def slope(rows: list[Row], what: str) -> float:
    """Of the straight line through the logarithms of a time and of the poses."""
    return float(np.polyfit(np.log([r["poses"] for r in rows]), np.log([r[what] for r in rows]), 1)[0])


def slope_line(name: str, rows: list[Row]) -> str:
    """The slopes of a series in words: over all of it, and where starting the workers no longer counts."""
    long = [r for r in rows if r["poses"] >= 30_000]
    return (
        f"- {name}, {rows[0]['poses']:,} to {rows[-1]['poses']:,} poses: time grows with their power "
        f"{slope(rows, 'seconds'):.2f},\n  processor time with {slope(rows, 'cpu_seconds'):.2f}; "
        f"from {long[0]['poses']:,} on with {slope(long, 'seconds'):.2f} and {slope(long, 'cpu_seconds'):.2f}."
    )


def table(rows: list[Row]) -> str:
    """All runs, as Markdown."""
    head = ["poses", "robots", "workers", "killed", "time [s]", "processor time [s]", "memory [MB]", "largest [MB]"]
    head += ["chi2 / dof", "position RMSE [m]", "load"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---:|" * len(head)]
    for r in rows:
        cells = [
            f"{r['poses']:,}",
            f"{r['robots']}",
            f"{r['count']} {r['workers']}",
            f"{r['killed'] or ''}",
            f"{r['seconds']:.1f}",
            f"{r['cpu_seconds']:.1f}" if "cpu_seconds" in r else "",
            f"{r['memory_mb']:.0f}",
            f"{r['largest_mb']:.0f}",
            f"{r['chi2'] / r['dof']:.4f}",
            f"{r['position_rmse_m']:.3f}",
            f"{r['load']:.1f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def figure(series: dict[str, list[Row]], rows: list[Row]) -> plt.Figure:
    """Time and memory against poses."""
    out, (times, memories) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    for name, part in series.items():
        poses = [r["poses"] for r in part]
        (line,) = times.plot(poses, [r["seconds"] for r in part], SERIES[name], label=name)
        cpu = [r["cpu_seconds"] for r in part]
        times.plot(poses, cpu, ".:", color=line.get_color(), linewidth=1.0, label=f"{name}: processor time")
        memories.plot(poses, [r["memory_mb"] for r in part], SERIES[name], label=name)
    killed = [r for r in rows if r["killed"]]
    for kind, marker in (("processes", "x"), ("dask", "+")):
        part = [r for r in killed if r["workers"] == kind]
        times.plot([r["poses"] for r in part], [r["seconds"] for r in part], f"k{marker}", label=f"{kind}, one killed")
        memories.plot([r["poses"] for r in part], [r["memory_mb"] for r in part], f"k{marker}")
    ends = np.array([3e4, 1e6])
    last = max((r for part in series.values() for r in part), key=lambda r: r["poses"])["seconds"]
    times.plot(ends, last * ends / 1e6, ":", color="grey", label="slope 1")
    for axes, label in ((times, "time [s]"), (memories, "memory of all processes [MB]")):
        axes.set(xscale="log", yscale="log", xlabel="poses", ylabel=label)
        axes.grid(True, which="both", alpha=0.25)
    memories.set_ylim(50, 20_000)
    memories.legend(*times.get_legend_handles_labels(), fontsize="small", loc="upper left")
    return out
