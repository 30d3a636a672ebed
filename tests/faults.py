"""Faults as people make them, planted into good logs: each turns a dataset into one with a known cause of misfit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.model import Dataset, Table, Values, is_pose, pack
from teamslam.model.sensors import pose_of
from teamslam.sim.noise import plus

Fault = Callable[[Table], Table]


def plant(dataset: Dataset, fault: Fault, *, source: str = "", robots: tuple[int, ...] = ()) -> Dataset:
    """The log with a fault in the tables of one source (all but odometry, where it is not said) and some robots."""
    return dataset.with_tables(
        fault(t) if (t.source == source or not source) and (not robots or t.robot in robots) else t
        for t in dataset.tables
    )


def _poses(table: Table, change: Callable[[Pose], Pose]) -> Table:
    return replace(table, values=pack(change(pose_of(table.values, table.dim))))


def _angles(table: Table, change: Callable[[Array], Array]) -> Array:
    """The values with their bearing (the azimuth in space) changed."""
    values = table.values.copy()
    if table.dim == 2:
        values[:, -1] = change(values[:, -1])
        return values
    x, y, z = values[:, -3:].T
    turned, flat = change(np.arctan2(y, x)), np.hypot(x, y)
    values[:, -3:] = np.stack([flat * np.cos(turned), flat * np.sin(turned), z], -1)
    return values


def turned(angles: Array, dim: int) -> Array:
    """Rotations about the vertical."""
    flat = Pose.from_xytheta(np.stack([0.0 * angles, 0.0 * angles, angles], -1))
    return flat.lift(dim).rotation


def negated_angle(table: Table) -> Table:
    """Bearings count clockwise; of points, left is right; of poses, turns about the vertical."""
    if table.model in ("bearing", "range_bearing"):
        return replace(table, values=_angles(table, np.negative))
    if table.model == "point":
        return replace(table, values=table.values * np.where(np.arange(table.dim) == 1, -1.0, 1.0))
    mirror = np.diag(np.where(np.arange(table.dim) == 1, -1.0, 1.0))
    return _poses(table, lambda p: Pose(mirror @ p.rotation @ mirror, p.translation))


def degrees(table: Table) -> Table:
    """Angles in degrees."""
    if table.model in ("bearing", "range_bearing"):
        return replace(table, values=_angles(table, np.rad2deg))

    def turn(p: Pose) -> Pose:
        yaw = np.arctan2(p.rotation[:, 1, 0], p.rotation[:, 0, 0])
        return Pose(p.rotation @ turned(np.rad2deg(yaw) - yaw, p.dim), p.translation)

    return _poses(table, turn)


def longer(factor: float) -> Fault:
    """Lengths in another unit."""

    def fault(table: Table) -> Table:
        lengths = {"range": 1, "range_bearing": 1, "bearing": 0}.get(table.model, table.dim)
        values = table.values.copy()
        values[:, :lengths] *= factor
        return replace(table, values=values)

    return fault


def axes(order: tuple[int, ...], signs: tuple[int, ...]) -> Fault:
    """Points and poses written in other axes: component k is sign * component order[k]."""

    def fault(table: Table) -> Table:
        values = table.values.copy()
        values[:, : table.dim] = table.values[:, list(order)] * np.array(signs)
        return replace(table, values=values)

    return fault


def inverted(table: Table) -> Table:
    """Each pose the other way round: the observer as seen from its target."""
    return _poses(table, lambda p: p.inverse())


def late(dataset: Dataset, steps: int) -> Fault:
    """A clock that is behind: what was seen at one pose is said of one some steps later."""

    def fault(table: Table) -> Table:
        chain = dataset.pose_keys[table.robot]
        place = np.searchsorted(chain, table.keys[:, 0]) + steps
        kept = (place >= 0) & (place < len(chain))
        keys = table.keys.copy()
        keys[kept, 0] = chain[place[kept]]
        return replace(table, keys=keys).select(kept)

    return fault


def surer(factor: float) -> Fault:
    """Standard deviations stated too small by a factor."""
    return lambda table: replace(table, whitening=table.whitening * factor)


def swapped(table: Table) -> Table:
    """x and y exchanged in positions; of poses, in their places."""
    order, signs = ((1, 0), (1, 1)) if table.dim == 2 else ((1, 0, 2), (1, 1, 1))
    return axes(order, signs)(table)


def mirrored(table: Table) -> Table:
    """All seen and done in a mirror: left is right."""
    if table.model != "relative_pose":
        return negated_angle(table)
    order = tuple(range(table.dim))
    return negated_angle(axes(order, tuple(-1 if k == 1 else 1 for k in order))(table))


def clock_ahead(dataset: Dataset, robot: int, ticks: int) -> Dataset:
    """One robot's stamps are so much larger than the moments were; sightings of poses that are not there are lost.

    All begins ten seconds later than it did, so that no stamp is below zero.
    """
    start = 10_000_000
    poses = {who: keys + start + ticks * (who == robot) for who, keys in dataset.pose_keys.items()}
    known = np.concatenate(list(poses.values()))

    def fault(table: Table) -> Table:
        later = start + ticks * (table.robot == robot)  # a robot names all poses by its own clock
        keys = np.where(is_pose(table.keys), table.keys + later, table.keys)
        there = ~is_pose(keys) | np.isin(keys, known)
        return replace(table, keys=keys).select(there.all(1))

    return replace(dataset.with_tables(map(fault, dataset.tables)), truth=None)


def landmark_moved(dataset: Dataset, mark: int, by: Array, robots: tuple[int, ...], *, after: float = 0.0) -> Dataset:
    """Some robots see a landmark elsewhere, from a share of their way on: points, by the truth of a simulation."""
    truth = dataset.truth
    assert truth is not None
    one = truth.only(np.array([mark]))
    there = truth.update(Values(one.layout, one.state + by))

    def fault(table: Table) -> Table:
        chain = dataset.pose_keys[table.robot]
        late = table.keys[:, 0] >= chain[int(after * (len(chain) - 1))]
        hit = (table.keys[:, -1] == mark) & late
        if table.source != "landmarks" or table.robot not in robots or not hit.any():
            return table
        seen, values = table.select(hit), table.values.copy()
        values[hit] += seen.row.minus(seen.predict(there), seen.predict(truth), table.dim)
        return replace(table, values=values)

    return dataset.with_tables(map(fault, dataset.tables))


def misread(dataset: Dataset, robot: int, mark: int, other: int, *, first: int = 0, rows: int | None = None) -> Dataset:
    """Some rows in which a robot sees one landmark, from its `first` on, call it by the name of another."""

    def fault(table: Table) -> Table:
        hit = np.flatnonzero(table.keys[:, -1] == mark)
        if table.source != "landmarks" or table.robot != robot:
            return table
        keys = table.keys.copy()
        keys[hit[first:][:rows], -1] = other
        return replace(table, keys=keys)

    return dataset.with_tables(map(fault, dataset.tables))


def jumped(dataset: Dataset, robot: int, row: int, sigmas: float, seed: int = 0) -> Dataset:
    """One row of a robot's odometry is off by so many sigmas, by a shift and a turn drawn at random."""

    def off(table: Table) -> Table:
        if table.robot != robot or table.source != "odometry":
            return table
        way = np.random.default_rng([seed, 5]).standard_normal(table.row.residual_rows(table.dim))
        error = np.linalg.inv(table.whitening[min(row, len(table.whitening) - 1)]) @ (
            sigmas * way / np.linalg.norm(way)
        )
        values = table.values.copy()
        values[row] = plus(table.model, table.values[[row]], error[None], table.dim)[0]
        return replace(table, values=values)

    return dataset.with_tables(map(off, dataset.tables))


def mounted(dataset: Dataset, robots: tuple[int, ...], mount: Pose, *, source: str = "landmarks") -> Dataset:
    """The sensor of some robots sits and looks elsewhere than it is stated: by the truth of a simulation."""
    truth = dataset.truth
    assert truth is not None

    def seen_from_there(table: Table) -> Table:
        if table.robot not in robots or table.source != source:
            return table
        there = replace(table, sensor=(table.sensor or Pose.identity(mount.dim)) @ mount)
        off = table.row.minus(there.predict(truth), table.predict(truth), table.dim)
        return replace(table, values=plus(table.model, table.values, off, table.dim))

    return dataset.with_tables(map(seen_from_there, dataset.tables))


def in_the_frame_of_odometry(dataset: Dataset, robot: int, *, steps: bool = False, heading: float = 0.0) -> Dataset:
    """What a planar robot's steps, or the points that it sees, are in the frame of its odometry, where it starts with
    some heading."""
    odometry = next(t for t in dataset.tables if t.robot == robot and t.is_odometry)
    order = np.argsort(odometry.keys[:, 0])
    start = Pose.from_xytheta(np.array([[0.0, 0.0, heading]]))
    way = [start]
    for step in order.tolist():
        way.append(way[-1] @ pose_of(odometry.values[[step]], 2))
    keys = np.append(odometry.keys[order[0], 0], odometry.keys[order, 1])
    poses = {int(key): pose for key, pose in zip(keys, way, strict=True)}

    def fault(table: Table) -> Table:
        if table.robot != robot:
            return table
        if steps and table is odometry:
            moved = pose_of(table.values, 2)
            turned = [poses[int(k)].rotation[0] @ t for k, t in zip(table.keys[:, 0], moved.translation, strict=True)]
            return replace(table, values=pack(Pose(moved.rotation, np.array(turned))))
        if not steps and table.model == "point":
            seen = [poses[int(k)].act(z[None])[0] for k, z in zip(table.keys[:, 0], table.values, strict=True)]
            return replace(table, values=np.array(seen))
        return table

    return dataset.with_tables(map(fault, dataset.tables))
