"""Faults as people make them, planted into good logs: each turns a dataset into one with a known cause of misfit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.model import Dataset, Table, pack
from teamslam.model.sensors import pose_of

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


def late(steps: int) -> Fault:
    """A clock that is behind: what was seen at one pose is said of one some steps later."""

    def fault(table: Table) -> Table:
        poses = np.unique(table.keys[:, 0])
        place = np.searchsorted(poses, table.keys[:, 0])
        kept = place + steps < len(poses)
        keys = table.keys.copy()
        keys[kept, 0] = poses[place[kept] + steps]
        return replace(table, keys=keys).select(kept)

    return fault


def surer(factor: float) -> Fault:
    """Standard deviations stated too small by a factor."""
    return lambda table: replace(table, whitening=table.whitening * factor)


def moved_landmark(mark: int, by: Array, *, share: float = 0.5) -> Fault:
    """From a share of the rows on, a landmark stands elsewhere (as the sightings' own frame sees it: for points)."""

    def fault(table: Table) -> Table:
        hit = (table.keys[:, -1] == mark) & (np.arange(len(table)) >= share * len(table))
        return replace(table, values=table.values + hit[:, None] * by)

    return fault
