"""Which interiors are worth eliminating before a submap is sent.

Eliminating a variable removes its own blocks from the information matrix and couples all its neighbours. Where these
were coupled already the message shrinks; where they were not it may grow. Variables go greedily, the one that shrinks
the message most first (a minimum-degree order weighed by numbers sent), and the smallest of all stages is the answer:
a stage that grows may be followed by several that shrink.
"""

import heapq

import numpy as np

from teamslam.geometry import BoolArray
from teamslam.model import Layout
from teamslam.model.sparse import sp

BLOCK = 0.25  # what naming one coupling costs, in numbers: two bytes
VARIABLE = 0.5  # what naming one variable costs
HOPELESS = 1.5  # stop looking where a stage has grown to this multiple of the smallest


def block_couplings(layout: Layout, information: sp.csr_array) -> sp.csr_array:
    """Which variables are coupled: (n, n), ones where a block of the information holds any number."""
    coo = sp.coo_array(information)
    owner = np.repeat(np.arange(len(layout)), layout.dofs)
    n = len(layout)
    out = sp.csr_array(sp.coo_array((np.ones(len(coo.data)), (owner[coo.row], owner[coo.col])), shape=(n, n)))
    out.data[:] = 1.0
    return out


def worth_eliminating(layout: Layout, information: sp.csr_array, candidates: BoolArray) -> BoolArray:
    """Those of the candidates (n,) to eliminate so that the rest, sent as sparse blocks, holds the fewest numbers."""
    dofs = layout.dofs.tolist()
    couplings = block_couplings(layout, information)
    neighbours = [
        set(couplings.indices[a:b].tolist()) - {v}
        for v, (a, b) in enumerate(zip(couplings.indptr[:-1], couplings.indptr[1:], strict=True))
    ]
    heap = [(_growth(v, neighbours, dofs), v) for v in np.flatnonzero(candidates).tolist()]
    heapq.heapify(heap)
    open_ = {v for _, v in heap}
    order: list[int] = []
    size = best = _numbers(neighbours, dofs)
    keep = 0
    while heap:
        growth, v = heapq.heappop(heap)
        if v not in open_:
            continue
        now = _growth(v, neighbours, dofs)
        if now > growth:  # its neighbourhood has changed since
            heapq.heappush(heap, (now, v))
            continue
        around = neighbours[v]
        for u in around:
            neighbours[u] |= around
            neighbours[u] -= {u, v}
        open_.discard(v)
        order.append(v)
        size += now
        for u in around & open_:
            heapq.heappush(heap, (_growth(u, neighbours, dofs), u))
        if size < best:
            best, keep = size, len(order)
        elif size > HOPELESS * best:
            break
    out = np.zeros(len(layout), bool)
    out[order[:keep]] = True
    return out


def _growth(v: int, neighbours: list[set[int]], dofs: list[int]) -> float:
    """How many numbers more a message holds without v: what is filled in, less what goes."""
    around = neighbours[v]
    own = VARIABLE + dofs[v] + dofs[v] * (dofs[v] + 1) / 2 + sum(dofs[v] * dofs[u] + BLOCK for u in around)
    filled = 0.0
    for u in around:
        filled += sum(dofs[u] * dofs[w] + BLOCK for w in around - neighbours[u] if w != u)
    return filled / 2 - own


def _numbers(neighbours: list[set[int]], dofs: list[int]) -> float:
    """The numbers in a message: estimate, upper triangle of the information by blocks, and what names them."""
    own = sum(VARIABLE + d + d * (d + 1) / 2 for d in dofs)
    return own + sum(dofs[v] * dofs[u] + BLOCK for v, around in enumerate(neighbours) for u in around) / 2
