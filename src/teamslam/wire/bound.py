"""How far a map joined from rounded messages can be from the one that exact messages would have given.

To first order in what rounding changed, with e_i = S^_i (-) h_i(G) the disagreement of submap i and the joined map:

    |G~ (-) G|_H  <=  ( sqrt(sum_i shift_i^2) + sqrt(sum_i eta_i^2 |e_i|^2_I_i) ) / (1 - max eta)     [sigma]

It holds for every variable in its own standard deviations, and for every combination of variables.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.joining.condense.condense import disagreement
from teamslam.model import Submap
from teamslam.wire.rounding import Precision


def shift_bound(joined: Submap, parts: Sequence[tuple[Submap, Precision]]) -> float:
    """The bound [sigma] for a joined map and the submaps it was joined from, each with its message's rounding."""
    shifts = [rounding.shift_sigma for _, rounding in parts]
    pulls = []
    for submap, rounding in parts:
        error = disagreement(submap, joined)
        # What is known is the rounded information, which may be too small by the factor 1 - eta.
        pulls.append(
            rounding.information**2 * float(error @ (submap.information @ error)) / (1.0 - rounding.information)
        )
    worst = max((rounding.information for _, rounding in parts), default=0.0)
    return float((np.linalg.norm(shifts) + np.sqrt(np.sum(pulls))) / (1.0 - worst))
