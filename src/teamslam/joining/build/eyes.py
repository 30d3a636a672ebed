"""Which pose a submap is seen from: the one whose heading what was seen holds most firmly.

A submap is a Gaussian over what is seen from its base. If the base itself hangs on the rest by a poorly known turn,
that turn swings everything else around it, on arcs; a Gaussian has straight lines in their place, and a join that turns
the base by some of its sigmas bends the map by what lies between. A first pose that saw nothing yet, or little, is such
a base, though the robot knew later very well where it was.

    held:   what was seen from the way (landmarks, other robots), where the piece has it
    asked:  how well its own rows then tell which way each of the robot's poses looks
    chosen: the pose with the least variance; the first where nothing was seen, or what was tells nothing of headings

With what was seen held, a way hangs together by its steps alone: the question costs little beside the solution itself.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.model import Table, Values, among
from teamslam.solver import System

TELLS_NOTHING = 1.0  # [rad^2] of a heading
ALIKE = 1e-6  # of a variance: of poses that are held as firmly the first counts


def best_seen_from(poses: IntArray, tables: Sequence[Table], values: Values) -> int:
    """One of a robot's `poses` (rising), given the rows that a submap holds and where it has all that they name."""
    layout, first = values.layout, int(poses[0])
    seen = layout.keys[~among(layout.keys, poses)]
    if not len(seen):
        return first
    system = System(layout, tables=tables, fixed=seen)
    try:
        factor = system.factor(values)
        factor.factorise(system.linearise(values).hessian.numbers)
    except SolveError:
        return first
    blocks = np.stack(factor.marginals(system.free.index(poses)))
    dim = blocks.shape[-1] // 3 + 1
    variances = np.trace(blocks[:, dim:, dim:], axis1=1, axis2=2)
    least = float(variances.min())
    if not least < TELLS_NOTHING:
        return first
    return int(poses[np.flatnonzero(variances <= least * (1.0 + ALIKE))[0]])
