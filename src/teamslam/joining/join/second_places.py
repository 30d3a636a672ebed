"""What a map cannot know of where a landmark is: ranges that fit at two places, in words."""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.geometry import Array
from teamslam.joining.start.twofold import RULED_OUT, twofold
from teamslam.model import Names, Submap, Table

NAMED = 3  # landmarks with a second place that get a sentence of their own


def second_places(whole: Submap, tables: Sequence[Table]) -> Iterator[str]:
    """Sentences on landmarks of a map that their sightings in `tables` put at another place as well, with all poses
    where they are, cheapest first. What robots that cannot leave a plane put above or below it is one sentence."""
    found = twofold(whole.all_values, tables)
    names = whole.names
    for two in found:
        if two.by_nature.any():
            yield (
                f"{_listed(names, two.keys[two.by_nature].tolist())}: ranges from robots of a plane leave open whether "
                f"this is above or below it; above is assumed"
            )
    close = [
        (float(two.more[n]), two, n) for two in found for n in np.flatnonzero(~two.by_nature & (two.more < RULED_OUT))
    ]
    for more, two, n in sorted(close, key=lambda entry: entry[0])[:NAMED]:
        key = int(two.keys[n])
        here, there = whole.values.positions(two.keys[n : n + 1], two.others.shape[1])[0], two.others[n]
        costs = f"for at most {more:.2g} more of cost" if more > 0.0 else "for no more of cost"
        yield (
            f"ambiguous: {names.describe(key)} is at {_place(here)} or at {_place(there)}, {costs}: its ranges come "
            f"from nearly one line (in space: one plane); one from the side would tell"
        )
    if len(close) > NAMED:
        keys = [int(two.keys[n]) for _, two, n in sorted(close, key=lambda entry: entry[0])[NAMED:]]
        yield f"ambiguous in the same way: {_listed(names, keys)}"


def _place(position: Array) -> str:
    return f"({', '.join(f'{number:.2f}' for number in position)})"


def _listed(names: Names, keys: Sequence[int]) -> str:
    shown = [names.describe(key) for key in keys[:NAMED]]
    return ", ".join(shown) + (f" and {len(keys) - NAMED} others" if len(keys) > NAMED else "")
