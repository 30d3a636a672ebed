"""Visits of tags, and maps of what one robot saw of them, each visit by itself.

visit:   sightings of a tag with no break longer than BREAK_S
map:     what visits tie together, through images that show several, mapped by itself: least squares of these
         sightings alone, from where the tags lead (`by_targets`)
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.by_targets import by_targets
from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Kind, Table, Values, index_of, is_landmark, landmark_key
from teamslam.model.sparse import sp
from teamslam.solver import Covariances, Options, System, optimise

BREAK_S = 60.0
QUICK = Options(max_iterations=50, decrement=0.05, elsewhere=False)


@dataclass(frozen=True, eq=False)
class Visits:
    """Visits (v,) by tag and time: their tag, first and last tick; of the rows (m,) of all tables, one after another,
    which each is of, and the place of its pose among `poses`."""

    tag: IntArray
    start: IntArray
    stop: IntArray
    of_row: IntArray
    frame: IntArray
    poses: IntArray

    @classmethod
    def of(cls, tables: Sequence[Table]) -> "Visits":
        """Those in the sightings of one robot."""
        keys = np.concatenate([t.keys for t in tables])
        ticks, poses = index_of(keys[:, 0]), np.unique(keys[:, 0])
        order = np.lexsort([ticks, keys[:, 1]])
        tag, tick = keys[order, 1], ticks[order]
        new = np.append(True, (np.diff(tag) != 0) | (np.diff(tick) > BREAK_S * TICKS_PER_S))
        of_row = np.empty(len(keys), np.int64)
        of_row[order] = np.cumsum(new) - 1
        begins = np.flatnonzero(new)
        stops = np.append(begins[1:], len(tag)) - 1
        return cls(tag[begins], tick[begins], tick[stops], of_row, np.searchsorted(poses, keys[:, 0]), poses)

    @property
    def again(self) -> bool:
        """Whether any tag was seen again after a break."""
        return bool((np.diff(self.tag) == 0).any())

    def parts(self) -> list[IntArray]:
        """Rows that images with several visits tie together."""
        from scipy.sparse.csgraph import connected_components

        n, v = len(self.poses), len(self.tag)
        graph = sp.coo_array((np.ones(len(self.frame)), (self.frame, n + self.of_row)), shape=(n + v, n + v))
        part = connected_components(graph, directed=False)[1][self.frame]
        return [np.flatnonzero(part == number) for number in np.unique(part)]


@dataclass(frozen=True, eq=False)
class VisitMap:
    """Visits (k,) and where their tags stand (k,), in a frame of its own; their `covariances`, by landmarks of the
    visits' numbers, where it is determined."""

    visits: IntArray
    places: Pose
    covariances: Covariances | None

    def apart(self, ones: IntArray, others: IntArray) -> Array:
        """How far some of its tags, as places in it, are from others (a, b) [m]."""
        at = self.places.translation
        return np.asarray(np.linalg.norm(at[ones, None] - at[None, others], axis=-1))

    def sigma(self, one: int, others: IntArray) -> Array:
        """How well it knows how far a tag is from others (b,) [m], one sigma; infinite where it is not determined."""
        b = len(others)
        if self.covariances is None:
            return np.full(b, np.inf)
        joint = self.covariances.joint(landmark_key(self.visits[np.append(one, others)]))
        C = joint.reshape(b + 1, 6, b + 1, 6)[:, :3, :, :3]
        off = self.places.translation[others] - self.places.translation[one]
        ray = off / np.maximum(np.linalg.norm(off, axis=-1), 1e-12)[:, None]
        to = np.arange(1, b + 1)
        own = C[0, :, 0] + C[to, :, to] - C[0][:, to].swapaxes(0, 1) - C[to, :, 0]
        return np.asarray(np.sqrt(np.maximum(np.einsum("bi,bij,bj->b", ray, own, ray), 0.0)))


def map_of(tables: Sequence[Table], visits: Visits, rows: IntArray) -> VisitMap | None:
    """The map of a part, each visit a landmark; None where no sighting tells a pose."""
    first, parts = 0, []
    for table in tables:
        own = rows[(rows >= first) & (rows < first + len(table))]
        keys = np.stack([table.keys[own - first, 0], landmark_key(visits.of_row[own])], -1)
        parts.append(replace(table.select(own - first), keys=keys))
        first += len(table)
    parts = [part for part in parts if len(part)]
    frames = np.unique(np.concatenate([part.keys[:, 0] for part in parts]))
    way = Values.of({Kind.POSE3: (frames, Pose.identity(3, (len(frames),)))})
    led = by_targets(parts, way, (np.diff(index_of(frames)) / TICKS_PER_S) ** 2)
    if led is None:
        return None
    marks = led.layout.keys[is_landmark(led.layout.keys)]
    system = System(led.layout, tables=parts, fixed=frames[:1])
    values, covariances = led, None
    with suppress(SolveError):
        solution = optimise(system, led, QUICK)
        if solution.converged:  # on its way a loss that forgives may let tags go anywhere
            covariances = Covariances(system.free, solution.hessian).determined()
            values = solution.values
    return VisitMap(index_of(marks), values.poses_of(marks, 3), covariances)
