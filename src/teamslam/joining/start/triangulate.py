"""Landmarks that no single sighting fixes: placed from several bearings and ranges, where these hold them.

    propose:  bearings want the point nearest to all rays, min sum |(1 - u u')(p - c)|^2 with sensors at c, rays u;
              ranges, |c|^2 - 2 c'p + |p|^2 = r^2, are linear in p and q = |p|^2 (spherical intersection); both together
              say where p is; all at once
    mirror:   ranges from places nearly in line (in space: in a plane) leave two answers, one on either side
    refine:   a few damped Gauss-Newton steps of each landmark by itself, from each proposal; the lower cost counts
    hold:     a place is taken where its worst standard deviation is below a share of its distance. Beyond that it may
              as well be far off or on the other side, and no Gaussian tells

A landmark that stays open is left out, and so are its measurements; the caller reports them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, directions
from teamslam.joining.start.partial_poses import place_from_parts
from teamslam.joining.start.targets import place_targets
from teamslam.model import Kind, Layout, Table, Values, is_landmark, point_kind

HELD = 0.5  # the largest share of its distance by which a landmark may be uncertain
ROUNDING = 1e-14  # of the largest information on a place: less is none
STEPS = 8  # of the refinement: quadratic near the answer
SAME = 1e-6  # of a cost: what two places of a landmark may differ by and still be mirrors of each other
BEND = 1e-3  # of a distance: a step along which residuals are asked how they bend
MOST = 40  # sightings of one landmark that are looked at; more would not tell more of its place


def triangulate(start: Values, tables: Iterable[Table]) -> Values:
    """`start` with the landmarks added that its poses see in `tables`, wherever the geometry fixes them."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables if not t.row.unary]
    marks = [t for t in marks if len(t) and not start.layout.contains(t.keys[:, -1]).all()]
    if not marks:
        return start
    layout = kinds_of(marks).select(~start.layout.contains(kinds_of(marks).keys))
    start = place_targets(start, marks, start.layout.union(layout))
    posed = layout.select(~start.layout.contains(layout.keys) & (layout.kinds <= Kind.POSE3))
    start = place_from_parts(start, marks, posed) if len(posed) else start
    open_ = layout.select(~start.layout.contains(layout.keys) & (layout.kinds > Kind.POSE3))
    for kind in (Kind.POINT2, Kind.POINT3):
        bundle = Bundle.of(marks, start, open_.keys_of(kind), kind.dim)
        places, held = bundle.intersected()
        if held.any():
            start = start.update(Values.of({kind: (bundle.keys[held], places[held])}))
    return start


@dataclass(frozen=True, eq=False)
class _Rays:
    """Sightings of one model: `table`, who saw (m,), where the sensors stood, and which landmark of the bundle (m,)."""

    table: Table
    bodies: Pose
    eyes: Pose
    mark: IntArray

    def repeated(self, times: int, marks: int) -> "_Rays":
        """The same once for each of several proposals, which come one after another."""
        again = np.tile(np.arange(len(self.mark)), times)
        mark = self.mark[again] + marks * np.repeat(np.arange(times), len(self.mark))
        return _Rays(self.table.select(again), self.bodies[again], self.eyes[again], mark)


@dataclass(frozen=True, eq=False)
class Bundle:
    """Landmarks (n,) of one dimension, with all sightings from known poses; `seen` (n,) counts these."""

    keys: IntArray
    dim: int
    rays: Sequence[_Rays]
    seen: IntArray

    @classmethod
    def of(cls, tables: Iterable[Table], values: Values, keys: IntArray, dim: int) -> "Bundle":
        """The sightings in `tables` of the landmarks `keys` (sorted) from poses that are among `values`."""
        rays, seen = [], np.zeros(len(keys), np.int64)
        for table in tables:
            rows = np.flatnonzero(np.isin(table.keys[:, 1], keys) & values.layout.contains(table.keys[:, 0]))
            if not len(rows) or table.dim > dim:
                continue
            mark = np.searchsorted(keys, table.keys[rows, 1])
            seen += np.bincount(mark, minlength=len(keys))
            rows = rows[_spread(mark)]
            part = table.select(rows)
            bodies = values.poses_of(part.keys[:, 0], dim)
            eyes = bodies if part.sensor is None else bodies @ part.sensor.lift(dim)
            rays.append(_Rays(part, bodies, eyes, np.searchsorted(keys, part.keys[:, 1])))
        return cls(keys, dim, rays, seen)

    def intersected(self) -> tuple[Array, BoolArray]:
        """Where each landmark is (n, d), and whether it is held there (n,)."""
        n = len(self.keys)
        if not self.rays:
            return np.zeros((n, self.dim)), np.zeros(n, bool)
        proposals = self.proposals()
        places, costs, information = self.refined(proposals)
        best, each = _lowest(places, costs), np.arange(n)
        places, costs, information = places[best, each], costs[best, each], information[best, each]
        return places, np.isfinite(costs) & self.holds(places, information)

    def proposals(self) -> Array:
        """(2, n, d): by linear least squares, and on the other side of the line or plane that the ranges came from."""
        n, d = len(self.keys), self.dim
        normal, right = np.zeros((n, d + 1, d + 1)), np.zeros((n, d + 1))
        for rays in self.rays:
            rows, values = _linear_rows(rays, d)
            np.add.at(normal, rays.mark, np.swapaxes(rows, -1, -2) @ rows)
            np.add.at(right, rays.mark, (np.swapaxes(rows, -1, -2) @ values[..., None])[..., 0])
        # q = |p|^2 goes first; without ranges it is not there.
        square = np.where(normal[:, d, d] > 0.0, normal[:, d, d], 1.0)
        across = normal[:, :d, d]
        left = normal[:, :d, :d] - across[:, :, None] * across[:, None, :] / square[:, None, None]
        wanted = right[:, :d] - across * (right[:, d] / square)[:, None]
        # What is left may be nothing but rounding of what was there: the ridge is above that.
        before, after = (np.trace(part, axis1=1, axis2=2) for part in (normal[:, :d, :d], left))
        ridge = np.maximum(1e-12 * after, np.maximum(1e-14 * before, 1e-24))
        straight = np.linalg.solve(left + ridge[:, None, None] * np.eye(d), wanted[..., None])[..., 0]
        return self.on_either_side(straight)

    def on_either_side(self, places: Array) -> Array:
        """The places (n, d) and their mirrors: (2, n, d), as far off the line or plane of the sensors as ranges say."""
        n = len(places)
        ranged = [rays for rays in self.rays if rays.table.model == "range"]
        if not ranged:
            return places[None]
        mark = np.concatenate([rays.mark for rays in ranged])
        centres = np.concatenate([rays.eyes.translation for rays in ranged])
        lengths = np.concatenate([rays.table.values[:, 0] for rays in ranged])
        count = np.maximum(np.bincount(mark, minlength=n), 1)[:, None]
        middle = _summed(centres, mark, n) / count
        arms = centres - middle[mark]
        _, axes = np.linalg.eigh(_summed(arms[:, :, None] * arms[:, None, :], mark, n))
        off = axes[:, :, 0]  # the direction in which the sensors are spread least
        height = np.sum((places - middle) * off, -1)
        foot = places - height[:, None] * off
        missing = lengths**2 - np.sum((foot[mark] - centres) ** 2, -1)
        rise = np.sqrt(np.maximum(_summed(missing, mark, n) / count[:, 0], 0.0))
        side = np.where(height < 0.0, -1.0, 1.0)
        has = np.bincount(mark, minlength=n) > 0
        up = np.where(has[:, None], foot + (side * rise)[:, None] * off, places)
        down = np.where(has[:, None], foot - (side * rise)[:, None] * off, places)
        return np.stack([up, down])

    def refined(self, proposals: Array, across: Array | None = None) -> tuple[Array, Array, Array]:
        """From each proposal (k, n, d) the nearest optimum of each landmark by itself, its cost (k, n), and the
        information on it (k, n, d, d); or the nearest of those places that lie across a direction `across` (n, d)."""
        k, n, d = proposals.shape
        rays = [each.repeated(k, n) for each in self.rays]
        places, damping = proposals.reshape(k * n, d), np.full(k * n, 1e-3)
        still = None if across is None else np.tile(across[:, :, None] * across[:, None, :], (k, 1, 1))
        cost, gradient, information = _linearised(rays, places)
        for _ in range(STEPS):
            scale = np.trace(information, axis1=1, axis2=2) / d + 1e-300
            damped = information + (damping * scale)[:, None, None] * np.eye(d)
            if still is None:
                tried = places + np.linalg.solve(damped, gradient[..., None])[..., 0]
            else:  # in what lies across: beside what holds the way itself, that could be lost in rounding
                free = np.eye(d) - still
                alone = free @ damped @ free + scale[:, None, None] * still
                tried = places + (free @ np.linalg.solve(alone, free @ gradient[..., None]))[..., 0]
            cost_tried, gradient_tried, information_tried = _linearised(rays, tried)
            better = cost_tried < cost
            damping = np.where(better, 0.1 * damping, 10.0 * damping)
            places = np.where(better[:, None], tried, places)
            gradient = np.where(better[:, None], gradient_tried, gradient)
            information = np.where(better[:, None, None], information_tried, information)
            cost = np.where(better, cost_tried, cost)
        return places.reshape(k, n, d), cost.reshape(k, n), information.reshape(k, n, d, d)

    def bent(self, places: Array, across: Array) -> Array:
        """How residuals bend along a step t across (n, d) from each place (n, d): the sum of |d2e/dt2|^2 (n,)."""
        found = np.zeros(len(self.keys))
        for rays in self.rays:
            at, along = places[rays.mark], across[rays.mark]
            step = (BEND * np.linalg.norm(at - rays.eyes.translation, axis=-1))[:, None]
            ahead, behind = _whitened(rays, at + step * along), _whitened(rays, at - step * along)
            second = (ahead + behind - 2.0 * _whitened(rays, at)) / np.maximum(step, 1e-150) ** 2
            found += np.bincount(rays.mark, np.sum(second**2, -1), minlength=len(found))
        return found * self.unseen

    @property
    def unseen(self) -> Array:
        """How many times as many sightings of each landmark (n,) there are as are looked at."""
        looked_at = np.zeros(len(self.keys))
        for rays in self.rays:
            looked_at += np.bincount(rays.mark, minlength=len(self.keys))
        return self.seen / np.maximum(looked_at, 1.0)

    def nearest(self, places: Array) -> Array:
        """How far each landmark (n,) is from the nearest sensor that saw it."""
        found = np.full(len(self.keys), np.inf)
        for rays in self.rays:
            np.minimum.at(found, rays.mark, np.linalg.norm(places[rays.mark] - rays.eyes.translation, axis=-1))
        return found

    def costs_at(self, places: Array) -> Array:
        """What the sightings of each landmark cost (n,) at these places (n, d)."""
        return _linearised(self.rays, places)[0]

    def held_at(self, places: Array, share: float = HELD) -> BoolArray:
        """Whether each landmark (n,) is known to a share of its least distance at these places (n, d)."""
        _, _, information = _linearised(self.rays, places)
        return self.holds(places, information, share)

    def holds(self, places: Array, information: Array, share: float = HELD) -> BoolArray:
        """Whether each landmark (n,) is known to a share of its least distance."""
        nearest = self.nearest(places)
        known = np.isfinite(information).all((1, 2), keepdims=True)  # a landmark where its sensor is has no bearing
        sizes = np.linalg.eigvalsh(np.where(known, information, 0.0))
        least = sizes[:, 0] * self.unseen
        told = sizes[:, 0] > ROUNDING * sizes[:, -1]  # and not by what differences leave of nothing
        return np.asarray(told & (least * (share * np.where(np.isfinite(nearest), nearest, 0.0)) ** 2 > 1.0))


def _lowest(places: Array, costs: Array) -> IntArray:
    """The cheapest (n,) of several places (k, n, d); of those that cost the same to rounding the highest: what sensors
    of one height leave open is whether a landmark is above them, and then it is above for everybody."""
    low = costs.min(0)
    same = costs <= low + SAME * (1.0 + low)
    highest: IntArray = np.argmax(np.where(same, places[..., -1], -np.inf), 0)
    return highest


def kinds_of(tables: Sequence[Table]) -> Layout:
    """The landmarks that tables see: space counts before the plane, and a pose before a point."""
    keys = np.concatenate([t.keys[:, -1] for t in tables])
    spatial = np.concatenate([np.full(len(t), t.dim == 3) for t in tables])
    posed = np.concatenate([np.full(len(t), t.row.targets_pose) for t in tables])
    keys, of = np.unique(keys, return_inverse=True)
    in_space, is_pose = np.zeros(len(keys), bool), np.zeros(len(keys), bool)
    np.logical_or.at(in_space, of, spatial)
    np.logical_or.at(is_pose, of, posed)
    return Layout.of(keys, np.where(is_pose, 0, int(point_kind(2))) + in_space)


def _spread(mark: IntArray) -> IntArray:
    """At most MOST rows of each landmark, evenly taken, in their order."""
    order = np.argsort(mark, kind="stable")
    sorted_ = mark[order]
    first = np.searchsorted(sorted_, sorted_)
    count = np.searchsorted(sorted_, sorted_, side="right") - first
    place = np.arange(len(mark)) - first
    # The k-th of n rows is taken where k MOST / n passes a whole number.
    taken = (count <= MOST) | ((place * MOST) // count != ((place - 1) * MOST) // count)
    return np.sort(order[taken])


def _linear_rows(rays: _Rays, d: int) -> tuple[Array, Array]:
    """What the sightings say of (p, q = |p|^2), linear: rows (m, k, d + 1) and values (m, k).

    A sensor of fewer dimensions than the landmark has says as much as it sees: a bearing in the plane holds its target
    in a plane through the sensor's upright.
    """
    table, centres, z = rays.table, rays.eyes.translation, rays.table.values
    seen = np.swapaxes(rays.eyes.rotation, -1, -2)[:, : table.dim]  # takes the world to what the sensor sees of it
    if table.model == "bearing":
        across = directions(table.dim).direction_basis(directions(table.dim).ray(z))
        pull = np.swapaxes(across, -1, -2) @ seen
        return _without_square(pull), (pull @ centres[..., None])[..., 0]
    if table.model == "point":
        pull = table.whitening @ seen
        return _without_square(pull), (table.whitening @ z[..., None] + pull @ centres[..., None])[..., 0]
    if table.model == "range_bearing":  # unwhitened: along the ray and across it sigmas are of another kind
        offset = z[:, :1] * directions(table.dim).ray(z[:, 1:])
        return _without_square(seen), offset + (seen @ centres[..., None])[..., 0]
    if table.model == "range":
        length, c = np.maximum(z, 1e-9), centres * (np.arange(d) < table.dim)
        rows = np.concatenate([-2.0 * c, np.ones((len(table), 1))], 1) / (2.0 * length)
        return rows[:, None], (length**2 - np.sum(c**2, -1, keepdims=True)) / (2.0 * length)
    return np.zeros((len(table), 0, d + 1)), np.zeros((len(table), 0))


def _without_square(rows: Array) -> Array:
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], 1))], -1)


def _linearised(rays: Sequence[_Rays], places: Array) -> tuple[Array, Array, Array]:
    """Of each landmark its cost (n,), gradient (n, d) and information (n, d, d), by central differences."""
    n, d = places.shape
    cost, gradient, information = np.zeros(n), np.zeros((n, d)), np.zeros((n, d, d))
    for each in rays:
        at = places[each.mark]
        error = _whitened(each, at)
        squared = np.sum(error**2, -1)
        weight = each.table.loss.weight(squared)
        step = 1e-6 * np.maximum(np.linalg.norm(at - each.eyes.translation, axis=-1), 1e-6)
        columns = [
            (_whitened(each, at - step[:, None] * axis) - _whitened(each, at + step[:, None] * axis))
            / (2.0 * step)[:, None]
            for axis in np.eye(d)
        ]
        jacobian = np.stack(columns, -1)
        weighted = weight[:, None, None] * np.swapaxes(jacobian, -1, -2)
        cost += np.bincount(each.mark, each.table.loss.cost(squared), minlength=n)
        gradient += _summed((weighted @ error[..., None])[..., 0], each.mark, n)
        information += _summed(weighted @ jacobian, each.mark, n)
    return cost, gradient, information


def _whitened(rays: _Rays, places: Array) -> Array:
    table = rays.table
    error = table.row.minus(table.values, table.predict_from(rays.bodies, places), table.dim)
    return np.asarray((table.whitening @ error[..., None])[..., 0])


def _summed(numbers: Array, of: IntArray, n: int) -> Array:
    """Rows (m, ...) added up by the group that each is of: (n, ...)."""
    flat = numbers.reshape(len(of), -1)
    columns = [np.asarray(np.bincount(of, column, minlength=n), float) for column in flat.T]
    return np.stack(columns, -1).reshape(n, *numbers.shape[1:])
