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
from teamslam.model import Layout, Submap
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
    free, own = system.free, joined.values.layout.unknowns(system.free.keys)
    # One more unknown, of which nothing is known, stands for the axes that a landmark seen in the plane alone lacks.
    H, g = np.pad(at.hessian.to_csr().toarray(), (0, 1)), np.append(at.gradient, 0.0)  # dense by nature
    where = _axes(free, part.landmark_keys)
    pulls = _brings(H[where[:, :, None], where[:, None, :]], g[where])
    asked = np.argsort(-pulls, kind="stable")[:WORST]
    where = where[asked]
    columns = H[:, where.ravel()]
    across = np.zeros((joined.values.layout.dof, where.size))
    across[own] = columns[:-1]
    M = columns[where.ravel()] - columns[:-1].T @ factor.solve(across)[own]
    places = np.arange(where.size).reshape(where.shape)
    pairs = np.array(list(combinations(range(len(where)), 2)), np.int64).reshape(-1, 2)
    both = places[pairs].reshape(len(pairs), -1)
    floor = UNCHECKED * float(np.trace(columns[where.ravel()]))
    pull = g[where.ravel()]
    alone, two = (_brings(M[at[:, :, None], at[:, None, :]], pull[at], floor) for at in (places, both))
    return Doubts(part.landmark_keys[asked], alone, float(two.max(initial=0.0)), where.shape[1])


def _axes(layout: Layout, keys: IntArray) -> IntArray:
    """The unknowns of each of some landmarks (n, d); those that it lacks are one beyond the last."""
    index = layout.index(keys)
    first, axes = layout.dof_start[index], layout.dofs[index]
    place = np.arange(axes.max())
    return np.asarray(np.where(place < axes[:, None], first[:, None] + place, layout.dof))


def _brings(information: Array, gradient: Array, floor: float | None = None) -> Array:
    """By how much the cost falls if some unknowns are free, for information (n, d, d) and slopes (n, d); by nothing in
    ways that no more than `floor` holds, without one UNCHECKED of what holds the others."""
    values, ways = np.linalg.eigh(information)
    least = UNCHECKED * np.trace(information, axis1=1, axis2=2)[:, None] if floor is None else floor
    pull = np.einsum("nji,nj->ni", ways, gradient)
    return np.asarray(np.sum(np.where(values > least, pull**2 / np.where(values > least, values, 1.0), 0.0), -1))
