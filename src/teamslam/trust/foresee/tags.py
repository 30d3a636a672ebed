"""Where one more landmark would help most: people place tags, and should know where.

A landmark that robots see from poses X with Jacobians A (of X) and L (of itself, whitened rows) is an unknown too.
What its sightings tell of the rest is what is left of A across L, A~ = (1 - L L+) A, so that with the joint covariance
P of X

    gain = 1/2 log det(1 + A~ P A~')        sigma'^2 = f'P f - f'P A~' (1 + A~ P A~')^-1 A~ P f

as for a sighting of what is known already.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Dataset, Kind, Table, Values, is_landmark, is_pose, point_kind
from teamslam.solver import linearise_numerically
from teamslam.trust.foresee.foresee import Foreseen
from teamslam.trust.weak.eyes import Eye, eyes_of
from teamslam.trust.weak.gains import joint
from teamslam.trust.weak.words import place

MOST = 3
ACROSS = 12  # places that are tried along the longer side of where the team drives
UNKNOWNS = 6000  # of all poses: more would take the memory of a joint covariance


@dataclass(frozen=True, eq=False)
class Tag:
    """One more landmark `at` (dim,), seen `sightings` times by so many `robots`: `gain` [nats] about the rest of the
    map, `ties` ways in which parts hang loose, and each weak direction's sigma `before` and `after` it (k,)."""

    at: Array
    sightings: int
    robots: int
    gain: float
    ties: int
    before: Array
    after: Array
    sentence: str

    @property
    def firms(self) -> float:
        """By how much it firms up the weak directions: the sum of log(before / after)."""
        return float(np.sum(np.log(self.before / self.after)))


def place_next(foreseen: Foreseen, dataset: Dataset, most: int = MOST) -> tuple[Tag, ...]:
    """The places where one more landmark would help most, the best first.

    Tried on a grid over where the team drives, at the usual height of its landmarks; seen as far and as wide as the
    sensors see those that there are. The best by what it ties, then by how it firms up the weak directions, or where
    none stands out by its gain. Nothing where no sensor sees landmarks as points.
    """
    values = foreseen.values
    eyes = [eye for eye in eyes_of(dataset.tables, values) if not eye.sees_robots and not eye.like.row.targets_pose]
    poses = values.layout.keys[is_pose(values.layout.keys)]
    unknowns = values.layout.unknowns(np.sort(poses))
    if not eyes or len(unknowns) > UNKNOWNS:
        return ()
    weighing = _Weighing(foreseen, unknowns)
    found = [tag for at in _grid(values) if (tag := weighing.of(at, eyes)) is not None]
    return tuple(sorted(found, key=_rank)[:most])


def _rank(tag: Tag) -> tuple[float, ...]:
    return (-tag.ties, -round(tag.firms, 9), -round(tag.gain, 9), *tag.at.tolist())


def _grid(values: Values) -> Iterator[Array]:
    """Places (dim,) to try."""
    keys = values.layout.keys
    marks = values.layout.kinds >= Kind.POINT2
    dim = values.layout.kinds[marks].max(initial=Kind.POINT2)
    ways = values.positions(keys[is_pose(keys)], dim)
    low, high = ways.min(0), ways.max(0)
    usual = np.median(values.positions(keys[is_landmark(keys)], dim), 0) if is_landmark(keys).any() else low
    step = float((high - low)[:2].max()) / (ACROSS - 1) or 1.0
    for x in np.arange(low[0] - step, high[0] + 1.5 * step, step):
        for y in np.arange(low[1] - step, high[1] + 1.5 * step, step):
            yield np.concatenate([[x, y], usual[2:]])


class _Weighing:
    """What one more landmark brings, from the joint covariance of all poses."""

    def __init__(self, foreseen: Foreseen, unknowns: IntArray) -> None:
        self.foreseen, self.known = foreseen, foreseen.known
        self.layout = foreseen.values.layout
        self.covariance = joint(self.known, unknowns)
        self.place_of = np.full(self.layout.dof, -1)
        self.place_of[unknowns] = np.arange(len(unknowns))
        functions = [direction.hinge.function for direction in foreseen.weak.directions]
        F = np.stack(functions, 1) if functions else np.zeros((self.layout.dof, 0))
        self.spread = self.known.spread(F)
        self.before = np.sqrt(np.sum(F * self.spread, 0))
        self.key = int(self.layout.keys[is_landmark(self.layout.keys)].max(initial=-1)) + 1

    def of(self, at: Array, eyes: Sequence[Eye]) -> Tag | None:
        """A landmark at a place; None where nobody sees it twice, or it says nothing of the rest."""
        tables = self.tables(at, eyes)
        if sum(map(len, tables)) < 2:
            return None
        columns, A = self._of_the_rest(at, tables)
        here = self.place_of[columns]
        S = np.eye(len(A)) + A @ self.covariance[np.ix_(here, here)] @ A.T
        b = A @ self.spread[columns]
        after = np.sqrt(np.maximum(self.before**2 - np.sum(b * np.linalg.solve(S, b), 0), 0.0))
        gain = 0.5 * float(np.linalg.slogdet(S)[1])
        loose = A @ self.known.unknown[columns]
        scale = max(1.0, float(np.abs(A).max(initial=0.0)))
        ties = int(np.linalg.matrix_rank(loose / scale, tol=1e-6)) if loose.shape[1] else 0
        robots = len({table.robot for table in tables if len(table)})
        count = sum(map(len, tables))
        said = self._sentence(at, count, robots, gain, ties, after)
        return Tag(at, count, robots, gain, ties, self.before, after, said)

    def tables(self, at: Array, eyes: Sequence[Eye]) -> list[Table]:
        """The sightings of a landmark at a place, under a key of its own."""
        values = self.with_mark(at)
        out = []
        for eye in eyes:
            way = self.layout.keys[self.foreseen.way(eye.robot)]
            out.append(eye.sightings(np.stack([way, np.full(len(way), self.key)], -1), values))
        return [table for table in out if len(table)]

    def with_mark(self, at: Array) -> Values:
        """The plan with the landmark in it."""
        return self.foreseen.values.update(Values.of({point_kind(len(at)): (np.array([self.key]), at[None])}))

    def _of_the_rest(self, at: Array, tables: Sequence[Table]) -> tuple[IntArray, Array]:
        """The unknowns (c,) of the poses that see it, and the rows (r, c) of what its sightings tell of them."""
        values = self.with_mark(at)
        observers = np.unique(np.concatenate([table.keys[:, 0] for table in tables]))
        columns = self.layout.unknowns(observers)
        local = np.full(self.layout.dof, -1)
        local[columns] = np.arange(len(columns))
        rows, own = [], []
        for table in tables:
            for group in linearise_numerically(table, values):
                for row, J in zip(group.rows.tolist(), group.jacobian, strict=True):
                    mine = local[self.layout.unknowns(table.keys[row, :1])]
                    A = np.zeros((J.shape[0], len(columns)))
                    A[:, mine] = J[:, : len(mine)]
                    rows.append(A)
                    own.append(J[:, len(mine) :])
        A, L = np.concatenate(rows), np.concatenate(own)
        return columns, A - L @ (np.linalg.pinv(L) @ A)

    def _sentence(self, at: Array, count: int, robots: int, gain: float, ties: int, after: Array) -> str:
        text = f"One more landmark at {place(at)}, seen {count} times by {robots} robot{'s' * (robots > 1)}: "
        if ties:
            return text + f"would tie {ties} of {self.known.unknown.shape[1]} ways in which parts hang loose"
        if not len(after):
            return text + f"{gain:.2g} nats about the rest"
        best, directions = int(np.argmax(self.before / after)), self.foreseen.weak.directions
        return text + f"{self.before[best]:.2g} -> {after[best]:.2g} {directions[best].unit} of direction {best + 1}"


def added(dataset: Dataset, foreseen: Foreseen, tag: Tag) -> Dataset:
    """The plan with the landmark in it: its place as the truth, in the frame of the plan, and its sightings."""
    eyes = [e for e in eyes_of(dataset.tables, foreseen.values) if not e.sees_robots and not e.like.row.targets_pose]
    weighing = _Weighing(foreseen, foreseen.values.layout.unknowns(np.zeros(0, np.int64)))
    tables = [*dataset.tables, *weighing.tables(tag.at, eyes)]
    return replace(dataset, tables=tuple(tables), truth=weighing.with_mark(tag.at))
