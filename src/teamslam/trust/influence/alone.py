"""Members of a team whose own measurements contradict each other, beside how well the others' fit.

A member's submaps cost F_k by themselves with D_k numbers to spare. Noise that is larger than stated by one factor for
all says nothing of one of them; so F_k / D_k is compared with that of all others together, by Fisher's F.
"""

from collections.abc import Callable, Hashable, Sequence

from teamslam.model import Submap
from teamslam.trust.evidence import Fit, ratio_by_chance

TIMES = 1.5  # what others' noise costs, that a member's costs at least; real robots differ by 1.25


def alone(submaps: Sequence[Submap], label: Callable[[Submap], Hashable]) -> dict[Hashable, Fit]:
    """What each member's submaps cost by themselves, and their numbers to spare."""
    found: dict[Hashable, Fit] = {}
    for submap in submaps:
        name = label(submap)
        held = found.get(name, Fit(0.0, 0))
        found[name] = Fit(held.cost + submap.cost, held.dof + max(submap.rows - submap.dof, 0))
    return found


def self_contradicting(own: dict[Hashable, Fit], level: float) -> dict[Hashable, float]:
    """The members whose own measurements fit much worse than the others' do, with the probability of that by chance,
    times how many were looked at; the worst is taken out of what the next is compared with."""
    found: dict[Hashable, float] = {}
    while len(found) + 1 < len(own):
        left = {name: fit for name, fit in own.items() if name not in found}
        worst = max(left, key=lambda name: left[name].factor)
        rest = Fit(
            sum(fit.cost for name, fit in left.items() if name != worst),
            sum(fit.dof for name, fit in left.items() if name != worst),
        )
        chance = min(ratio_by_chance(left[worst], rest) * len(own), 1.0)
        if chance >= level or left[worst].factor < TIMES * rest.factor:
            break
        found[worst] = chance
    return found
