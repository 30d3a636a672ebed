"""Moving a map without bending it: submaps are carried by their frames.

A join's step turns whole submaps. Written as straight lines in the map's frame, a turn by a bends a submap at lever
arm l by l a^2 / 2, which its information forbids; steps then creep. Here every variable moves with the frame of one
submap that holds it, its home, and frames move with the submap in which they stand, or with that in which the first
pose of their own stands (chains). To first order that is the same step; only the curve along which it is taken differs,
and along it a submap's own residuals stay linear (cpp/retraction.hpp has the formula).
"""

import numpy as np

from teamslam.geometry import IntArray
from teamslam.joining.place.stack import Stack
from teamslam.model import Layout


def homes(layout: Layout, stack: Stack) -> IntArray:
    """The place in `layout` of the pose that carries each variable (n,), -1 for none.

    `stack`: submaps in an order in which each one's first pose is known before it (as `place` gives them).
    """
    places, bases = layout.index(stack.keys), layout.index(stack.bases)
    # What lives in the plane is not carried by a frame in space.
    flat = layout.kinds[places] % 2 == 0
    fits = np.flatnonzero(~flat | (stack.base_dims == 2)[stack.holder])
    by = np.full(len(layout), -1)
    by[places[fits[::-1]]] = stack.holder[fits[::-1]]  # the first one that holds it, written last, stays
    # A frame stands in a submap that comes before its own, so frames form a forest.
    own = np.zeros(len(layout), np.int64)
    own[bases[::-1]] = np.arange(len(bases))[::-1]
    first = layout.index(stack.first_poses)
    earliest = np.where(by < 0, len(bases), by)
    np.minimum.at(earliest, bases, np.arange(len(bases)))
    by[bases] = np.where(by[bases] < own[bases], by[bases], -1)
    carrier = np.where(by >= 0, bases[by], -1)
    spatial = layout.kinds % 2 == 1
    hung = (carrier[bases] < 0) & (first != bases) & (earliest[first] < own[bases])
    hung &= spatial[bases] | ~spatial[first]
    carrier[bases[hung]] = first[hung]
    return carrier
