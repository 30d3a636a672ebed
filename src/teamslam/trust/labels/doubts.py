"""What the landmarks of a constellation contradict the others by, from the factor of all constellations joined.

At the joined map, with H_k and g_k the information and slope of constellation k and C the covariance of the map,

    M = H_k - H_k C H_k,    D_i = g_i' M_ii^-1 g_i,    D_ij = g_ij' M_ij,ij^-1 g_ij

is by how much the cost falls if constellation k has landmark i, or i and j, in places of its own. No other name for
them explains more than that. So where even that is no better than noise, names need not be tried; to second order
around the map this is exact. Of many landmarks those are asked that pull most, by g_i' H_ii^-1 g_i.

Source: Baarda, "A testing procedure for use in geodetic networks" (1968), for data snooping; Kok, "On data snooping and
multiple outlier testing" (1984), for several at once.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.model import Submap
from teamslam.solver import Factor, SubmapTerm, System

UNCHECKED = 1e-9  # of H_k: a place that nobody else knows
WORST = 10  # landmarks that are asked


@dataclass(frozen=True, eq=False)
class Doubts:
    """Of one constellation: the landmarks that were asked (`keys`, n), what each would bring in a place of its own
    (`alone`, n), and any two of them at most (`two`), with so many numbers a landmark (`dof`)."""

    keys: IntArray
    alone: Array
    two: float
    dof: int


def doubts_of(part: Submap, joined: Submap, factor: Factor) -> Doubts:
    """What a constellation's landmarks contradict the others by, in the map that all were joined into; `factor` of its
    information."""
    values = point_of(joined)
    named = np.append(part.values.layout.keys, part.base)
    near, frame = values.only(np.unique(named[values.layout.contains(named)])), frame_of(joined)
    system = System(near.layout, submaps=[SubmapTerm.of(part)], fixed=frame[near.layout.contains(frame)])
    at = system.linearise(near)
    H, g, free = at.hessian.to_csr().toarray(), at.gradient, system.free  # dense by nature
    blocks = [free.unknowns(np.array([key])) for key in part.landmark_keys.tolist()]
    own_of = [H[np.ix_(block, block)] for block in blocks]  # singular where a place in space is seen in the plane alone
    pulls = [_brings(h, g[block], UNCHECKED * float(np.trace(h))) for h, block in zip(own_of, blocks, strict=True)]
    asked = np.argsort(-np.array(pulls), kind="stable")[:WORST]
    unknowns = np.concatenate([blocks[i] for i in asked.tolist()])
    across, own = np.zeros((joined.values.layout.dof, len(unknowns))), joined.values.layout.unknowns(free.keys)
    across[own] = columns = H[:, unknowns]
    M = columns[unknowns] - columns.T @ factor.solve(across)[own]
    where = np.split(np.arange(len(unknowns)), np.cumsum([len(blocks[i]) for i in asked.tolist()])[:-1])
    floor = UNCHECKED * float(np.trace(columns[unknowns]))
    alone = np.array([_brings(M[np.ix_(b, b)], g[unknowns[b]], floor) for b in where])
    pairs = (np.concatenate(both) for both in combinations(where, 2))
    two = max((_brings(M[np.ix_(b, b)], g[unknowns[b]], floor) for b in pairs), default=0.0)
    return Doubts(part.landmark_keys[asked], alone, two, max(map(len, where)))


def _brings(information: Array, gradient: Array, floor: float) -> float:
    """By how much the cost falls if some unknowns are free; by nothing in ways that no more than `floor` holds."""
    values, ways = np.linalg.eigh(information)
    held = values > floor
    return float(np.sum((ways.T @ gradient)[held] ** 2 / values[held]))
