"""teamslam through its public Python interface: arrays in, estimate out."""

from dataclasses import dataclass

import numpy as np

import teamslam
from problems import SIGMA_P, SIGMA_R, SIGMA_T, Estimate, Problem
from teamslam import kernel
from teamslam.geometry import Pose
from teamslam.model import Kind, Table, Values, landmark_key, pose_key
from teamslam.solver import Covariances, Options, Solution, System, optimise

OPTIONS = Options(cost_share=1e-8)


@dataclass
class Model:
    """The problem as teamslam sees it."""

    system: System
    start: Values
    poses: np.ndarray
    marks: np.ndarray
    solution: Solution | None = None


def version() -> str:
    return teamslam.__version__


def warm(problem: Problem) -> None:
    """Nothing to prepare."""


def build(problem: Problem, variant: str) -> Model:
    kernel.set_threads(1 if variant == "1thread" else 2)
    d = problem.dim
    first = np.flatnonzero(np.diff(problem.robots, prepend=-1))
    poses = pose_key(problem.robots + 1, np.arange(len(problem.robots)) - first[problem.robots])
    marks = landmark_key(np.arange(len(problem.start_P)))
    a = problem.odometry_from
    steps = np.concatenate([problem.odometry_T, problem.odometry_R.reshape(-1, d * d)], 1)
    weights = [1.0 / SIGMA_T] * d + [1.0 / SIGMA_R] * (1 if d == 2 else 3)
    links = np.stack([poses[a], poses[a + 1]], -1)
    sights = np.stack([poses[problem.seen_from], marks[problem.seen]], -1)
    tables = [
        Table(1, "odometry", "relative_pose", d, links, steps, np.diag(weights)[None], np.arange(len(a))),
        Table(1, "landmarks", "point", d, sights, problem.sightings, np.eye(d)[None] / SIGMA_P, np.arange(len(sights))),
    ]
    start = Values.of({
        Kind(d - 2): (poses, Pose(problem.start_R, problem.start_T)),
        Kind(d): (marks, problem.start_P),
    })  # fmt: skip
    return Model(System(start.layout, tables=tables, fixed=poses[:1]), start, poses, marks)


def solve(model: Model) -> tuple[Model, int]:
    model.solution = optimise(model.system, model.start, OPTIONS)
    return model, model.solution.iterations


def read(model: Model) -> Estimate:
    values = model.solution.values
    dim = values.layout.kinds[0] + 2
    poses = values.of_kind(Kind(dim - 2))
    return Estimate(poses.translation, poses.rotation, values.of_kind(Kind(dim)))


def marginals(model: Model) -> float:
    """Linearises and factorises again, as the others do."""
    system, values = model.system, model.solution.values
    hessian = system.linearise(values).hessian
    blocks = Covariances(system.free, hessian).blocks(model.marks)
    return float(np.trace(np.stack(blocks), axis1=1, axis2=2).sum())
