"""Wrong sightings found and left out, beside GTSAM's graduated non-convexity, on simulated teams.

    python benchmarks/outliers.py [--teams 20] [--beside 6] [--seconds 90] [--first-seed 0]
                                  [--out docs/benchmarks/outliers.md]

Teams of 4 robots, 60 poses each, 30 landmarks, seen as points, robots seen as relative poses (the defaults of
`teamslam simulate`). Wrong sightings are of two kinds: scattered, anywhere within view; and aliased, of another
landmark or robot, the same one each time. Ours: `teamslam.trust.wrong_sightings(log)`, which sees the measurements
alone, then the join of what it keeps. GTSAM's: GncLMOptimizer with truncated least squares and its own rule for the
gate (0.99 of chi-square), odometry as known inliers, from a start that ours is not given: each robot's odometry laid on
its true first pose, landmarks where they truly are. Its wheel has no factor for a point seen from a pose, so sightings
enter as bearing and range with the same noise to first order, and no map of robots in the plane among landmarks in
space ('planar'). The oracle is the join of the right sightings alone. Errors are of robots' positions after one
alignment of all poses; of each its ratio to the oracle's. GTSAM is given the first teams of each cell alone, as many
as --beside says, and no further one once it has taken so many seconds there: each row says how many `teams` it is of.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gtsam
import numpy as np

import teamslam
from teamslam.geometry import BoolArray, align
from teamslam.joining import build, join, split
from teamslam.joining.exact.gap import point_of
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.model import Dataset, Kind, Values, is_pose, unpack
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import aliased
from teamslam.trust import wrong_sightings

SPACES = ("2d", "planar", "3d")
RATES = ((0.0, 0.0), (0.1, 0.1), (0.3, 0.2), (0.6, 0.4))
Planted = tuple[Dataset, list[BoolArray]]


@dataclass(frozen=True)
class Outcome:
    """Of one team by one method: rows rejected rightly, rejected wrongly, missed; the error's ratio to the oracle's;
    seconds."""

    hits: int
    false: int
    missed: int
    ratio: float
    seconds: float


def scattered(space: str, share: float, of_robots: float, seed: int) -> Planted:
    """False alarms anywhere within view."""

    def log(landmarks: float, robots: float) -> Dataset:
        kind = Robot(landmarks=Sensor(outliers=landmarks), robots=Sensor("relative_pose", every=5, outliers=robots))
        return simulate(Options(space=space, robots=4, team=(kind,)), seed)

    clean, wrong = log(0.0, 0.0), log(share, of_robots)
    return wrong, [(a.values != b.values).any(1) for a, b in zip(clean.tables, wrong.tables, strict=True)]


def alike(space: str, share: float, of_robots: float, seed: int) -> Planted:
    """Landmarks and robots taken for others."""
    return aliased(simulate(Options(space=space, robots=4), seed), share, of_robots, seed)


def ours(log: Dataset) -> tuple[list[BoolArray], Values]:
    """The rows that are kept, and the map of them."""
    found = wrong_sightings(log)
    return list(found.inliers), joined(found.kept(log))


def joined(log: Dataset) -> Values:
    """The largest map of a log."""
    maps = [c.map for c in join([build(piece) for piece in split(log)]).components]
    return point_of(max(maps, key=lambda m: m.dof))


def theirs(log: Dataset) -> tuple[list[BoolArray], Values]:
    """The rows that GTSAM keeps, and its estimate."""
    flat = log.dim == 2
    names = {key: place for place, key in enumerate(log.layout.keys.tolist())}
    graph, trusted = gtsam.NonlinearFactorGraph(), []
    between = gtsam.BetweenFactorPose2 if flat else gtsam.BetweenFactorPose3
    for table in log.tables:
        for keys, z, sigma in zip(table.keys.tolist(), table.values, sigmas(log, table.whitening, table), strict=True):
            one, other = (names[key] for key in keys)
            if table.source == "odometry":
                trusted.append(graph.size())
            noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
            if table.model == "relative_pose":
                graph.push_back(between(one, other, pose(z, flat), noise))
            elif flat:
                bearing, distance = gtsam.Rot2(float(np.arctan2(z[1], z[0]))), float(np.linalg.norm(z))
                graph.push_back(gtsam.BearingRangeFactor2D(one, other, bearing, distance, noise))
            else:
                distance = float(np.linalg.norm(z))
                graph.push_back(gtsam.BearingRangeFactor3D(one, other, gtsam.Unit3(z), distance, noise))
    values = start(log, names, flat)
    first = names[int(log.pose_keys[min(log.robots)][0])]
    trusted.append(graph.size())
    tight = gtsam.noiseModel.Isotropic.Sigma(3 if flat else 6, 1e-6)
    prior = gtsam.PriorFactorPose2 if flat else gtsam.PriorFactorPose3
    graph.push_back(prior(first, values.atPose2(first) if flat else values.atPose3(first), tight))
    params = gtsam.GncLMParams()
    params.setLossType(gtsam.GncLossType.TLS)
    params.setKnownInliers(trusted)
    optimiser = gtsam.GncLMOptimizer(graph, values, params)
    estimate = optimiser.optimize()
    weights, at, kept = optimiser.getWeights(), 0, []
    for table in log.tables:
        kept.append(np.asarray(weights[at : at + len(table)] > 0.5))
        at += len(table)
    return kept, read(log, estimate, names, flat)


def sigmas(log: Dataset, whitening: np.ndarray, table: teamslam.Table) -> np.ndarray:
    """Standard deviations in GTSAM's order: of a pose in space rotations first, of a point bearing, then range."""
    each = np.broadcast_to(1.0 / np.diagonal(whitening, axis1=1, axis2=2), (len(table), whitening.shape[-1]))
    if table.model == "relative_pose":
        return each if table.dim == 2 else np.concatenate([each[:, 3:], each[:, :3]], 1)
    ranges = np.linalg.norm(table.values, axis=1, keepdims=True)
    return np.concatenate([each[:, 1:] / ranges, each[:, :1]], 1)


def pose(z: np.ndarray, flat: bool) -> object:
    """A pose of ours as one of GTSAM's."""
    if flat:
        return gtsam.Pose2(z[0], z[1], float(np.arctan2(z[4], z[2])))
    return gtsam.Pose3(gtsam.Rot3(z[3:].reshape(3, 3)), z[:3])


def start(log: Dataset, names: dict[int, int], flat: bool) -> object:
    """Each robot's odometry from its true first pose, landmarks where they truly are."""
    assert log.truth is not None
    values = gtsam.Values()
    for robot in log.robots:
        way = dead_reckoning(log.of_robot(robot), robot)
        way = way.transform(log.truth.pose(int(way.layout.keys[0])))
        for key, row in zip(way.layout.keys.tolist(), way.table(Kind(0 if flat else 1)), strict=True):
            if key in names:
                values.insert(names[key], pose(row, flat))
    for key in log.landmark_keys.tolist():
        values.insert(names[key], log.truth.positions(np.array([key]), 2 if flat else 3)[0])
    return values


def read(log: Dataset, estimate: object, names: dict[int, int], flat: bool) -> Values:
    """GTSAM's poses as ours."""
    keys = log.layout.keys[is_pose(log.layout.keys)]
    rows = []
    for key in keys.tolist():
        found = estimate.atPose2(names[key]) if flat else estimate.atPose3(names[key])  # type: ignore[attr-defined]
        turn = found.rotation().matrix()
        place = [found.x(), found.y()] if flat else list(found.translation())
        rows.append(np.concatenate([place, turn.ravel()]))
    return Values.of({Kind(0 if flat else 1): (keys, unpack(np.array(rows), Kind(0 if flat else 1)))})


def error(values: Values, truth: Values) -> float:
    """RMSE of robots' positions [m] after one alignment of all poses."""
    keys = values.layout.keys[is_pose(values.layout.keys)]
    keys = keys[truth.layout.contains(keys)]
    mine, true = (v.positions(keys, 3) for v in (values, truth))
    d = 2 if not mine[:, 2].any() and not true[:, 2].any() else 3
    fit = align(mine[:, :d], true[:, :d])
    return float(np.sqrt(np.mean(np.sum((fit.pose.act(mine[:, :d]) - true[:, :d]) ** 2, -1))))


def tried(planted: Planted, method: Callable[[Dataset], tuple[list[BoolArray], Values]], oracle: float) -> Outcome:
    """One method on one team."""
    log, wrong = planted
    assert log.truth is not None
    began = time.process_time()
    kept, values = method(log)
    seconds = time.process_time() - began
    counts = [
        ((~k & w).sum(), (~k & ~w).sum(), (k & w).sum())
        for k, w, t in zip(kept, wrong, log.tables, strict=True)
        if t.source != "odometry"
    ]
    hits, false, missed = (int(n) for n in np.sum(counts, 0))
    return Outcome(hits, false, missed, error(values, log.truth) / oracle, seconds)


def row(kind: str, space: str, rates: tuple[float, float], name: str, outcomes: Sequence[Outcome]) -> str:
    """A row of the table."""
    hits, false, missed = (sum(getattr(o, field) for o in outcomes) for field in ("hits", "false", "missed"))
    precision = f"{hits / (hits + false):.4f}" if hits + false else "-"
    recall = f"{hits / (hits + missed):.4f}" if hits + missed else "-"
    ratios = [o.ratio for o in outcomes]
    return (
        f"| {kind} | {space} | {rates[0]:.0%} | {rates[1]:.0%} | {name} | {len(outcomes)} | "
        f"{precision} | {recall} | {false} | "
        f"{np.median(ratios):.3f} | {np.quantile(ratios, 0.9):.2f} | {np.median([o.seconds for o in outcomes]):.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, default=20)
    parser.add_argument("--beside", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    lines = [
        "| kind | space | wrong, of landmarks | of robots | method | teams | precision | recall | "
        "right rows rejected | error's ratio, median | 9 of 10 below | seconds |",
        "|---" * 12 + "|",
    ]
    for kind, make in (("scattered", scattered), ("aliased", alike)):
        for space in SPACES:
            for rates in RATES[kind == "aliased" :]:
                found: dict[str, list[Outcome]] = {"teamslam": [], "GTSAM GNC": []}
                for seed in range(given.first_seed, given.first_seed + given.teams):
                    planted = make(space, *rates, seed)
                    log, wrong = planted
                    assert log.truth is not None
                    right = [t.select(~w) for t, w in zip(log.tables, wrong, strict=True)]
                    oracle = error(joined(log.with_tables(t for t in right if len(t))), log.truth)
                    found["teamslam"].append(tried(planted, ours, oracle))
                    beside = found["GTSAM GNC"]
                    spent = sum(outcome.seconds for outcome in beside)
                    if space != "planar" and len(beside) < given.beside and spent < given.seconds:
                        beside.append(tried(planted, theirs, oracle))
                for name, outcomes in found.items():
                    if outcomes:
                        lines.append(row(kind, space, rates, name, outcomes))
                        print(lines[-1], flush=True)
    if given.out:
        given.out.write_text(page(lines, given), encoding="utf-8")


def page(lines: Sequence[str], given: argparse.Namespace) -> str:
    """The page of the documentation."""
    assert __doc__ is not None
    how = f"python benchmarks/outliers.py --teams {given.teams} --beside {given.beside} --seconds {given.seconds:g} "
    how += f"--first-seed {given.first_seed}"
    made = f"teamslam {teamslam.__version__}, GTSAM {version('gtsam')}, NumPy {np.__version__}"
    method = __doc__.split("\n\n")[2]
    return (
        f"# Wrong sightings found, beside GTSAM's graduated non-convexity\n\nMeasured by `{how}` on one core; {made}, "
        f"Python {platform.python_version()}. Seconds are of processor time, other work beside them.\n\n{method}\n\n"
        + "\n".join(lines)
        + "\n"
    )


if __name__ == "__main__":
    main()
