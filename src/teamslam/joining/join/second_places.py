"""What a map cannot know of where a landmark is: ranges that fit at two places, in words.

Where a landmark was measured in the world as well, and the map is written there, that has a say in which it is.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.joining.start.twofold import RULED_OUT, Twofold, twofold
from teamslam.model import WORLD, Names, Submap, Table, Values
from teamslam.solver import SAME, System, optimise

NAMED = 3  # landmarks with a second place that get a sentence of their own


def second_places(whole: Submap, tables: Sequence[Table]) -> list[Twofold]:
    """The landmarks of a map that their sightings in `tables` put at another place as well, with all poses where they
    are."""
    found = twofold(whole.all_values, tables)
    return [_as_surveyed(two, whole.values, tables) for two in found] if whole.base == WORLD else found


def _as_surveyed(two: Twofold, values: Values, tables: Sequence[Table]) -> Twofold:
    """The same once rows of the world that tell where a landmark is are asked, too: the other place is where it comes
    to lie from there, all poses held, and none where that is where it is."""
    unary = [table.keys[:, 0] for table in tables if table.row.unary]
    told = np.isin(two.keys, np.concatenate([np.zeros(0, np.int64), *unary]))
    if not told.any():
        return two
    some = two.select(told)
    rows = [t.select(np.isin(t.keys[:, -1], some.keys) & np.asarray(t.told_by(values.layout))) for t in tables]
    rows = [t for t in rows if len(t)]
    seers = np.unique(np.concatenate([t.keys[:, 0] for t in rows if not t.row.unary]))
    here = values.only(np.union1d(some.keys, seers))
    there = here.update(Values.of({some.kind: (some.keys, some.others)}))
    with suppress(SolveError):  # else it stays where it fits by what sees it, at no less than that costs
        there = optimise(System(there.layout, tables=rows, fixed=seers), there).values
    places = there.positions(some.keys, some.kind.dim)
    own = here.positions(some.keys, some.kind.dim)
    more = _costs(rows, there, some) - _costs(rows, here, some)
    elsewhere = np.linalg.norm(places - some.others, axis=-1) < np.linalg.norm(places - own, axis=-1)
    plane = some.by_nature & (np.abs(more) < SAME * (1.0 + _costs(rows, here, some)))
    others, mores, nature = two.others.copy(), two.more.copy(), two.by_nature.copy()
    others[told], mores[told], nature[told] = places, np.where(elsewhere, more, np.inf), plane
    return replace(two, others=others, more=mores, by_nature=nature)


def _costs(rows: Sequence[Table], values: Values, two: Twofold) -> Array:
    """What the rows of each landmark cost (m,)."""
    cost = np.zeros(len(two.keys))
    for table in rows:
        squared = np.sum(table.whitened(values) ** 2, -1)
        np.add.at(cost, np.searchsorted(two.keys, table.keys[:, -1]), table.loss.cost(squared))
    return cost


def undecided(found: Sequence[Twofold]) -> list[tuple[int, Array]]:
    """The landmarks whose other place is not ruled out, cheapest first, by key, and that place. What robots of a plane
    put above or below it is not among them."""
    return [(int(two.keys[n]), two.others[n]) for two, n in _close(found)]


def sentences(whole: Submap, found: Sequence[Twofold]) -> Iterator[str]:
    """What is to be known of them, cheapest first. What robots that cannot leave a plane put above or below it is one
    sentence."""
    names = whole.names
    for two in found:
        above = _here(whole, two)[:, -1] > two.others[:, -1]
        for side, there in (("above", above), ("below", ~above)):
            if keys := two.keys[two.by_nature & there].tolist():
                yield (
                    f"{_listed(names, keys)}: ranges from robots of a plane leave open on which side of it, and the "
                    f"map says {side}"
                )
    close = _close(found)
    for two, n in close[:NAMED]:
        more = float(two.more[n])
        costs = f"for at most {more:.2g} more of cost" if more > 0.0 else "for no more of cost"
        yield (
            f"ambiguous: {names.describe(int(two.keys[n]))} is at {_place(_here(whole, two)[n])} or at "
            f"{_place(two.others[n])}, {costs}: its ranges come from nearly one line (in space: one plane); one from "
            f"the side would tell"
        )
    if len(close) > NAMED:
        yield f"ambiguous in the same way: {_listed(names, [int(two.keys[n]) for two, n in close[NAMED:]])}"


def _close(found: Sequence[Twofold]) -> list[tuple[Twofold, int]]:
    """Which of them could be at either place."""
    close = [(two, n) for two in found for n in np.flatnonzero(~two.by_nature & (two.more < RULED_OUT)).tolist()]
    return sorted(close, key=lambda entry: float(entry[0].more[entry[1]]))


def _here(whole: Submap, two: Twofold) -> Array:
    return whole.values.positions(two.keys, two.kind.dim)


def _place(position: Array) -> str:
    return f"({', '.join(f'{number:.2f}' for number in position)})"


def _listed(names: Names, keys: Sequence[int]) -> str:
    shown = [names.describe(key) for key in keys[:NAMED]]
    return ", ".join(shown) + (f" and {len(keys) - NAMED} others" if len(keys) > NAMED else "")
