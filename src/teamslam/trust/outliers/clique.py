"""The largest set of which every two agree: a maximum clique, by branch and bound with greedy colouring.

A clique of a graph that k colours suffice for has at most k members, which bounds each branch; sets are bits of whole
numbers, so that a step is a few machine words. The search is exact where it ends within its budget of steps, which
large dense graphs with a few random gaps may exceed: then the best clique so far counts, at least as large as what
greed finds, and `proven` is false. Steps are counted, not seconds: the same graph gives the same clique.

Source: Tomita, Seki, "An Efficient Branch-and-Bound Algorithm for Finding a Maximum Clique" (DMTCS 2003); for sightings
of robots Mangelson et al., "Pairwise Consistent Measurement Set Maximization" (ICRA 2018).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import BoolArray

STEPS = 20_000


@dataclass(frozen=True, eq=False)
class Clique:
    """`members` (n,) true for those in it; `proven`: no larger one exists."""

    members: BoolArray
    proven: bool

    @property
    def size(self) -> int:
        """How many are in it."""
        return int(self.members.sum())


def largest_clique(agree: BoolArray, *, steps: int = STEPS) -> Clique:
    """The largest clique of a symmetric graph (n, n); its diagonal does not matter.

    Law: every two members agree, and nobody else agrees with all of them.
    """
    n = len(agree)
    if n == 0:
        return Clique(np.zeros(0, bool), True)
    order = np.argsort(-agree.sum(0), kind="stable")
    graph = np.asarray(agree)[np.ix_(order, order)] & ~np.eye(n, dtype=bool)
    packed = np.packbits(graph, axis=1, bitorder="little")
    search = _Search([int.from_bytes(row.tobytes(), "little") for row in packed], steps)
    search.best = _greedy(search.neighbours)
    search.expand(0, 0, (1 << n) - 1)
    members = np.zeros(n, bool)
    members[order] = [bool(search.best >> place & 1) for place in range(n)]
    return Clique(members, search.steps > 0)


def _greedy(neighbours: list[int]) -> int:
    """Vertices in their order, each that agrees with all before; the best of that from the first few."""
    found = 0
    for first in range(min(len(neighbours), 8)):
        clique, open_ = 1 << first, neighbours[first]
        while open_:
            place = (open_ & -open_).bit_length() - 1
            clique |= 1 << place
            open_ &= neighbours[place]
        found = max(found, clique, key=int.bit_count)
    return found


class _Search:
    """The best clique so far, and how many steps are left."""

    def __init__(self, neighbours: list[int], steps: int) -> None:
        self.neighbours, self.steps, self.best = neighbours, steps, 0

    def expand(self, clique: int, size: int, open_: int) -> None:
        """All cliques that hold `clique` and else only what is open."""
        for place, colours in reversed(self._coloured(open_)):
            if self.steps <= 0 or size + colours <= self.best.bit_count():
                return
            self.steps -= 1
            wider, left = clique | 1 << place, open_ & self.neighbours[place]
            if left:
                self.expand(wider, size + 1, left)
            elif size + 1 > self.best.bit_count():
                self.best = wider
            open_ &= ~(1 << place)

    def _coloured(self, open_: int) -> list[tuple[int, int]]:
        """The open vertices by rising colour, with it: neighbours have different ones."""
        found, colour = [], 0
        while open_:
            colour += 1
            alike = open_
            while alike:
                bit = alike & -alike
                place = bit.bit_length() - 1
                found.append((place, colour))
                alike &= ~bit & ~self.neighbours[place]
                open_ &= ~bit
        return found
