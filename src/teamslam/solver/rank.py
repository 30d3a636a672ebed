"""Whether measurements fix all variables: a question to the rank of their rows, which no weight answers.

Weights tell how well: under a loss that forgives, beside sigmas that are very far apart, or a hair from a sensor, an
information matrix has no factor in double precision although every variable is measured.
"""

from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.model import Loss, Values
from teamslam.model.sparse import sp
from teamslam.solver.system import SubmapTerm, System

ROUNDING = 1e-14  # of the sharpest direction: what rounding leaves of one that is not measured


def fixes(system: System, values: Values) -> bool:
    """Whether the Jacobian of all rows, each direction that is measured with a sigma of one and no loss, has full rank
    at `values`; a submap is a row of each of its numbers."""
    plain = Loss("squared", 1.0)
    tables = [replace(t, whitening=_measured(t.whitening)).with_loss(plain) for t in system.tables]
    terms = [SubmapTerm(t.base, t.values, sp.csr_array(sp.identity(t.values.layout.dof))) for t in system.submaps]
    unweighed = system.alike(tables, terms)
    try:
        unweighed.factor(values).factorise(unweighed.linearise(values).hessian.numbers)
    except SolveError:
        return False
    return True


def _measured(whitening: Array) -> Array:
    """The projection (.., n, n) on the directions that a whitening matrix knows to a finite sigma."""
    _, sizes, directions = np.linalg.svd(whitening)
    known = sizes > ROUNDING * sizes[..., :1]
    return np.asarray(np.swapaxes(directions, -1, -2) @ (known[..., None] * directions))
