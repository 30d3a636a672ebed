"""What a map cannot know of where a landmark is: ranges that fit at two places, in words."""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.geometry import Array
from teamslam.joining.start.twofold import RULED_OUT, Twofold, twofold
from teamslam.model import Names, Submap, Table

NAMED = 3  # landmarks with a second place that get a sentence of their own


def second_places(whole: Submap, tables: Sequence[Table]) -> list[Twofold]:
    """The landmarks of a map that their sightings in `tables` put at another place as well, with all poses where they
    are."""
    return twofold(whole.all_values, tables)


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
