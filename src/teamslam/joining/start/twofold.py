"""Landmarks that fit at two places: two ranges meet on either side of the line between their sensors.

A Gaussian says one place. Which of two is right may show when others' sightings come in; until then nobody may commit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining.start.triangulate import SAME, Bundle
from teamslam.model import Kind, Loss, Table, Values, is_landmark, point_kind, pose_kind

RULED_OUT = 16.0  # of cost: four sigmas; a place, or an assembly of a team, that costs more is not mentioned
PLAUSIBLE = 25.0  # of cost for each sighting: poses that give way make more of it than this only if they bend far
SETTLED = 1e-4  # of cost: a place from which refinements of a few steps lead no lower
REFINEMENTS = 50  # at most: along a valley that bends two proposals of one place are long apart
NONE = np.zeros(0, np.int64)
NEAR = 9.0  # of cost: a place within three sigmas of another is the same
WALL = 2.25  # of cost: the pass between two mirrored places that are six sigmas apart, by ranges alone and by all
STEPS = 16  # from one place to another, between which that is looked for


@dataclass(frozen=True, eq=False)
class Twofold:
    """Landmarks `keys` (m,) of one dimension, which fit at `others` (m, d) too, for so much `more` (m,) of cost, if the
    poses stay where they are. `seen` (m,) how often. `by_nature` (m,): no robot that sees them can ever tell, since all
    of them move in a plane that they lie off. `open` (m,): the place in the map is not held by what sees it."""

    keys: IntArray
    others: Array
    more: Array
    seen: IntArray
    by_nature: BoolArray
    open: BoolArray

    @property
    def kind(self) -> Kind:
        """Of all of them."""
        return point_kind(self.others.shape[1])

    def select(self, mask: BoolArray) -> "Twofold":
        """Some of them."""
        return Twofold(*(getattr(self, field.name)[mask] for field in fields(self)))


def twofold(values: Values, tables: Sequence[Table]) -> list[Twofold]:
    """The landmarks of `values` that their sightings put at another place as well, with all poses where they are."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables if not t.row.unary]
    marks = [t.select(np.asarray(values.layout.contains(t.keys).all(1))) for t in marks]
    ranged = np.unique(np.concatenate([NONE, *(t.keys[:, -1] for t in marks if t.model == "range")]))
    kinds = values.layout.kinds[values.layout.index(ranged)]
    points = [kind for kind in map(Kind, np.unique(kinds).tolist()) if not kind.is_pose]
    return [_of_kind(values, marks, ranged[kinds == kind], kind) for kind in points]


def _of_kind(values: Values, marks: Sequence[Table], keys: IntArray, kind: Kind) -> Twofold:
    here = values.positions(keys, kind.dim)
    bundle = Bundle.of(marks, values, keys, kind.dim)
    places = np.concatenate([here[None], bundle.on_either_side(here), bundle.proposals()])
    costs = np.full(places.shape[:2], np.inf)
    for _ in range(REFINEMENTS):
        before = costs
        places, costs, information = bundle.refined(places)
        told = costs < costs[0] + RULED_OUT + PLAUSIBLE * bundle.seen
        if not (told & (costs < before - SETTLED)).any():
            break
    offsets = places - places[0]
    far = np.einsum("kni,nij,knj->kn", offsets, information[0], offsets) > NEAR
    more = np.where(far, costs - costs[0], np.inf)
    nearest, each = np.argmin(more, 0), np.arange(len(keys))
    others, more = places[nearest, each], more[nearest, each]
    ranges = Bundle.of([_unforgiving(t) for t in marks if t.model == "range"], values, keys, kind.dim)
    between = np.minimum(*(_walls(of, places[0], others) for of in (bundle, ranges)))
    more = np.where(between > WALL, more, np.inf)
    in_plane = _seen_in_plane(values, marks, keys, kind) & (np.abs(more) < SAME * (1.0 + costs[0]))
    found = Twofold(keys, others, more, bundle.seen, in_plane, ~bundle.holds(places[0], information[0]))
    return found.select((more < RULED_OUT + PLAUSIBLE * bundle.seen) | found.open)


def _unforgiving(ranges: Table) -> Table:
    """Ranges under a loss that digs no pits of its own: what is between two places then is their mirror, or nothing."""
    return ranges if ranges.loss.name in ("squared", "huber") else ranges.with_loss(Loss("huber", ranges.loss.scale))


def _walls(bundle: Bundle, here: Array, there: Array) -> Array:
    """How much more than either of two places (n, d) the pass between them costs (n,): the dearest of places on the way
    from one to the other, each as low as it lies across that way, since valleys are bent. Little where both lie in one
    long valley, and the landmark has one place that is known badly."""
    way = there - here
    shares = np.linspace(0.0, 1.0, STEPS + 1)[:, None, None]
    lengths = np.linalg.norm(way, axis=-1, keepdims=True)
    _, costs, _ = bundle.refined(here + shares * way, across=way / np.maximum(lengths, 1e-300))
    return np.asarray(costs.max(0) - np.maximum(costs[0], costs[-1]))


def _seen_in_plane(values: Values, marks: Sequence[Table], keys: IntArray, kind: Kind) -> BoolArray:
    """Which landmarks (n,) only robots of fewer dimensions than their own see."""
    layout, seen = values.layout, np.ones(len(keys), bool)
    for table in marks:
        table = table.select(np.isin(table.keys[:, -1], keys))
        free = layout.kinds[layout.index(table.keys[:, 0])] >= pose_kind(kind.dim)
        seen[np.searchsorted(keys, table.keys[free, -1])] = False
    return seen
