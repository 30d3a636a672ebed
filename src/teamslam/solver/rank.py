"""Whether measurements fix all variables: a question to the rank of their rows, which no weight answers.

Weights tell how well: under a loss that forgives, beside sigmas that are very far apart, or a hair from a sensor, an
information matrix has no factor in double precision although every variable is measured.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from teamslam.errors import SolveError
from teamslam.model import Loss, Values
from teamslam.solver.system import SubmapTerm, System


def fixes(system: System, values: Values) -> bool:
    """Whether the Jacobian of all rows, each with a sigma of one and no loss, has full rank at `values`; a submap is a
    row of each of its numbers."""
    plain = Loss("squared", 1.0)
    tables = [replace(t, whitening=np.eye(t.whitening.shape[-1])[None]).with_loss(plain) for t in system.tables]
    terms = [SubmapTerm(t.base, t.values, sp.csr_array(sp.identity(t.values.layout.dof))) for t in system.submaps]
    held = system.layout.keys[~system.free.contains(system.layout.keys)]
    unweighed = System(system.layout, tables=tables, submaps=terms, fixed=held)
    try:
        unweighed.factor(values).factorise(unweighed.linearise(values).hessian.numbers)
    except SolveError:
        return False
    return True
