"""Which local optimum of each submap the team agrees with.

A robot's own measurements may fit two maps of its way almost equally well, wound one way or the other; what decides is
the team's cost F. From the lowest optimum of every submap, one submap at a time is exchanged for another of its optima,
or of the ways to start from, while F falls (coordinate descent over the few that there are); no combination is solved
twice.
"""

from collections.abc import Callable, Sequence

from teamslam.joining.join.join import Joined
from teamslam.model import Submap


def lowest(alternatives: Sequence[Sequence[Submap]], solve: Callable[[Sequence[Submap]], Joined]) -> Joined:
    """The joined map of the lowest cost that `solve` finds over choices of one submap from each of `alternatives`.

    `alternatives[i]`: those of piece i as `build_choices` gives them; where each has one, `solve` is called once.
    """
    choice = [0] * len(alternatives)
    best = solve([options[0] for options in alternatives])
    tried = {tuple(choice)}
    improved = True
    while improved:
        improved = False
        for place, options in enumerate(alternatives):
            for number in range(len(options)):
                other = [*choice[:place], number, *choice[place + 1 :]]
                if tuple(other) in tried:
                    continue
                tried.add(tuple(other))
                found = solve([of[k] for of, k in zip(alternatives, other, strict=True)])
                if len(found.components) <= len(best.components) and _cost(found) < _cost(best):
                    best, choice, improved = found, other, True
    return best


def _cost(joined: Joined) -> float:
    return sum(component.map.cost for component in joined.components)
