"""Which local optimum of each submap the team agrees with.

A robot's own measurements may fit two maps of its way almost equally well, wound one way or the other; what decides is
the team's cost F. From the lowest optimum of every submap, one submap at a time is exchanged for another of its optima,
or of the ways to start from, while F falls. Whole solves are what costs, so a choice is first tried alone: `excess`
solves that one robot's poses with all else held where it is. A way that falls back to the same optimum needs no whole
solve, nor does one that costs far more; the others are solved, the most promising first, and no more than MOST of them
in all, however large the team.
"""

from collections.abc import Callable, Iterator, Sequence

from teamslam.joining.join.join import Joined
from teamslam.model import Submap

MOST = 12  # whole solves beyond the first
SAME = 1e-6  # of the cost, and absolutely: two optima that differ by less are one
HOPELESS = 32.0  # of cost: what a choice costs more by itself than the team can be expected to make good


def lowest(
    alternatives: Sequence[Sequence[Submap]],
    solve: Callable[[Sequence[Submap]], Joined],
    excess: Callable[[Joined, Submap], float],
) -> Joined:
    """The joined map of the lowest cost that `solve` finds over choices of one submap from each of `alternatives`.

    `alternatives[i]`: those of piece i as `build_choices` gives them; where each has one, `solve` is called once.
    `excess(joined, submap)`: how much more than `joined` it costs to have that submap's robot go from there, all others
    held. `solve` is called at most 1 + MOST times, `excess` at most once for each alternative after each gain.
    """
    choice = [0] * len(alternatives)
    best = solve([options[0] for options in alternatives])
    left, improved = MOST, True
    while improved and left:
        improved = False
        for place, number in _promising(alternatives, choice, best, excess):
            if not left:
                break
            left -= 1
            other = [*choice[:place], number, *choice[place + 1 :]]
            found = solve([of[k] for of, k in zip(alternatives, other, strict=True)])
            if len(found.components) <= len(best.components) and _cost(found) < _cost(best) * (1.0 - SAME):
                best, choice, improved = found, other, True
                break
    return best


def _promising(
    alternatives: Sequence[Sequence[Submap]],
    choice: Sequence[int],
    best: Joined,
    excess: Callable[[Joined, Submap], float],
) -> Iterator[tuple[int, int]]:
    """Places and numbers of choices that lead elsewhere by themselves, the cheapest first, one for each optimum."""
    same = SAME * (1.0 + _cost(best))
    found: list[tuple[float, int, int]] = []
    for place, options in enumerate(alternatives):
        for number, submap in enumerate(options):
            if number == choice[place]:
                continue
            more = excess(best, submap)
            twin = any(other == place and abs(more - known) <= same for known, other, _ in found)
            if abs(more) > same and more < HOPELESS and not twin:
                found.append((more, place, number))
    for _, place, number in sorted(found):
        yield place, number


def _cost(joined: Joined) -> float:
    return sum(component.map.cost for component in joined.components)
