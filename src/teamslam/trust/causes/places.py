"""Landmarks in two places: one that was moved, two that carry one name, or that a robot calls by another's.

The rows of a landmark that costs too much are divided in two, and each half is given a place of its own: by who saw it
and by when at first, then each row goes to the place that fits it better until none changes sides. Two places are told
where both halves are consistent in themselves, which outliers are not, and most of the landmark's excess is gone once
the team's map is solved with both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, BoolArray
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.model import Dataset, Names, Submap, Table, Values, index_of, told_by
from teamslam.model.keys import twin_key
from teamslam.solver import Options, System, firm, optimise
from teamslam.trust.cause import Cause
from teamslam.trust.causes.apart import Apart
from teamslam.trust.residuals import Rows, beside_median
from teamslam.trust.tally import by_landmark

SUSPECT, EXCESS = 3.0, 50.0  # times the expected cost, and how much above it, from which a landmark is looked at
MOST = 5  # landmarks are looked at, and two more for each that is found
FEWEST = 6  # rows in each of two places
CLEAN = 4.0  # times the median of chi-square: what rows that belong together stay below
FAR = (
    25.0  # times the median of chi-square, and of how far rows are from their own place: how far they are from another
)
EXPLAINED = 0.5  # of the landmark's excess
CUTS = 8  # of the time, to begin with
ROUNDS, AGAIN = 10, 3
QUICK = Options(max_iterations=15, decrement=0.1)


@dataclass(frozen=True, eq=False)
class Split:
    """A landmark and which of its rows (of each table) belong to another place; where both places are."""

    mark: int
    other: int
    second: tuple[BoolArray, ...]
    places: tuple[Array, Array]

    @property
    def apart(self) -> float:
        """How far the two places are from each other [m]."""
        return float(np.linalg.norm(self.places[0] - self.places[1]))


def two_places(log: Dataset, joined: Submap, rows: Sequence[Rows], *, all_of_it: bool = False) -> list[Cause]:
    """The landmarks of a map that are in two places, in words; `rows` are the residuals at it. Where they must be the
    reason for `all_of_it`, none is told unless most of the whole map's excess is gone with them.

    They are sought one by one, the worst first, and what is found is taken out before the next: a landmark that is in
    two places pulls its neighbours apart, so that these are looked at again without it.
    """
    tally = by_landmark(rows)
    expected = dict(zip(tally.labels.tolist(), np.maximum(tally.expected, 1.0).tolist(), strict=True))
    values = point_of(joined)
    tables = told_by(log.tables, values.layout)
    found: list[Cause] = []
    tried: set[int] = set()
    before = _cost(tables, values)
    looks = 0
    while looks < MOST + 2 * len(found):
        excess = {mark: _cost(_of([mark], tables), values) - due for mark, due in expected.items()}
        bad = [m for m, e in excess.items() if m not in tried and e > EXCESS and e > (SUSPECT - 1.0) * expected[m]]
        if not bad:
            break
        mark = max(bad, key=lambda m: excess[m])
        tried.add(mark)
        looks += 1
        split = _divided(tables, values, mark)
        settled = _in_both(split, values, tables, joined) if split is not None else None
        if settled is None:
            continue
        split, solved = settled[0], settled[1:]
        gone = excess[mark] + expected[mark] - _cost(_of([mark, split.other], solved[1]), solved[0])
        if gone > EXPLAINED * excess[mark] and _apart(split, *solved):
            where = solved[0].positions(np.array([mark, split.other]), 3)
            split = replace(split, places=(where[0], where[1]))
            found.append(_in_words(split, tables, log.names, min(gone / excess[mark], 1.0)))
            values, tables = solved
            tried = {mark}
    due = sum(float(row.expected.sum()) for row in rows)
    explained = before - _cost(tables, values) > EXPLAINED * (before - due)
    return found if explained or not all_of_it else []


# --- dividing ---------------------------------------------------------------------------------------------------------


def _divided(tables: Sequence[Table], values: Values, mark: int) -> Split | None:
    """The best division of a landmark's rows into two consistent halves; None where there is none."""
    mine = [table.select(table.keys[:, -1] == mark) for table in tables]
    best: tuple[float, list[BoolArray]] | None = None
    for second in _beginnings(mine):
        found = _settled(mine, values, mark, second)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    if best is None:
        return None
    second = best[1]
    halves = [[t.select(s == side) for t, s in zip(mine, second, strict=True)] for side in (False, True)]
    placed = [p for half in halves if (p := _placed(half, values, mark)) is not None]
    if len(placed) < 2:
        return None
    where = [p.positions(np.array([mark]), 3)[0] for p in placed]
    whole = []
    for table, own in zip(tables, second, strict=True):
        mask = np.zeros(len(table), bool)
        mask[table.keys[:, -1] == mark] = own
        whole.append(mask)
    return Split(mark, twin_key(mark, "at another place"), tuple(whole), (where[0], where[1]))


def _beginnings(mine: Sequence[Table]) -> Iterator[list[BoolArray]]:
    """Divisions to begin with: each robot against the others, and before against after."""
    robots = sorted({table.robot for table in mine if len(table)})
    if len(robots) > 1:
        yield from ([np.full(len(t), t.robot == robot) for t in mine] for robot in robots)
    when = [index_of(table.keys[:, 0]) for table in mine]
    cuts = np.quantile(np.concatenate(when), np.linspace(0.0, 1.0, CUTS + 2)[1:-1])
    yield from ([w > cut for w in when] for cut in cuts)


def _settled(
    mine: Sequence[Table], values: Values, mark: int, second: list[BoolArray]
) -> tuple[float, list[BoolArray]] | None:
    """Rows go to the better place until none changes sides: the cost then, and which are in the second."""
    cost = np.inf
    for _ in range(ROUNDS):
        halves = [[t.select(s == side) for t, s in zip(mine, second, strict=True)] for side in (False, True)]
        if min(sum(map(len, half)) for half in halves) < FEWEST:
            return None
        placed = [_placed(half, values, mark) for half in halves]
        if placed[0] is None or placed[1] is None:
            return None
        one, other = ([t.loss.cost(np.sum(t.whitened(p) ** 2, -1)) for t in mine] for p in placed if p is not None)
        again = [np.asarray(b < a) for a, b in zip(one, other, strict=True)]
        cost = sum(float(np.minimum(a, b).sum()) for a, b in zip(one, other, strict=True))
        if all(np.array_equal(a, b) for a, b in zip(again, second, strict=True)):
            break
        second = again
    return cost, second


def _placed(half: Sequence[Table], values: Values, mark: int) -> Values | None:
    """The map with the landmark where some rows alone put it, all else held; None where they do not say."""
    held = [table for table in half if len(table)]
    keys = np.unique(np.concatenate([table.keys.ravel() for table in held]))
    near = values.only(keys)
    try:
        system = System(near.layout, tables=held, fixed=keys[keys != mark])
        return values.update(firm(system, optimise(system, near, QUICK)).values)
    except TeamslamError:
        return None


def _apart(split: Split, values: Values, tables: Sequence[Table]) -> bool:
    """Whether the rows of both places belong together and nowhere else: half of them are no farther off from their
    place than CLEAN allows, and the other place is FAR from them, in sigmas and in how they scatter."""
    swapped = {split.mark: split.other, split.other: split.mark}
    for mark, other in swapped.items():
        mine = _of([mark], tables)
        own = float(np.median(_sizes(mine, values)))
        far = float(np.median(_sizes([_renamed(t, np.ones(len(t), bool), other) for t in mine], values)))
        if own > CLEAN or far < FAR * max(own, 1.0):
            return False
    return True


def _sizes(tables: Sequence[Table], values: Values) -> Array:
    """Squared residuals over what their median should be."""
    held = [table for table in tables if len(table)]
    return np.concatenate([beside_median(np.sum(t.whitened(values) ** 2, -1), t.ranks) for t in held])


# --- telling ----------------------------------------------------------------------------------------------------------


def _in_both(
    split: Split, values: Values, tables: Sequence[Table], joined: Submap
) -> tuple[Split, Values, list[Table]] | None:
    """The map with a landmark in both its places, and each row with the place that fits it better there: one that the
    landmark bent no longer misleads them. None where that cannot be solved."""
    found = None
    for _ in range(AGAIN):
        solved = _solved(split, values, tables, joined)
        if solved is None:
            return found
        found = split, *solved
        better = [_second(table, solved[0], split) for table in tables]
        if all(np.array_equal(a, b) for a, b in zip(better, split.second, strict=True)):
            break
        if min(sum(int(np.count_nonzero(m)) for m in side) for side in _sides(tables, better, split.mark)) < FEWEST:
            break
        split = replace(split, second=tuple(better))
    return found


def _second(table: Table, values: Values, split: Split) -> BoolArray:
    """Which rows of a table are of the landmark, and nearer to its second place."""
    out = table.keys[:, -1] == split.mark
    mine = table.select(out)
    if len(mine):
        one, other = (
            mine.loss.cost(np.sum(t.whitened(values) ** 2, -1))
            for t in (mine, _renamed(mine, np.ones(len(mine), bool), split.other))
        )
        out[out] = other < one
    return np.asarray(out)


def _sides(tables: Sequence[Table], second: Sequence[BoolArray], mark: int) -> tuple[list[BoolArray], list[BoolArray]]:
    own = [table.keys[:, -1] == mark for table in tables]
    return [o & ~s for o, s in zip(own, second, strict=True)], [o & s for o, s in zip(own, second, strict=True)]


def _solved(split: Split, values: Values, tables: Sequence[Table], joined: Submap) -> tuple[Values, list[Table]] | None:
    """The map with a landmark in both its places, and the tables that name both; None where that cannot be solved."""
    renamed = [_renamed(table, second, split.other) for table, second in zip(tables, split.second, strict=True)]
    start = values.update(_twin(values, split))
    try:
        system = System(start.layout, tables=renamed, fixed=frame_of(joined), names=joined.names)
        return firm(system, optimise(system, start, QUICK)).values, renamed
    except TeamslamError:
        return None


def _of(marks: Sequence[int], tables: Sequence[Table]) -> list[Table]:
    """The rows on some landmarks."""
    return [table.select(np.isin(table.keys[:, -1], marks)) for table in tables]


def _renamed(table: Table, second: BoolArray, other: int) -> Table:
    keys = table.keys.copy()
    keys[second, -1] = other
    return replace(table, keys=keys)


def _twin(values: Values, split: Split) -> Values:
    """The landmark once more, under its other name, where its second place is."""
    one = values.only(np.array([split.mark]))
    state = one.state.copy()
    kind = one.layout.kinds[0]
    d = 2 + int(kind) % 2
    state[:d] = split.places[1][:d]
    return Values(type(one.layout)(np.array([split.other]), one.layout.kinds), state)


def _cost(tables: Sequence[Table], values: Values) -> float:
    return sum(table.cost(values) for table in tables)


def _in_words(split: Split, tables: Sequence[Table], names: Names, explains: float) -> Cause:
    """By whom or when the one place and the other was seen."""
    mark, apart = f"landmark {names.landmark(int(index_of(split.mark)))}", f"{split.apart:.2f} m"
    seen = [(t.robot, second[t.keys[:, -1] == split.mark]) for t, second in zip(tables, split.second, strict=True)]
    sides = {
        robot: np.concatenate([s for r, s in seen if r == robot]) for robot in sorted({r for r, s in seen if len(s)})
    }
    share = {robot: float(side.mean()) for robot, side in sides.items()}
    odd = [robot for robot, part in share.items() if part > 0.95]
    rest = [robot for robot, part in share.items() if part < 0.05]
    if len(share) > 1 and odd and rest and len(odd) + len(rest) == len(share):
        few = min(odd, rest, key=len)
        who = " and ".join(names.robot(robot) for robot in few)
        said = f"robot {who} sees {mark} {apart} from where the others do: another landmark, or one that was moved"
        return Cause("landmark", said, explains, tuple(few))
    when = [names.stamps_s(t.keys[t.keys[:, -1] == split.mark, 0]) for t in tables]
    at, side = np.concatenate(when), np.concatenate([s for _, s in seen])
    first, second = at[~side], at[side]
    if first.max() < second.min() or second.max() < first.min():
        moved = 0.5 * (min(first.max(), second.max()) + max(first.min(), second.min()))
        start = min(float(w.min()) for w in (names.stamps_s(t.keys[:, 0]) for t in tables if len(t)))
        moment = f"pose {moved:.0f}" if names.counts else f"{moved - start:.1f} s after the start"
        said = f"{mark} was moved by {apart} at about {moment}"
    else:
        said = f"two landmarks {apart} apart are both called {mark}"
    mend = Apart.of(split.mark, tables, split.second, earlier=bool(first.min() < second.min()))
    return Cause("landmark", said, explains, tuple(share), mend)
