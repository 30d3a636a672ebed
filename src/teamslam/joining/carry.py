"""Moving a map without bending it: submaps are carried by their frames.

A join's step turns whole submaps. Written as straight lines in the map's frame, a turn by a bends a submap at lever
arm l by l a^2 / 2, which its information forbids; steps then creep. Here every variable moves with the frame of one
submap that holds it, its home, and frames move with the submap in which they stand (strands). To first order that is
the same step; only the curve along which it is taken differs, and along it a submap's own residuals stay linear
(cpp/retraction.hpp has the formula).
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Layout, Submap


def homes(layout: Layout, submaps: Sequence[Submap]) -> IntArray:
    """The place in `layout` of the pose that carries each variable (n,), -1 for none.

    `submaps` in an order in which each one's base is known before it (as `place` gives them).
    """
    bases = np.array([s.base for s in submaps])
    keys = np.concatenate([s.values.layout.keys for s in submaps])
    places = layout.index(keys)
    holder = np.repeat(np.arange(len(submaps)), [len(s.values) for s in submaps])
    # What lives in the plane is not carried by a frame in space.
    flat = layout.kinds[places] % 2 == 0
    fits = ~flat | np.array([s.base_dim == 2 for s in submaps])[holder]
    held, first = np.unique(places[fits], return_index=True)
    by = np.full(len(layout), -1)
    by[held] = holder[fits][first]
    # A frame stands in a submap that comes before its own, so frames form a forest.
    frames, own = np.unique(layout.index(bases), return_index=True)
    by[frames] = np.where(by[frames] < own, by[frames], -1)
    return np.where(by >= 0, layout.index(bases)[by], -1)
