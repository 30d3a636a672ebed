"""Which of a robot's sightings of one landmark agree with each other, before anything is solved.

Along its odometry each sighting puts the landmark somewhere in the robot's frame. Two of them agree if these places lie
as close together as their noise and the drift between them allow:

    var(p - p') = var(z) + var(z') + sum over the steps between of  s_T^2 + s_R^2 |p - T_k|^2

The largest set in which every two agree is what to start from. What disagrees with it may agree among itself: another
landmark that is taken for this one, from time to time. These are the next sets, and the team may find that one of them
is the landmark (`vote`).
"""

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, lift_points
from teamslam.joining.start.odometry import odometry_links
from teamslam.joining.start.targets import WHOLE, measured_positions
from teamslam.model import Dataset, Table, Values, chi2_quantile, index_of, is_landmark, variances
from teamslam.trust.outliers.clique import largest_clique

PROBABILITY = 0.9999  # of two right sightings to agree
SETS = 3  # of sightings of one landmark
MOST = 150  # of a landmark that are compared, evenly over time
NONE = -1


def agreeing(piece: Dataset, robot: int, way: Values) -> list[IntArray]:
    """For each table of a robot's piece of log the set that each row is in (m,): 0 for what fixes no place by itself
    and for the largest set of sightings of a landmark that agree, 1, 2 for the next, NONE for rows in none of these.
    `way` holds the robot's poses by its odometry."""
    drift = _Drift(piece, robot, way)
    found = [np.zeros(len(table), np.int64) for table in piece.tables]
    for table, sets in zip(piece.tables, found, strict=True):
        if table.row.unary or table.model not in (*WHOLE, "relative_pose") or not is_landmark(table.keys[:, -1]).any():
            continue
        rows = np.flatnonzero(is_landmark(table.keys[:, -1]) & way.layout.contains(table.keys[:, 0]))
        places, spread = _places(table.select(rows), way)
        for mark in np.unique(table.keys[rows, -1]).tolist():
            of = np.flatnonzero(table.keys[rows, -1] == mark)
            sets[rows[of]] = _sets(drift, index_of(table.keys[rows[of], 0]), places[of], spread[of])
    return found


def _sets(drift: "_Drift", ticks: IntArray, places: Array, spread: Array) -> IntArray:
    """The sets of sightings of one landmark, the largest first; each but the first has two members at least."""
    sets = np.full(len(places), NONE)
    for number in range(SETS):
        left = np.flatnonzero(sets == NONE)
        if len(left) < min(1 + number, 2):
            break
        members = _largest(drift, ticks[left], places[left], spread[left])
        if number and members.sum() < 2:
            break
        sets[left[members]] = number
    return sets


def _largest(drift: "_Drift", ticks: IntArray, places: Array, spread: Array) -> BoolArray:
    picked = np.unique(np.linspace(0, len(places) - 1, min(len(places), MOST)).astype(int))
    agree = drift.agree(ticks[picked], places[picked], spread[picked])
    clique = picked[largest_clique(agree).members]
    if len(picked) == len(places):
        return np.asarray(np.isin(np.arange(len(places)), clique))
    # Of those that were not compared, the ones that agree with most of the clique.
    return np.asarray(drift.agree(ticks, places, spread)[:, clique].mean(1) > 0.5)


def _places(table: Table, way: Values) -> tuple[Array, Array]:
    """Where each row puts its landmark (m, 3), and the variance of that, all axes together (m,)."""
    seen_by = way.poses_of(table.keys[:, 0], 3)
    each = np.broadcast_to(variances(table.whitening), (len(table), table.whitening.shape[-1]))
    d = table.dim
    if table.model == "relative_pose":
        where = table.values[:, :d] if table.sensor is None else table.sensor.lift(d).act(table.values[:, :d])
        return seen_by.act(lift_points(where, 3)), each[:, :d].sum(-1)
    spread = each[:, :d].sum(-1)
    if table.model == "range_bearing":
        spread = each[:, 0] + table.values[:, 0] ** 2 * each[:, 1:].sum(-1)
    return seen_by.act(lift_points(measured_positions(table), 3)), spread


class _Drift:
    """How far the way may have drifted between any two of its poses, as seen at any place: sums along the odometry."""

    def __init__(self, piece: Dataset, robot: int, way: Values) -> None:
        keys = way.layout.keys
        self.ticks = index_of(keys)
        which, row, _ = odometry_links(piece, robot, keys)
        moved, turned = np.zeros(len(which)), np.zeros(len(which))
        for number in np.unique(which[which >= 0]).tolist():
            steps, table = np.flatnonzero(which == number), piece.tables[number]
            each = np.broadcast_to(variances(table.whitening), (len(table), table.whitening.shape[-1]))[row[steps]]
            moved[steps], turned[steps] = each[:, : table.dim].sum(-1), each[:, table.dim :].sum(-1)
        at = way.positions(keys, 3)[:-1] if len(keys) else np.zeros((0, 3))
        columns = np.column_stack([moved, turned, turned[:, None] * at, turned * np.sum(at**2, -1)])
        self.sums = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, 0)])

    def agree(self, ticks: IntArray, places: Array, spread: Array) -> BoolArray:
        """Which of some places (n, 3), seen at some ticks (n,), may be one (n, n)."""
        at = self.sums[np.searchsorted(self.ticks, ticks)]
        between = np.abs(at[:, None] - at[None])
        turned = between[..., 1] * np.sum(places**2, -1)[:, None] + between[..., -1]
        signed = (at[:, None, 2:5] - at[None, :, 2:5]) * np.sign(ticks[:, None] - ticks[None])[..., None]
        turned -= 2.0 * np.sum(signed * places[:, None], -1)
        allowed = spread[:, None] + spread[None] + between[..., 0] + np.maximum(turned, 0.0)
        apart = np.sum((places[:, None] - places[None]) ** 2, -1)
        gate = float(chi2_quantile(PROBABILITY, 1))
        found = apart <= gate * np.maximum(allowed, allowed.T)
        return np.asarray(found)
