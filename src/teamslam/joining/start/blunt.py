"""Landmarks that lie where all who range them stand: on one level, or in space in one plane, in the plane in one line.

Across it nothing is told to first order: of a step t across, a range d grows by t^2 / 2d. What ranges tell of t is the
quartic in exp(-t^4 Q / 2), Q the information on q = t^2, which is an unknown like any other, whose column of Jacobian
stands beside those of the poses and of the landmark's other coordinates: Q = b'b - b'J (J'J)^-1 J'b. A solve to first
order has a pivot of zero there, or one of rounding, and calls the landmark lost, though all else of its place is known
as well as ever.

    variance     of t, by the information that the Jacobian's square is on average over what t may be:
                 1/v = first + 4 Q v;  with nothing to first order v = 1 / (2 Q^1/2)

The quartic's own variance is .956 of that (8^1/2 Gamma(3/4) / Gamma(1/4)). Where a landmark lies well off on one side,
`first` is what counts, and 4 Q v fades beside it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.start.triangulate import Bundle, kinds_of
from teamslam.model import WORLD, Dataset, Kind, Names, Submap, Table, Values, is_landmark, robot_of
from teamslam.solver import SubmapTerm, System

SOURCE = "levels"  # of the rows that say so
STEPS = 3
SHARE = 0.1  # of how far away it is: what may be farther across is not worth a word
UPRIGHT = 0.99  # of a direction's length along z: it is height


@dataclass(frozen=True, eq=False)
class Blunt:
    """A landmark `key` at a place (d,), across which direction (d,) its `rows` ranges are blunt, and how far across it
    may be (one standard deviation, below `farthest_m`); `observer`: the nearest pose that ranged it."""

    key: int
    place: Array
    across: Array
    sigma_m: float
    farthest_m: float
    observer: int
    rows: int

    def sentence(self, names: Names) -> str:
        """What is to be known of it."""
        height = len(self.place) == 3 and abs(self.across[2]) > UPRIGHT
        where, what = ("level", "its height") if height else ("line or plane", "how far it lies beside that")
        return (
            f"{names.describe(self.key)}: its {self.rows} ranges come from one {where} and tell {what} to second order "
            f"alone: it is put where they come from, give or take {self.sigma_m:.2g} m"
        )


def blunt(log: Dataset, joined: Submap) -> list[Blunt]:
    """The landmarks of a log that are nothing but ranged, by poses of a map, and across which these ranges are blunt;
    but for those that even so may be about as far across as they are away."""
    found = _alone(log, joined)
    return _in_the_team(found, log, joined, ()) if found else []


def levelled(submaps: Sequence[Submap], joined: Submap) -> Sequence[Submap]:
    """Submaps with what second order tells of landmarks that are nothing but ranged, by rows that travel with them and
    in their map `joined` still wait: as rows that travel with the submap of the nearest pose that ranged each. The same
    where there is nothing of the kind."""
    waiting = [t.select(~joined.all_values.layout.contains(t.keys[:, -1])) for t in joined.raw]
    tables = tuple(t for t in waiting if len(t))
    log = Dataset({t.robot: t.dim for t in tables}, tables, joined.names)
    found = _alone(log, joined) if tables else []
    found = _in_the_team(found, log, joined, [SubmapTerm.of(joined)]) if found else []
    given = list(submaps)
    for table in with_levels(log, found, joined.all_values).tables[len(tables) :]:
        n = next(n for n, submap in enumerate(given) if submap.all_values.layout.contains(table.keys[0, 0]))
        given[n] = replace(given[n], raw=(*given[n].raw, table))
    return given if found else submaps


def _alone(log: Dataset, joined: Submap) -> list[Blunt]:
    """The same, were all else known."""
    values = joined.all_values
    tables = [table for table in log.tables if is_landmark(table.keys[:, -1]).any()]
    otherwise = [t.keys[:, -1] for t in tables if t.model != "range" or t.row.unary]
    seen = [t.select(~np.isin(t.keys[:, -1], np.concatenate([*otherwise, []]))) for t in tables]
    seen = [t.select(is_landmark(t.keys[:, -1]) & values.layout.contains(t.keys[:, 0])) for t in seen]
    seen = [t for t in seen if len(t)]
    if not seen:
        return []
    layout = kinds_of(seen)
    kinds = (Kind.POINT2, Kind.POINT3)
    return [one for kind in kinds for one in _by_itself(layout.keys_of(kind), seen, values, kind.dim)]


def _by_itself(keys: IntArray, tables: Sequence[Table], values: Values, dim: int) -> Iterator[Blunt]:
    """Which are blunt, were all else known."""
    bundle = Bundle.of(tables, values, keys, dim)
    if not bundle.rays:
        return
    proposed, costs, information = bundle.refined(bundle.proposals())
    best, each = np.argmin(costs, 0), np.arange(len(keys))
    places, known = proposed[best, each], information[best, each] * bundle.unseen[:, None, None]
    finite = np.isfinite(costs[best, each]) & np.isfinite(known).all((1, 2))
    sizes, axes = np.linalg.eigh(np.where(finite[:, None, None], known, np.eye(dim)))
    across, first = axes[:, :, 0], np.maximum(sizes[:, 0], 0.0)
    bent = bundle.bent(places, across)
    variance = (np.sqrt(first**2 + 4.0 * bent) - first) / np.maximum(2.0 * bent, 1e-300)
    is_blunt = finite & (bent > 0.0) & (2.0 * first * variance < 1.0)
    for n in np.flatnonzero(is_blunt).tolist():
        seers = np.unique(np.concatenate([t.keys[t.keys[:, -1] == keys[n], 0] for t in tables]))
        away = np.linalg.norm(values.positions(seers, dim) - places[n], axis=-1)
        sigma, farthest = float(np.sqrt(variance[n])), SHARE * float(np.median(away))
        if sigma < farthest and sizes[n, 1] * farthest**2 > 1.0:
            observer = int(seers[np.argmin(away)])
            yield Blunt(int(keys[n]), places[n], across[n], sigma, farthest, observer, int(bundle.seen[n]))


def _in_the_team(found: Sequence[Blunt], log: Dataset, joined: Submap, terms: Sequence[SubmapTerm]) -> list[Blunt]:
    """The same with what is known of all else, so that errors of the ways are no ranges' own: by the log, and by what
    `terms` hold of it; without those that it leaves as far across as `farthest_m`."""
    known, fixed = (joined.values, []) if joined.base == WORLD else (joined.all_values, [joined.base])
    held = reduce(Values.update, (_placed(one, one.place) for one in found), known)
    tables = [
        t.select(np.flatnonzero(held.layout.contains(t.keys).all(1))) for t in with_levels(log, found, known).tables
    ]
    tables = [t for t in tables if len(t)]
    system = System(held.layout, tables=tables, submaps=terms, fixed=np.array(fixed, np.int64), names=joined.names)
    factor = system.factor(held)
    factor.factorise(system.linearise(held).hessian.numbers)
    jacobians = [system.jacobian(n, held) for n in range(len(tables))]
    sure = []
    for one in found:
        for _ in range(STEPS):  # how residuals bend over as far as it may be, which for near sensors is not next to it
            around = [held.update(_placed(one, one.place + k * one.sigma_m * one.across)) for k in (-1.0, 0.0, 1.0)]
            told, column = 0.0, np.zeros(system.free.dof)
            for table, jacobian in zip(tables, jacobians, strict=True):
                if table.source != SOURCE and one.key in table.keys[:, -1]:
                    behind, here, ahead = (table.whitened(values).ravel() for values in around)
                    bend = 0.5 * (ahead - 2.0 * here + behind) / one.sigma_m**2
                    told, column = told + float(bend @ bend), column + jacobian.T @ bend
            of_square = max(told - float(column @ factor.solve(column)), 1e-300)
            one = replace(one, sigma_m=float(np.sqrt(0.5 / np.sqrt(of_square))))
        if one.sigma_m < one.farthest_m:
            sure.append(one)
    return sure


def _placed(one: Blunt, place: Array) -> Values:
    return Values.of({Kind(len(place)): (np.array([one.key]), place[None])})


def with_levels(log: Dataset, found: Iterable[Blunt], values: Values) -> Dataset:
    """A log with what second order tells of landmarks as rows: one `point` each, seen by the nearest pose, that counts
    across alone."""
    tables = list(log.tables)
    for one in found:
        dim, robot = len(one.place), int(robot_of(one.observer))
        body = values.pose(one.observer).lift(dim)
        whitening = np.zeros((1, dim, dim))
        whitening[0, 0] = body.rotation.T @ one.across / one.sigma_m
        number = np.array([sum(len(t) for t in tables if (t.robot, t.source) == (robot, SOURCE))])
        keys, seen = np.array([[one.observer, one.key]]), body.unact(one.place)[None]
        tables.append(Table(robot, SOURCE, "point", dim, keys, seen, whitening, number))
    return replace(log, tables=tuple(tables))
