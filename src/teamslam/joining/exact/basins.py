"""Which local optimum of each submap the team agrees with.

A robot's own measurements may fit two maps of its way almost equally well, wound one way or the other; what decides is
the team's cost F. From the lowest optimum of every submap, one submap at a time is exchanged for another of its optima,
or of the ways to start from, while F falls. Three looks, each dearer than the one before:

    alone     that one robot's poses solved anew, with all else held where it is
    together  the whole map solved anew from there: those that lead elsewhere alone, the most promising first; then a
              few of those that fall back alone, for together with the others they sometimes do not
    joined    the submaps joined with that choice, where it costs less together

However large the team, there are no more than MOST looks at all of it together after the first solve.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from teamslam.joining.join.join import Joined
from teamslam.model import Submap
from teamslam.solver import SAME

MOST = 24  # looks at a choice together with all else
FEW = 6  # of choices that fall back alone


Excess = Callable[[Joined, Submap], float]


def lowest(
    alternatives: Sequence[Sequence[Submap]],
    solve: Callable[[Sequence[Submap]], Joined],
    alone: Excess,
    together: Excess,
) -> Joined:
    """The joined map of the lowest cost that `solve` finds over choices of one submap from each of `alternatives`.

    `alternatives[i]`: those of piece i as `build_choices` gives them; where each has one, `solve` is called once.
    `alone`, `together`: how much more than a joined map it costs to have a submap's robot go from there, all others
    held or not. `together` is called at most MOST times and `solve` once more at most for each time that it gains;
    `alone` at most once for each alternative after each gain.
    """
    choice = [0] * len(alternatives)
    best = solve([options[0] for options in alternatives])
    left, improved = MOST, True
    while improved and left:
        improved = False
        for place, number in _promising(alternatives, choice, best, alone):
            if not left:
                break
            left -= 1
            if not together(best, alternatives[place][number]) < -SAME * _cost(best):
                continue
            other = [*choice[:place], number, *choice[place + 1 :]]
            found = solve([of[k] for of, k in zip(alternatives, other, strict=True)])
            if (
                len(found.components) <= len(best.components)
                and (found.converged or not best.converged)
                and _cost(found) < _cost(best) * (1.0 - SAME)
            ):
                best, choice, improved = found, other, True
                break
    return best


def _promising(
    alternatives: Sequence[Sequence[Submap]],
    choice: Sequence[int],
    best: Joined,
    alone: Excess,
) -> Iterator[tuple[int, int]]:
    """Places and numbers of choices, the most promising first: one for each optimum that one leads to by itself, then
    some that lead to none."""
    same = SAME * (1.0 + _cost(best))
    found: list[tuple[float, int, int]] = []
    falling: list[tuple[bool, int, int]] = []
    for place, options in enumerate(alternatives):
        for number, submap in enumerate(options):
            if number == choice[place]:
                continue
            more = alone(best, submap)
            twin = any(other == place and abs(more - known) <= same for known, other, _ in found)
            if abs(more) > same and np.isfinite(more) and not twin:
                found.append((more, place, number))
            elif np.isfinite(more):
                falling.append((abs(more) <= same, place, number))  # twins of one that leads elsewhere come first
    yield from ((place, number) for _, place, number in sorted(found))
    yield from ((place, number) for _, place, number in sorted(falling)[:FEW])


def _cost(joined: Joined) -> float:
    return sum(component.map.cost for component in joined.components)
