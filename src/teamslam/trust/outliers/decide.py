"""Which sightings are wrong: decided by each robot alone, and again with the team's evidence.

    alone      of each robot's sightings of a landmark the largest set that agrees along its odometry (`agreement`)
    elect      where other sets agree among themselves too, the one that the other robots agree with (`vote`)
    together   the pieces without what was rejected are built and joined; from the joined map graduated non-convexity
               over all sightings of all robots, the rejected ones among them, with gates (`gates`) that know by now
               how many are wrong and how large the noise is

A robot that took a ghost for a landmark, because most of its sightings agreed on it, is outvoted by the others; one
that rejected a right sighting gets it back. A landmark of which nothing would be left is given to the robot that saw
it most often, by its own evidence, and decided on again from there. Odometry is trusted. What comes out is a mask of
rows: the map is then made of the rest as if the others had never been, so its covariances count only what was kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import Joined, build, join, split
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.model import SQUARED, Dataset, Loss, Names, Submap, Table, Values, is_landmark
from teamslam.model.keys import twin_key
from teamslam.solver import Options, System, optimise_graduated
from teamslam.trust.outliers.agreement import NONE, agreeing
from teamslam.trust.outliers.gates import gates, noise_of, share_wrong
from teamslam.trust.outliers.vote import Candidates, elected

QUICK = Options(max_iterations=60, decrement=1e-2)
LINKS = Loss("cauchy", 2.0)  # of sightings of robots, while it is unknown which are wrong: such travel raw to the join
ROUNDS = 3  # of decisions with the team's evidence
AGAIN = 2  # times that gates follow what was found by them


@dataclass(frozen=True, eq=False)
class Sensor:
    """What is known of a robot's sightings of one source: the share that is `wrong`, and by how much the `noise` of the
    others is larger than stated, in variance; `which` are wrong by their keys (rejected, 2 or 1)."""

    robot: int
    source: str
    rows: int
    rejected: int
    wrong: float
    noise: float
    which: IntArray = field(repr=False)


@dataclass(frozen=True)
class Open:
    """A landmark that may be in two places for a robot, by so many sightings of each; nobody else could decide, and the
    place with more of them was taken. Where `larger` is 1, one sighting of it is believed, and all others, each of
    another place, are not."""

    robot: int
    mark: int
    larger: int
    smaller: int


@dataclass(frozen=True, eq=False)
class Decisions:
    """For each table of a log which rows are right (`inliers`, masks (m,)), their squared residuals at the end and the
    `gates` on them, and what that says of each sensor. `open` are landmarks of which a robot's sightings agree on two
    places; `undecided` counts rows in no map, of which nothing is known."""

    inliers: tuple[BoolArray, ...]
    squared: tuple[Array, ...]
    gates: tuple[Array, ...]
    sensors: tuple[Sensor, ...]
    open: tuple[Open, ...]
    undecided: int
    names: Names

    @property
    def rejected(self) -> int:
        """How many rows are wrong."""
        return sum(int((~mask).sum()) for mask in self.inliers)

    def kept(self, log: Dataset) -> Dataset:
        """The log without the wrong rows. Law: a log of which none is wrong comes back as it is."""
        if not self.rejected:
            return log
        kept = [table.select(mask) for table, mask in zip(log.tables, self.inliers, strict=True)]
        return log.with_tables(table for table in kept if len(table))

    def without_scattered(self, log: Dataset) -> Dataset:
        """The log without wrong rows of sensors of which most rows are right: of others it is the sensor that lies."""
        kept = []
        for table, mask in zip(log.tables, self.inliers, strict=True):
            of = [s for s in self.sensors if (s.robot, s.source) == (table.robot, table.source)]
            most = 2 * sum(s.rejected for s in of) < sum(s.rows for s in of)
            kept.append(table.select(mask) if most else table)
        return log.with_tables(table for table in kept if len(table))


def wrong_sightings(log: Dataset, *, probability: float | None = None) -> Decisions:
    """Which sightings of a team's log are wrong. `probability`: that a sighting is; None: by the data.

    Rows whose variables no map holds are taken for right. Raises SolveError where nothing can be mapped at all.
    """
    log = log.with_tables(t if t.source == "odometry" else t.with_loss(SQUARED) for t in log.tables)
    alone, open_ = _alone(log)
    masks = alone
    sensors: tuple[Sensor, ...] = ()
    ends = tuple(np.full(len(t), np.nan) for t in log.tables)
    gates_ = ends
    for _ in range(ROUNDS):
        joined = _joined(log, masks)
        before = masks
        masks, ends, gates_, sensors = _together(log, joined, masks, probability)
        masks = _with_lost_ones(log, masks, alone)
        if all(np.array_equal(a, b) for a, b in zip(before, masks, strict=True)):
            break
    unknown = sum(int(np.isnan(s).sum()) for s, t in zip(ends, log.tables, strict=True) if t.source != "odometry")
    alone_believed = _believed_alone(log, masks)
    told = {place.mark for place in alone_believed}
    open_ = (*(place for place in open_ if place.mark not in told), *alone_believed)
    return Decisions(masks, ends, gates_, sensors, open_, unknown, log.names)


# --- each robot alone -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Piece:
    """A robot's odometry and landmarks: the `sets` that its rows are in, the landmarks' `names` by the key that each
    set of sightings has in the `submap` that holds all sets, each as a landmark of its own."""

    log: Dataset
    sets: list[IntArray]
    names: dict[int, tuple[int, int]]
    submap: Submap | None

    @classmethod
    def of(cls, piece: Dataset) -> "_Piece":
        own = [t.select(is_landmark(t.keys[:, -1]) | (t.source == "odometry")) for t in piece.tables]
        log = piece.with_tables(t for t in own if len(t))
        robot = piece.tables[0].robot
        try:
            sets = agreeing(log, robot, dead_reckoning(log, robot))
        except TeamslamError:
            return cls(log, [np.zeros(len(t), np.int64) for t in log.tables], {}, None)
        tables, names = [], {}
        for table, of in zip(log.tables, sets, strict=True):
            keys = table.keys.copy()
            for mark in np.unique(keys[is_landmark(keys[:, -1]), -1]).tolist():
                for number in np.unique(of[(table.keys[:, -1] == mark) & (of > NONE)]).tolist():
                    key = mark if number == 0 else twin_key(mark, f"set {number}")
                    names[key] = (mark, number)
                    keys[(table.keys[:, -1] == mark) & (of == number), -1] = key
            tables.append(replace(table, keys=keys).select(of > NONE))
        try:
            submap = build(log.with_tables(t for t in tables if len(t)), options=QUICK)
        except TeamslamError:
            submap = None
        return cls(log, sets, names, submap)

    @property
    def candidates(self) -> Candidates:
        """What the team may choose from."""
        assert self.submap is not None
        counts: dict[int, int] = dict.fromkeys(self.names, 0)
        for table, of in zip(self.log.tables, self.sets, strict=True):
            for key, (mark, number) in self.names.items():
                counts[key] += int(((table.keys[:, -1] == mark) & (of == number)).sum())
        return Candidates.of(self.submap, self.names, counts)

    def kept(self, chosen: dict[int, int]) -> list[BoolArray]:
        """The rows of the sets that were chosen, and those that are in no choice."""
        masks = []
        for table, of in zip(self.log.tables, self.sets, strict=True):
            target = table.keys[:, -1]
            want = np.array([chosen.get(key, 0) for key in target.tolist()], np.int64)
            masks.append(np.asarray(~is_landmark(target) | (of == want)))
        return masks


def _alone(log: Dataset) -> tuple[tuple[BoolArray, ...], tuple[Open, ...]]:
    """Masks by each robot's own evidence on its landmarks, and by an election among these; sightings of robots stay
    open."""
    pieces = [_Piece.of(piece) for piece in split(log)]
    known = [n for n, piece in enumerate(pieces) if piece.submap is not None and piece.names]
    votes, close = elected([pieces[n].candidates for n in known]) if known else ([], [])
    chosen = dict(zip(known, votes, strict=True))
    open_ = tuple(Open(pieces[known[u.piece]].log.tables[0].robot, u.mark, u.larger, u.smaller) for u in close)
    masks = [np.ones(len(table), bool) for table in log.tables]
    for n, piece in enumerate(pieces):
        for table, kept in zip(piece.log.tables, piece.kept(chosen.get(n, {})), strict=True):
            for mask, whole in zip(masks, log.tables, strict=True):
                if _same_sensor(whole, table):
                    mask[np.isin(whole.ids, table.ids[~kept])] = False
    return tuple(masks), open_


def _same_sensor(one: Table, other: Table) -> bool:
    return (one.robot, one.kind) == (other.robot, other.kind)


def _graduated(
    tables: Sequence[Table], around: Submap, first: Sequence[BoolArray], probability: float | None
) -> tuple[list[BoolArray], list[Array], list[Array], list[Sensor]]:
    """Decisions on the rows of some tables from a map nearby: masks, squared residuals, gates, sensors. Rows that name
    variables outside of it stay as they are, with residuals that are not a number."""
    values = point_of(around)
    there = [np.asarray(values.layout.contains(t.keys).all(1)) for t in tables]
    used = [n for n, rows in enumerate(there) if rows.any()]
    held = [tables[n].select(there[n]) for n in used]
    system = System(values.layout, tables=held, fixed=frame_of(around), names=around.names)
    suspects = [place for place, table in enumerate(held) if table.source != "odometry"]
    inliers = {place: first[used[place]][there[used[place]]] for place in suspects}
    squared, sensors, limits = _weighed(system, values, inliers, probability)
    for _ in range(AGAIN):
        found = optimise_graduated(system, values, suspects, gates=limits, first=inliers, options=QUICK)
        values, inliers = found.solution.values, {place: found.inliers[place] for place in suspects}
        squared, sensors, limits = _weighed(system, values, inliers, probability)
    masks = [np.array(mask) for mask in first]
    ends, at = ([np.full(len(table), np.nan) for table in tables] for _ in range(2))
    for place in suspects:
        n = used[place]
        masks[n][there[n]] = squared[place] <= limits[place]
        ends[n][there[n]], at[n][there[n]] = squared[place], limits[place]
    return masks, ends, at, list(sensors.values())


def _weighed(
    system: System, values: Values, inliers: dict[int, BoolArray], probability: float | None
) -> tuple[dict[int, Array], dict[int, "Sensor"], dict[int, Array]]:
    """Squared residuals of the suspects at some values, what they say of each sensor, and the gates of that."""
    squared = {n: np.sum(system.whitened(n, values) ** 2, -1) for n in inliers}
    sensors = {n: _sensor(system.tables[n], inliers[n], squared[n], probability) for n in inliers}
    limits = {n: gates(system.tables[n], sensors[n].wrong, sensors[n].noise) for n in inliers}
    return squared, sensors, limits


def _sensor(table: Table, inliers: BoolArray, squared: Array, probability: float | None) -> Sensor:
    rejected = int((~inliers).sum())
    wrong = share_wrong(rejected, len(table)) if probability is None else probability
    noise = noise_of(squared, table.ranks, rejected / len(table))
    return Sensor(table.robot, table.source, len(table), rejected, wrong, noise, table.keys[~inliers])


# --- the team ---------------------------------------------------------------------------------------------------------


def _with_lost_ones(log: Dataset, masks: Sequence[BoolArray], alone: Sequence[BoolArray]) -> tuple[BoolArray, ...]:
    """Masks that leave of every landmark something: of one that lost all of its rows those that were right by the robot
    `alone` that has most of them."""
    target = [np.where(is_landmark(table.keys[:, -1]), table.keys[:, -1], NONE) for table in log.tables]
    kept = np.unique(np.concatenate([keys[mask] for keys, mask in zip(target, masks, strict=True)]))
    found = [np.array(mask) for mask in masks]
    for mark in np.setdiff1d(np.unique(np.concatenate(target)), kept).tolist():
        votes: dict[int, int] = {}
        for table, keys, own in zip(log.tables, target, alone, strict=True):
            votes[table.robot] = votes.get(table.robot, 0) + int((own & (keys == mark)).sum())
        most = max(votes, key=lambda robot: (votes[robot], -robot))
        for n, table in enumerate(log.tables):
            if table.robot == most:
                found[n] |= alone[n] & (target[n] == mark)
    return tuple(found)


def _believed_alone(log: Dataset, masks: Sequence[BoolArray]) -> tuple[Open, ...]:
    """Landmarks of which one sighting is believed and others are not: that it is left is all that speaks for it."""
    seen = [t.keys[:, -1] for t in log.tables]
    robots = np.concatenate([np.full(len(t), t.robot) for t in log.tables])
    target, right = np.concatenate(seen), np.concatenate(masks)
    found = []
    for mark in np.unique(target[is_landmark(target) & ~right]).tolist():
        believed = (target == mark) & right
        if np.count_nonzero(believed) == 1:
            found.append(Open(int(robots[believed][0]), mark, 1, int(np.sum((target == mark) & ~right))))
    return tuple(found)


def _joined(log: Dataset, masks: Sequence[BoolArray]) -> Joined:
    """The map of what is taken for right so far; sightings of robots are under a loss that outvotes the wrong ones."""
    kept = [table.select(mask) for table, mask in zip(log.tables, masks, strict=True)]
    kept = [t.with_loss(LINKS) if t.source != "odometry" and t.observes_robots else t for t in kept if len(t)]
    return join([build(piece, options=QUICK) for piece in split(log.with_tables(kept))], options=QUICK)


def _together(
    log: Dataset, joined: Joined, masks: Sequence[BoolArray], probability: float | None
) -> tuple[tuple[BoolArray, ...], tuple[Array, ...], tuple[Array, ...], tuple[Sensor, ...]]:
    """Decisions with the team's evidence, component by component."""
    masks, sensors = list(masks), []
    ends, at = ([np.full(len(t), np.nan) for t in log.tables] for _ in range(2))
    for component in joined.components:
        again, squared, limits, known = _graduated(log.tables, component.map, masks, probability)
        sensors += known
        for n, s in enumerate(squared):
            here = ~np.isnan(s)
            masks[n] = np.where(here, again[n], masks[n])
            ends[n], at[n] = np.where(here, s, ends[n]), np.where(here, limits[n], at[n])
    return tuple(masks), tuple(ends), tuple(at), tuple(sensors)
