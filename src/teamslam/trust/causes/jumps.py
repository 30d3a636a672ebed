"""Steps of odometry that contradict all else: a robot that was carried or held, a slip, a message that went missing.

One such row of hundreds of sigmas bends a map by least squares, and right sightings look wrong there. So the log is
solved once more under losses that forgive every row, Huber's first (its cost is convex in the residuals: there is no
false valley to stay in), then Cauchy's. A step is named where

    alone      without it, what all other rows say of it is T = u' S^-1 u from what it says, in its own noise and theirs
    its own    T stands out from the same number of the robot's other steps: noise that is stated too small names none
    fewest     with it in, and all else forgiven what it may be, sightings (each at most as a wrong one costs) and other
               steps cost so much more that this one fault is the likelier

each beyond doubt (see SURE), with the noise of each table widened by the median of its residuals. Where the data have
made the noise smaller than a log states it, a step within what was stated is the tail of its noise, and none. Where a
neighbour explains it as well, as no sighting tells between both, all of these are left out: nobody knows which it is.

Bound: nothing but residuals where no step stands out at the map; else two solves, and four for each of at
most MOST steps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.model import Dataset, Loss, Names, Submap, Table, Values, chi2_quantile, told_by
from teamslam.solver import Options, System, optimise
from teamslam.trust.cause import Cause
from teamslam.trust.causes.cut import Cut
from teamslam.trust.causes.firmly import Firmly
from teamslam.trust.residuals import beside_median

SURE = 1e-12  # by chance, of all steps of a log
OPEN = 1e-4  # by chance: what may as well be
STANDS_OUT = 30.0  # squared, over the noise of its table: from which a step is looked at
MOST = 8  # steps of a log, below which they may be single ones
SAMPLE = 40  # other steps of a robot, which tell how its own are off
FARTHEST = 30  # neighbours that may be it as well
WRONG = 20.0  # what a wrong sighting costs at most
FORGIVING = (Loss("huber", 2.0), Loss("cauchy", 3.0))
QUICK = Options(max_iterations=40, decrement=0.3, elsewhere=False)


@dataclass(frozen=True, eq=False)
class Jump:
    """Step `row` of table `at`, and all `steps` of it that may be it as well; how far off it is in squared sigmas
    (`size`, of `numbers`), by a shift [m] and a turn [rad] with their standard deviations."""

    at: int
    row: int
    steps: IntArray
    size: float
    numbers: int
    shift: tuple[float, float]
    turn: tuple[float, float]


def stands_out(table: Table, whitened: Array) -> bool:
    """Whether a step of odometry may have jumped, by the residuals of its table (m, r) at a map."""
    if not holds_steps(table):
        return False
    squared = np.sum(whitened**2, -1)
    return bool(squared.max() > STANDS_OUT * _noise(table, squared))


def holds_steps(table: Table) -> bool:
    """Whether a table holds relative poses of one robot alone."""
    return table.model == "relative_pose" and len(table) > 1 and bool(table.own.all())


def jumps(log: Dataset, joined: Submap, *, doubted: bool = False, stated: Sequence[Table] | None = None) -> list[Cause]:
    """The steps of odometry that contradict all else in a map, each with what leaves it out of a log. `doubted`: where
    sightings were left out of the map that are in the log, which may hide them. `stated`: the tables of the log with
    the noise that it states, where this has been put right."""
    values = point_of(joined)
    tables = told_by(log.tables, values.layout)
    if not doubted and not any(stands_out(table, table.whitened(values)) for table in tables if holds_steps(table)):
        return []
    try:
        found = _Search(tables, joined, values).found()
    except TeamslamError:
        return []
    found = [jump for jump in found if stated is None or not _as_stated(jump, tables[jump.at], stated)]
    before, after = _costs(tables, joined, values, found) if found else (0.0, 0.0)
    due = sum(table.dof for table in tables) - values.layout.dof
    explains = float(np.clip((before - after) / max(before - due, 1.0), 0.0, 1.0))
    return [_in_words(jump, tables[jump.at], log.names, explains) for jump in found]


# --- seeking ----------------------------------------------------------------------------------------------------------


class _Search:
    """Rows of a map under losses that forgive, and where these put it with what is `out` left out."""

    def __init__(self, tables: Sequence[Table], joined: Submap, values: Values) -> None:
        self.given, self.joined, self.start = tables, joined, values
        noise = [_noise(t, np.sum(t.whitened(values) ** 2, -1)) for t in tables]
        self.tables = [replace(t, whitening=t.whitening / np.sqrt(n)) for t, n in zip(tables, noise, strict=True)]
        self.steps = [_consecutive(t) if holds_steps(t) else np.zeros(len(t), bool) for t in tables]
        self.out = [np.zeros(len(t), bool) for t in tables]

    def found(self) -> list[Jump]:
        """The steps that jumped, those farthest off first: one by one, as one that is in bends all near it."""
        found: list[Jump] = []
        held = self._held(self.start)
        while len(found) < MOST:
            jumped = [jump for at in range(len(self.tables)) for jump in self._of(held, at) if not _among(jump, found)]
            if not jumped:
                break
            found.append(max(jumped, key=lambda jump: jump.size))
            self.out[found[-1].at][found[-1].row] = True
            held = self._held(held.there)
        else:
            return []  # so many single steps are no accident
        return self._likelier(
            [again for jump in found if (again := self._once_more(held, jump)) is not None], held.there
        )

    def _held(self, start: Values) -> "Firmly":
        """The rows where losses that forgive lead from a start, without what is out."""
        for loss in FORGIVING:
            system = self._system(loss)
            start = optimise(system, start, QUICK).values
        return Firmly(system, start, [1.0 - out for out in self.out])

    def _system(self, loss: Loss) -> System:
        under = [table.with_loss(loss) for table in self.tables]
        system = System(self.start.layout, tables=under, fixed=frame_of(self.joined), names=self.joined.names)
        for at, out in enumerate(self.out):
            if out.any():
                system.set_weights(at, 1.0 - out)
        return system

    def _of(self, held: "Firmly", at: int) -> Iterator[Jump]:
        """Steps of a table that are far from what all other rows say, beside the robot's other steps."""
        mine = np.flatnonzero(self.steps[at])
        if len(mine) < 2:
            return
        squared = np.sum(held.whitened[at] ** 2, -1)
        far = mine[(squared[mine] > STANDS_OUT / 2.0) & ~self.out[at][mine]]
        if len(far):
            own = self._own(held, at)
            far = far[np.argsort(-squared[far])][:MOST]
            yield from (jump for row in far.tolist() if (jump := self._judged(held, at, row, own)) is not None)

    def _once_more(self, held: "Firmly", jump: Jump) -> Jump | None:
        """A jump beside all others that were found; None where it is none any more."""
        return self._judged(held, jump.at, jump.row, self._own(held, jump.at))

    def _judged(self, held: "Firmly", at: int, row: int, own: float) -> Jump | None:
        numbers = self.tables[at].row.residual_rows(self.tables[at].dim)
        size, spread = next(held.sizes(at, np.array([row])))
        if _by_chance(size / own, numbers) * sum(map(np.count_nonzero, self.steps)) > SURE:
            return None
        return self._jump(held, at, row, self._as_well(held, at, row, own), size / own, spread)

    def _own(self, held: "Firmly", at: int) -> float:
        """By how much a robot's steps are farther off than stated, by the median and the tail of some."""
        mine = np.flatnonzero(self.steps[at] & ~self.out[at])
        some = mine[np.unique(np.linspace(0, len(mine) - 1, SAMPLE).astype(int))]
        return _beyond(
            [size for size, _ in held.sizes(at, some)], self.tables[at].row.residual_rows(self.tables[at].dim)
        )

    def _as_well(self, held: "Firmly", at: int, row: int, own: float) -> IntArray:
        """A step and its neighbours that may have jumped in its place."""
        table, numbers = self.tables[at], self.tables[at].row.residual_rows(self.tables[at].dim)
        order = np.flatnonzero(self.steps[at])[np.argsort(table.keys[self.steps[at]].min(1), kind="stable")]
        place, out = int(np.flatnonzero(order == row)[0]), [row]
        for way in (-1, 1):
            for far in range(1, FARTHEST):
                if not 0 <= place + way * far < len(order):
                    break
                other = int(order[place + way * far])
                if _by_chance(held.beside(at, row, other) / own, numbers) < OPEN:
                    break
                out.append(other)
        return np.sort(np.array(out))

    def _jump(self, held: "Firmly", at: int, row: int, steps: IntArray, size: float, spread: Array) -> Jump:
        table, d = self.given[at], self.given[at].dim
        error = table.select(np.array([row])).residual(held.there)[0]
        scaled = self.tables[at].whitening
        back = np.linalg.pinv(scaled[row if len(scaled) > 1 else 0])
        sigma = back @ spread @ back.T
        parts = [(float(np.linalg.norm(error[p])), _along(error[p], sigma[p, p])) for p in (slice(d), slice(d, None))]
        return Jump(at, row, steps, size, len(error), parts[0], parts[1])

    def _likelier(self, jumped: Sequence[Jump], there: Values) -> list[Jump]:
        """Those of which it is likelier that they jumped than that so much else is wrong as there must be if not."""
        rest = [t.select(~out) for t, out in zip(self.tables, self.out, strict=True) if not out.all()]
        cost, found = self._priced(rest, there), []
        for jump in jumped:
            one = self.tables[jump.at].select(jump.steps)
            least = min(self._with(rest, one, start) for start in (there, self.start))
            if _by_chance(least - cost, jump.numbers) * sum(map(np.count_nonzero, self.steps)) < SURE:
                found.append(jump)
        return found

    def _with(self, tables: Sequence[Table], one: Table, start: Values) -> float:
        """What all costs where a step, and those that may be it, are right."""
        firm = [*(t.with_loss(FORGIVING[-1]) for t in tables), one.with_loss(Loss())]
        try:
            there = optimise(System(start.layout, tables=firm, fixed=frame_of(self.joined)), start, QUICK).values
        except TeamslamError:
            return 0.0
        return self._priced(tables, there) + float(np.sum(one.whitened(there) ** 2))

    def _priced(self, tables: Sequence[Table], there: Values) -> float:
        """What rows cost of which each may be wrong: a sighting, and much less likely a step."""
        prices = [chi2_quantile(1.0 - SURE, t.row.residual_rows(t.dim)) if holds_steps(t) else WRONG for t in tables]
        squared = [np.sum(t.whitened(there) ** 2, -1) for t in tables]
        return sum(float(np.minimum(s, price).sum()) for s, price in zip(squared, prices, strict=True))


def _consecutive(table: Table) -> BoolArray:
    """Which rows (m,) lead from a pose to the next that any row of the table speaks of."""
    poses = np.unique(table.keys)
    ends = np.searchsorted(poses, table.keys)
    return np.asarray((np.abs(ends[:, 1] - ends[:, 0]) == 1) & (table.ranks == table.row.residual_rows(table.dim)))


def _noise(table: Table, squared: Array) -> float:
    """By how much the noise of rows is larger than stated, in variance, by the median."""
    return max(1.0, float(np.median(beside_median(squared, table.ranks))))


def _beyond(sizes: Sequence[float], numbers: int) -> float:
    """By how much chi-squares are larger than they should be, by their median and their tail."""
    if not len(sizes):
        return 1.0
    return max(1.0, *(float(np.quantile(sizes, share) / chi2_quantile(share, numbers)) for share in (0.5, 0.9)))


def _by_chance(size: float, numbers: int) -> float:
    """How often chi-square is so large."""
    from scipy.special import gammaincc

    return float(gammaincc(0.5 * numbers, 0.5 * max(size, 0.0)))


def _along(error: Array, covariance: Array) -> float:
    """The standard deviation of the length of an error."""
    way = error / max(float(np.linalg.norm(error)), 1e-300)
    return float(np.sqrt(max(float(way @ covariance @ way), 0.0)))


def _among(jump: Jump, found: Sequence[Jump]) -> bool:
    """Whether it is a step that may be one of those found."""
    return any(other.at == jump.at and jump.row in other.steps for other in found)


def _as_stated(jump: Jump, table: Table, stated: Sequence[Table]) -> bool:
    """Whether a jump is within the noise that was stated of its steps, by the largest share that this makes of it."""
    now = dict(zip(table.ids[jump.steps].tolist(), _each(table)[jump.steps], strict=True))
    shares = [
        float(np.linalg.norm(was @ np.linalg.pinv(now[row]), 2))
        for before in stated
        if (before.robot, before.kind) == (table.robot, table.kind)
        for row, was in zip(before.ids.tolist(), _each(before), strict=True)
        if row in now
    ]
    return bool(shares) and jump.size * max(shares) ** 2 < STANDS_OUT


def _each(table: Table) -> Array:
    """The whitening of each row (m, r, r)."""
    return np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))


def _costs(tables: Sequence[Table], joined: Submap, values: Values, found: Sequence[Jump]) -> tuple[float, float]:
    """What the rows cost at the map, and solved without the steps found, by their own losses."""
    system = System(values.layout, tables=tables, fixed=frame_of(joined))
    kept = [np.ones(len(table), bool) for table in tables]
    for jump in found:
        kept[jump.at][jump.row] = False
    rest = [table.select(mask) for table, mask in zip(tables, kept, strict=True) if mask.any()]
    try:
        return system.cost(values), optimise(
            System(values.layout, tables=rest, fixed=frame_of(joined)), values, QUICK
        ).cost
    except TeamslamError:
        return system.cost(values), system.cost(values)


# --- telling ----------------------------------------------------------------------------------------------------------


def _in_words(jump: Jump, table: Table, names: Names, explains: float) -> Cause:
    """Whose step it is, when, and how far off."""
    keys, robot, count = table.keys[jump.steps], names.robot(table.robot), len(jump.steps)
    first, last = (_when(int(key), names) for key in (keys.min(), keys.max()))
    (shift, of_shift), (turn, of_turn) = jump.shift, np.degrees(jump.turn)
    chance = _by_chance(jump.size, jump.numbers)
    sure = "less than 1e-99" if chance < 1e-99 else f"{chance:.1g}"
    off = (
        f"off by {shift:.3g} m +- {of_shift:.2g} m and {turn:.3g} degrees +- {of_turn:.2g} degrees from where all "
        f"else has it, {np.sqrt(jump.size):,.0f} sigmas (by chance in {sure} of steps): the robot slipped or was "
        f"carried, or what it drove is not in the log"
    )
    when = f"{table.source} from {first} to {last}"
    between = np.unique(keys)[1:-1]
    said = f"robot {robot}, {when}: {'this step is' if count == 1 else f'one of these {count} steps is'} {off}"
    which = "" if count == 1 else f"one of {count} steps, and nothing tells which nor where the poses between are, is "
    reason = f"{which}{off}; the log is cut there"
    cut = Cut(table.robot, table.source, table.ids[jump.steps], between, f"robot {robot}, {when}", reason)
    return Cause("jump", said, explains, (table.robot,), cut)


def _when(key: int, names: Names) -> str:
    """A pose's moment in words."""
    return names.describe(key).rpartition(" at ")[2]
