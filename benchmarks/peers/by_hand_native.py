"""Ceres or g2o in C++, fed by a script: the problem is written for the program, which solves it by its own
Levenberg-Marquardt (Ceres: trust region, ordered by METIS), and what it writes is read back.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import native
import numpy as np

from by_hand import Log, Map, Stages


def solve(solver: str, log: Log, start: Map, stages: Stages) -> Map:
    """The team's optimum from a start."""
    program = native.compiled(solver)
    with tempfile.TemporaryDirectory() as work:
        problem, estimate = Path(work) / "problem.bin", Path(work) / "estimate.bin"
        stages("write for the program", lambda: flat(log, start).save(problem))
        command = [str(program), str(problem), str(estimate), "1", "0", "careful"]
        said = stages("run", lambda: subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        told = json.loads(said.splitlines()[-1])
        inside = [(stage, told[f"{stage}_ms"][0] / 1e3) for stage in ("build", "solve")]
        run = stages.rows.pop()["seconds"]
        stages.rows += [{"stage": stage, "seconds": seconds} for stage, seconds in inside]
        stages.rows.append({"stage": "read, write and start the program", "seconds": run - sum(s for _, s in inside)})
        return stages("read back", lambda: map_of(np.fromfile(estimate), start))


def flat(log: Log, start: Map) -> native.Flat:
    """The problem in arrays: poses robot after robot, landmarks by number."""
    ways, names = list(start.poses.values()), np.array(sorted(start.marks))
    offset = dict(zip(start.poses, np.cumsum([0, *map(len, ways)]).tolist(), strict=False))
    poses = np.concatenate(ways)

    def at(robots: np.ndarray, stamps: np.ndarray) -> np.ndarray:
        return np.array([offset[r] for r in robots.tolist()], np.int64) + np.round(stamps).astype(np.int64)

    ends, z, sigmas = [], [], []
    for r, table in log.tables["odometry"].items():
        robot = np.full(len(table), r)
        ends.append([at(robot, table["from_stamp"].to_numpy()), at(robot, table["to_stamp"].to_numpy())])
        z.append(table[["x", "y", "theta"]].to_numpy())
        sigmas.append(np.tile(np.sqrt(np.diag(log.noise["odometry"]))[1:], (len(table), 1)))
    for r, table in log.tables["robots"].items():
        seen_there = at(table["other"].to_numpy(), table["other_stamp"].to_numpy())
        ends.append([at(np.full(len(table), r), table["stamp"].to_numpy()), seen_there])
        z.append(table[["x", "y", "theta"]].to_numpy())
        sigmas.append(np.tile(np.sqrt(np.diag(log.noise["robots"]))[1:], (len(table), 1)))
    (step_from, step_to), steps, (sigma_T, sigma_R) = np.hstack(ends), np.concatenate(z), np.concatenate(sigmas).T
    seen = log.tables["landmarks"]
    return native.Flat(
        robots=len(ways),
        step_from=step_from,
        step_to=step_to,
        step_T=steps[:, :2],
        step_R=turns(steps[:, 2]),
        sigma_T=sigma_T,
        sigma_R=sigma_R,
        seen_from=np.concatenate([at(np.full(len(t), r), t["stamp"].to_numpy()) for r, t in seen.items()]),
        seen=np.searchsorted(names, np.concatenate([t["landmark"].to_numpy() for t in seen.values()])),
        sightings=np.concatenate([t[["x", "y"]].to_numpy() for t in seen.values()]),
        sigma_P=float(np.sqrt(log.noise["landmarks"][0, 0])),
        T=poses[:, :2],
        R=turns(poses[:, 2]),
        P=np.array([start.marks[name] for name in names.tolist()]),
    )


def turns(angles: np.ndarray) -> np.ndarray:
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def map_of(numbers: np.ndarray, start: Map) -> Map:
    lengths = [len(way) for way in start.poses.values()]
    n = sum(lengths)
    T, R, P = np.split(numbers, [2 * n, 6 * n])
    R = R.reshape(n, 2, 2)
    poses = np.column_stack([T.reshape(n, 2), np.arctan2(R[:, 1, 0], R[:, 0, 0])])
    ways = np.split(poses, np.cumsum(lengths)[:-1])
    return Map(dict(zip(start.poses, ways, strict=True)), dict(zip(sorted(start.marks), P.reshape(-1, 2), strict=True)))
