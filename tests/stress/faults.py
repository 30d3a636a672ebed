"""FAULTS: what goes wrong with logs, by name: a log and a generator in, another log out, its truth kept with it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, rotations
from teamslam.model import (
    MODELS,
    Dataset,
    Kind,
    Names,
    Table,
    Values,
    index_of,
    is_pose,
    landmark_key,
    pack,
    point_kind,
    pose_key,
    robot_of,
    whitening,
)
from teamslam.sim.noise import plus

Fault = Callable[[Dataset, np.random.Generator], Dataset]

ODD_NAMES = ["$x{$", "1.0", "[red]a", "a/b", "ü ö", "..", "robot 1", "-1", "None", "x" * 80, "a,b", 'say "hi"', "{0}"]
UTM = np.array([5.3e5, 5.4e6, 200.0])


def _of_sightings(table: Table) -> bool:
    return table.source in ("landmarks", "robots")


def _each(log: Dataset, change: Callable[[Table], Table], where: Callable[[Table], bool] = lambda t: True) -> Dataset:
    return replace(log, tables=tuple(change(t) if len(t) and where(t) else t for t in log.tables))


def _thinned(log: Dataset, keep: Callable[[Table], BoolArray], where: Callable[[Table], bool]) -> Dataset:
    tables = [t.select(keep(t)) if where(t) else t for t in log.tables]
    return replace(log, tables=tuple(t for t in tables if len(t)))


def _gaps(log: Dataset, rng: np.random.Generator) -> Dataset:
    """One to three rows of odometry are lost."""
    lost = int(rng.integers(1, 4))

    def keep(table: Table) -> BoolArray:
        mask = np.ones(len(table), bool)
        mask[rng.choice(len(table), min(lost, len(table)), replace=False)] = False
        return mask

    return _thinned(log, keep, lambda t: t.source == "odometry")


def _outliers(log: Dataset, rng: np.random.Generator, most: float) -> Dataset:
    """A share of the sightings, drawn up to `most`, reports something else altogether."""
    share = rng.uniform(0.0, most)

    def wrong(table: Table) -> Table:
        values, hit = table.values.copy(), np.flatnonzero(rng.random(len(table)) < share)
        values[hit] = _anything(table, len(hit), rng)
        return replace(table, values=values)

    return _each(log, wrong, _of_sightings)


def _anything(table: Table, count: int, rng: np.random.Generator) -> Array:
    """Measurements (count, size) of nothing."""
    dim = table.dim
    lengths = rng.uniform(0.5, 12.0, (count, 1))
    flat = rng.uniform(-np.pi, np.pi, (count, 1))
    solid = rng.standard_normal((count, 3))
    direction = flat if dim == 2 else solid / np.linalg.norm(solid, axis=-1, keepdims=True)
    if table.model == "range":
        return lengths
    if table.model == "bearing":
        return direction
    if table.model == "range_bearing":
        return np.concatenate([lengths, direction], -1)
    points = rng.uniform(-8.0, 8.0, (count, dim))
    if table.model == "point":
        return points
    return pack(Pose(rotations(dim).exp(rng.uniform(-1.7, 1.7, (count, rotations(dim).DOF))), points))


def _double_rows(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Some rows stand twice."""
    return _each(log, lambda t: t.select(np.sort(np.concatenate([np.arange(len(t)), rng.integers(0, len(t), 2)]))))


def _double_stamps(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Some steps of odometry are reported twice, by different numbers."""

    def twice(table: Table) -> Table:
        at = np.sort(np.concatenate([np.arange(len(table)), rng.integers(0, len(table), 2)]))
        again = np.append(False, at[1:] == at[:-1])
        return _turned(table.select(at), again, rng)

    return _each(log, twice, lambda t: t.source == "odometry")


def _turned(table: Table, which: BoolArray, rng: np.random.Generator) -> Table:
    """Relative poses of which some are moved by about their own sigma."""
    dim, rows = table.dim, len(table.whitening[0])
    z = table.values[which]
    pose = Pose(z[:, dim:].reshape(-1, dim, dim), z[:, :dim])
    whitening = np.broadcast_to(table.whitening, (len(table), rows, rows))[which]
    shift = (np.linalg.pinv(whitening) @ rng.standard_normal((len(z), rows, 1)))[..., 0]
    values = table.values.copy()
    values[which] = pack(pose.retract(shift))
    return replace(table, values=values)


def _backward(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Half of the odometry is told from the later pose to the earlier, each row by as many sigmas off as it was."""
    tables: list[Table] = []
    for table in log.tables:
        if table.source != "odometry" or not len(table):
            tables.append(table)
            continue
        back = rng.random(len(table)) < 0.5
        there, turned = table.select(back), replace(table, keys=table.keys[:, ::-1].copy()).select(back)
        if len(turned):
            values = plus(table.model, turned.predict(log.truth), there.residual(log.truth), table.dim)
            turned = replace(turned, values=values)
        tables += [t for t in (table.select(~back), turned) if len(t)]
    return replace(log, tables=tuple(tables))


def _one_sighting(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Of everything that was seen one row is left."""
    seen = [n for n, t in enumerate(log.tables) if _of_sightings(t)]
    if not seen:
        return log
    kept = int(rng.choice(seen))
    tables = []
    for number, table in enumerate(log.tables):
        if number == kept:
            tables.append(table.select(np.array([rng.integers(len(table))])))
        elif number not in seen:
            tables.append(table)
    return replace(log, tables=tuple(tables))


def _seen_once(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Each landmark is seen by the first row of its own that the log holds, and never again."""
    known: set[int] = set()

    def first(table: Table) -> BoolArray:
        mask = np.zeros(len(table), bool)
        for row, key in enumerate(table.keys[:, 1].tolist()):
            mask[row] = key not in known
            known.add(key)
        return mask

    return _thinned(log, first, lambda t: t.source == "landmarks")


def _on_a_line(log: Dataset, rng: np.random.Generator, model: str, ahead: float, beside: float) -> Dataset:
    """One more landmark, placed by where one robot began and headed, which this robot alone sees, from all its poses on
    its first heading's line."""
    assert log.truth is not None
    robot = int(rng.choice(sorted(log.robots)))
    poses = np.sort(log.truth.layout.keys[robot_of(log.truth.layout.keys) == robot])
    dim = log.robots[robot]
    way = log.truth.poses_of(poses, dim)
    local = way[0].unact(way.translation)
    ahead += float(np.abs(local[:, 0]).max())
    on_line = np.abs(local[:, 1:]).max(-1) < 1e-9
    points = log.truth.layout.kinds[log.truth.layout.kinds >= 2]
    of_points = int(points[0]) if len(points) else max(log.robots.values())
    place = np.zeros(of_points)
    place[:dim] = way[0].act(np.array([ahead, beside, 0.0][:dim]))[:of_points]
    if dim == 3 and of_points == 2:
        return log
    mark = landmark_key(np.array([900]))
    truth = log.truth.update(Values.of({point_kind(of_points): (mark, place[None])}))
    keys = np.stack([poses[on_line], np.repeat(mark, on_line.sum())], -1)
    rows = MODELS[model].residual_rows(of_points)
    blank = np.zeros((len(keys), MODELS[model].z_size(of_points)))
    table = Table(robot, "landmarks", model, of_points, keys, blank, 50.0 * np.eye(rows)[None], np.arange(len(keys)))
    z = table.predict(truth)
    if model == "range":
        z = np.abs(z + 0.02 * rng.standard_normal(z.shape))
    return replace(log, truth=truth, tables=(*log.tables, replace(table, values=z)))


def _odd_names(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Robots and landmarks are called strange things."""
    numbers = index_of(log.landmark_keys).tolist()
    names = rng.permutation(ODD_NAMES).tolist()
    robots = dict(zip(sorted(log.robots), names, strict=False))
    landmarks = dict(zip(numbers, names[::-1], strict=False))
    return replace(log, names=Names(robots, landmarks, log.names.tick_s))


def _utm(log: Dataset, rng: np.random.Generator) -> Dataset:
    """The world's origin lies thousands of kilometres away."""
    assert log.truth is not None
    dims = {Kind(int(k)).dim for k in log.truth.layout.kinds}
    far = Pose(rotations(2).exp(rng.uniform(-3.0, 3.0, 1)), UTM[:2])
    moved = far if 2 in dims else Pose(far.lift(3).rotation, UTM)

    def move(table: Table) -> Table:
        d = table.dim
        if table.model == "position":
            return replace(table, values=moved.lift(max(d, moved.dim)).act(_lifted(table.values, moved.dim))[:, :d])
        pose = Pose(table.values[:, d:].reshape(-1, d, d), table.values[:, :d])
        return replace(table, values=pack(moved.lift(d) @ pose))

    log = _each(log, move, lambda t: t.row.unary)
    return replace(log, truth=log.truth.transform(moved))


def _lifted(points: Array, dim: int) -> Array:
    missing = max(dim - points.shape[-1], 0)
    return np.concatenate([points, np.zeros((*points.shape[:-1], missing))], -1)


def _wrong_sigmas(log: Dataset, rng: np.random.Generator) -> Dataset:
    """The noise is stated ten times too small or too large."""
    return _each(log, lambda t: replace(t, whitening=t.whitening * rng.choice([0.1, 10.0])))


def _stiff(log: Dataset, rng: np.random.Generator) -> Dataset:
    """One table's noise is stated to be a microradian or a micron, that of another a hundred times what it is."""
    if not log.tables:
        return log
    stiff, weak = rng.choice(len(log.tables), 2)
    factors = {int(weak): 1e-2, int(stiff): 1e6 / max(float(np.abs(log.tables[stiff].whitening).max()), 1.0)}
    tables = (replace(t, whitening=t.whitening * factors.get(n, 1.0)) for n, t in enumerate(log.tables))
    return replace(log, tables=tuple(tables))


def _shuffled(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Rows stand in any order."""
    return _each(log, lambda t: t.select(rng.permutation(len(t))))


def _silent(log: Dataset, rng: np.random.Generator) -> Dataset:
    """One robot measured nothing itself."""
    quiet = int(rng.choice(sorted(log.robots)))
    kept = tuple(t for t in log.tables if t.robot != quiet)
    return replace(log, tables=kept) if kept else log


def _big_stamps(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Poses are named by microseconds since 1970, some of them one microsecond apart."""
    assert log.truth is not None
    steps = np.cumsum(rng.choice([1, 37, 100_000, 5_000_000], 400))

    def name(keys: IntArray) -> IntArray:
        fresh = pose_key(np.maximum(robot_of(keys), 1), 1_700_000_000_000_000 + steps[index_of(keys) % 400])
        return np.where(is_pose(keys), fresh, keys)

    truth = Values.of({kind: (name(keys), data) for kind, keys, data in log.truth.parts()})
    names = replace(log.names, tick_s=1e-6)
    return replace(_each(log, lambda t: replace(t, keys=name(t.keys))), truth=truth, names=names)


def _sparse(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Of what was seen a tenth is left."""
    return _thinned(log, lambda t: rng.random(len(t)) < 0.1, _of_sightings)


def _empty(log: Dataset, rng: np.random.Generator) -> Dataset:
    """A table without rows stands in the log."""
    if not log.tables:
        return log
    table = log.tables[int(rng.integers(len(log.tables)))]
    return replace(log, tables=(*log.tables, table.select(np.zeros(0, np.int64))))


def _flipped(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Bearings have the wrong sign."""

    def flip(table: Table) -> Table:
        signs = np.ones(table.values.shape[1])
        signs[-1] = -1.0
        return replace(table, values=table.values * signs)

    return _each(log, flip, lambda t: t.model in ("bearing", "range_bearing"))


def _one_place(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Somebody claims that two landmarks, or a landmark and a robot, are in one place: points of length zero."""

    def at_zero(table: Table) -> Table:
        values = table.values.copy()
        values[rng.integers(len(table))] = 0.0
        return replace(table, values=values)

    return _each(log, at_zero, lambda t: t.model == "point")


def _covariances(table: Table) -> Array:
    return np.linalg.pinv(table.whitening.mT @ table.whitening)


def _flat_sensor(log: Dataset, rng: np.random.Generator) -> Dataset:
    """Points in space are seen in the plane of the robot, by one sense and perhaps not by another."""

    def flat(table: Table) -> Table:
        flat = table.values[:, :2], whitening(_covariances(table)[:, :2, :2])
        return replace(table, dim=2, values=flat[0], whitening=flat[1])

    return _each(
        log, flat, lambda t: t.model == "point" and t.dim == 3 and t.sensor is None and log.robots[t.robot] == 2
    )


def _zero_direction(log: Dataset, rng: np.random.Generator) -> Dataset:
    """One table says nothing of one direction."""
    number = int(rng.integers(len(log.tables))) if log.tables else 0

    def blind(table: Table) -> Table:
        rows = np.ones(table.whitening.shape[1])
        if len(rows) > 1:
            rows[rng.integers(len(rows))] = 0.0
        return replace(table, whitening=rows[:, None] * table.whitening)

    return replace(log, tables=tuple(blind(t) if n == number else t for n, t in enumerate(log.tables)))


def _weak_row(log: Dataset, rng: np.random.Generator) -> Dataset:
    """All that was seen is known to a metre and a radian only."""
    return _each(log, lambda t: replace(t, whitening=np.eye(t.whitening.shape[1])[None]), _of_sightings)


FAULTS: dict[str, Fault] = {
    "gaps": _gaps,
    "few outliers": lambda log, rng: _outliers(log, rng, 0.1),
    "many outliers": lambda log, rng: _outliers(log, rng, 0.4),
    "double rows": _double_rows,
    "double stamps": _double_stamps,
    "backward": _backward,
    "one sighting": _one_sighting,
    "seen once": _seen_once,
    "dead ahead": lambda log, rng: _on_a_line(log, rng, "bearing", ahead=5.0, beside=0.0),
    "beside": lambda log, rng: _on_a_line(log, rng, "range", ahead=-2.0, beside=2.0),
    "odd names": _odd_names,
    "utm": _utm,
    "wrong sigmas": _wrong_sigmas,
    "stiff": _stiff,
    "shuffled": _shuffled,
    "silent robot": _silent,
    "big stamps": _big_stamps,
    "sparse": _sparse,
    "empty table": _empty,
    "flipped": _flipped,
    "one place": _one_place,
    "flat sensor": _flat_sensor,
    "weak sightings": _weak_row,
    "zero direction": _zero_direction,
}
