"""The log of a scenario: where everything truly is, and what is measured of it, noise and faults included.

Noise is in each sensor's own coordinates: at the truth, W (z (-) h) is exactly the normal numbers that were drawn.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from stress.faults import FAULTS
from stress.scenario import Robot, Scenario, Sense
from stress.ways import WAYS
from teamslam.geometry import Array, IntArray, Pose, concatenate, rotations
from teamslam.model import MODELS, Dataset, Kind, Names, Table, Values, landmark_key, point_kind, pose_key, pose_kind
from teamslam.sim.noise import plus, sigmas

APART = 1e-3  # [m]: nothing is seen from where it stands


def log_of(scenario: Scenario) -> Dataset:
    """The scenario's log. A pure function of it."""
    rng = np.random.default_rng((scenario.seed, 0))
    truth = _truth(scenario, rng)
    tables = [t for robot in range(1, len(scenario.robots) + 1) for t in _measured(scenario, robot, truth, rng)]
    robots = {number: robot.dim for number, robot in enumerate(scenario.robots, start=1)}
    log = Dataset(robots, tuple(tables), Names(tick_s=1.0), truth, origin=f"seed {scenario.seed}")
    for fault in scenario.faults:
        log = FAULTS[fault](log, rng)
    return replace(log, tables=numbered(log.tables))


def numbered(tables: Iterable[Table]) -> tuple[Table, ...]:
    """The tables with their rows numbered as a robot's log of each source has them."""
    at: dict[tuple[int, str], int] = {}
    out = []
    for table in tables:
        first = at.get((table.robot, table.source), 0)
        out.append(replace(table, ids=np.arange(first, first + len(table))))
        at[table.robot, table.source] = first + len(table)
    return tuple(out)


def chosen(log: Dataset, rows: dict[tuple[int, str], set[int]]) -> Dataset:
    """The log with some of its rows only, by robot, source and number; robots without a row and without a pose that
    somebody speaks of are no longer there."""
    tables = []
    for table in log.tables:
        keep = np.isin(table.ids, sorted(rows.get((table.robot, table.source), ())))
        tables += [table.select(keep)] if keep.any() else []
    spoken = {int(r) for t in tables for r in np.unique(t.keys >> 51)} | {t.robot for t in tables}
    return replace(log, tables=tuple(tables), robots={r: dim for r, dim in log.robots.items() if r in spoken})


# --- the truth --------------------------------------------------------------------------------------------------------


def _truth(scenario: Scenario, rng: np.random.Generator) -> Values:
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for dim in (2, 3):
        own = [(n, r) for n, r in enumerate(scenario.robots, start=1) if r.dim == dim]
        if own:
            keys = np.concatenate([pose_key(n, np.arange(r.poses)) for n, r in own])
            parts[pose_kind(dim)] = (keys, concatenate([_way(r, rng) for _, r in own]))
    marks, count = landmark_key(np.arange(scenario.landmarks)), scenario.landmarks
    of_points = 2 if scenario.space == "2d" else 3
    if count and any(s.of == "landmarks" and s.model == "relative_pose" for s in scenario.senses):
        turns = rng.uniform(-2.0, 2.0, (count, rotations(of_points).DOF))
        tags = np.concatenate([rng.uniform(-6.0, 6.0, (count, of_points)), turns], -1)
        old = parts.get(pose_kind(of_points))
        poses = Pose.from_tangent(tags, of_points)
        if old is not None:
            assert isinstance(old[1], Pose)
            marks, poses = np.concatenate([old[0], marks]), concatenate([old[1], poses])
        parts[pose_kind(of_points)] = (marks, poses)
    elif count:
        parts[point_kind(of_points)] = (marks, rng.uniform(-6.0, 6.0, (count, of_points)))
    return Values.of(parts)


def _way(robot: Robot, rng: np.random.Generator) -> Pose:
    dof = 3 if robot.dim == 2 else 6
    place = rng.uniform(-3.0, 3.0, robot.dim) * (rng.random() < 0.9)  # some begin in one and the same place
    turn = rng.uniform(-1.8, 1.8, dof - robot.dim)
    if rng.random() < 0.2:  # and some along the axes: face to face, back to back, upside down
        turn = np.zeros_like(turn)
        turn[rng.integers(len(turn))] = 0.5 * np.pi * rng.integers(-1, 3)
    poses = [Pose.from_tangent(np.concatenate([place, turn])[None], robot.dim)]
    for step in Pose.from_tangent(WAYS[robot.way](rng, robot.poses - 1, dof), robot.dim):
        poses.append(poses[-1] @ Pose(step.rotation[None], step.translation[None]))
    return concatenate(poses)


# --- what is measured -------------------------------------------------------------------------------------------------


def _measured(scenario: Scenario, robot: int, truth: Values, rng: np.random.Generator) -> Iterator[Table]:
    for sense in scenario.senses:
        for dim, pairs in _pairs(scenario, sense, robot, rng):
            if len(pairs):
                yield measure(robot, sense, dim, pairs, truth, rng)


def _pairs(scenario: Scenario, sense: Sense, robot: int, rng: np.random.Generator) -> Iterator[tuple[int, IntArray]]:
    """Who sees what by a sense of a robot: the dimension of the measurements, and observers with their targets."""
    me = scenario.robots[robot - 1]
    own = pose_key(robot, np.arange(me.poses))
    of_points = 2 if scenario.space == "2d" else 3
    marks = landmark_key(np.arange(scenario.landmarks))
    if sense.of == "odometry":
        yield me.dim, np.stack([own[:-1], own[1:]], -1)
    elif sense.of == "loops":
        pairs = np.sort(rng.choice(own, (max(1, me.poses // 4), 2)), axis=1)
        yield me.dim, pairs[pairs[:, 1] > pairs[:, 0] + 1]
    elif sense.of == "landmarks":
        yield of_points, _some(rng, _all_pairs(own, marks), sense.sees)
    elif sense.of == "world":
        yield me.dim, _some(rng, own[:, None], sense.sees)
    elif sense.of == "marks" and robot == 1:
        yield of_points, _some(rng, marks[:, None], sense.sees)
    elif sense.of == "robots":
        for other in _met(scenario, robot):
            other_dim, theirs = scenario.robots[other - 1].dim, scenario.robots[other - 1].poses
            t = np.arange(min(me.poses, theirs))
            pairs = _some(rng, np.stack([pose_key(robot, t), pose_key(other, t)], -1), sense.sees)
            yield max(me.dim, other_dim), pairs[:1] if scenario.meet == "one" else pairs


def _met(scenario: Scenario, robot: int) -> list[int]:
    """The robots that one may see."""
    count = len(scenario.robots)
    if scenario.meet == "one":
        return [2] if robot == 1 else []
    if scenario.meet in ("all", "ranges"):
        return [other for other in range(1, count + 1) if other != robot]
    return [robot + 1] if robot < count else []


def _all_pairs(own: IntArray, marks: IntArray) -> IntArray:
    return np.stack([np.repeat(own, len(marks)), np.tile(marks, len(own))], -1)


def _some(rng: np.random.Generator, pairs: IntArray, share: float) -> IntArray:
    """A share of some rows, and at least one of them."""
    keep = rng.random(len(pairs)) < share
    if len(pairs) and not keep.any():
        keep[rng.integers(len(pairs))] = True
    return pairs[keep]


def measure(robot: int, sense: Sense, dim: int, keys: IntArray, truth: Values, rng: np.random.Generator) -> Table:
    """A table of what a robot's sense reports of the truth. Rows are left out where a target stands in the sensor."""
    model = MODELS[sense.model]
    sensor = _mount(rng, dim) if sense.mounted else None
    keys = keys[_apart(sense, keys, truth, sensor, dim)]
    rows = model.residual_rows(dim)
    root = _roots(sense, dim, len(keys), rng)  # covariance = root root'
    blank, ids = np.zeros((len(keys), model.z_size(dim))), np.arange(len(keys))
    table = Table(robot, sense.of, sense.model, dim, keys, blank, np.linalg.inv(root), ids, sensor, sense.loss)
    noise = (root @ rng.standard_normal((len(keys), rows, 1)))[..., 0]
    return replace(table, values=plus(sense.model, table.predict(truth), noise, dim))


def _mount(rng: np.random.Generator, dim: int) -> Pose:
    turn = rng.uniform(-1.0, 1.0, rotations(dim).DOF)
    return Pose.from_tangent(np.concatenate([rng.uniform(-0.3, 0.3, dim), turn]), dim)


def _apart(sense: Sense, keys: IntArray, truth: Values, sensor: Pose | None, dim: int) -> Array:
    if not len(keys) or MODELS[sense.model].unary or MODELS[sense.model].targets_pose:
        return np.ones(len(keys), bool)
    space = 3 if (truth.layout.kinds % 2).any() else dim
    eyes = truth.poses_of(keys[:, 0], space)
    eyes = eyes if sensor is None else eyes @ sensor.lift(space)
    return np.linalg.norm(truth.positions(keys[:, 1], space) - eyes.translation, axis=-1) > APART


def _roots(sense: Sense, dim: int, count: int, rng: np.random.Generator) -> Array:
    """Square roots (count or 1, rows, rows) of the noise's covariances."""
    sigma = sigmas(sense.model, dim, sense.sigma_m, sense.sigma_rad)
    root = np.diag(sigma)[None]
    if sense.correlated:
        mix = np.eye(len(sigma)) + 0.5 * rng.standard_normal((len(sigma), len(sigma)))
        root = root @ (mix / np.linalg.norm(mix, axis=1, keepdims=True))
    if sense.uneven and count:
        root = root * np.exp(rng.uniform(-0.7, 0.7, (count, 1, 1)))
    return root
