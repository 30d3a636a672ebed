"""The weakest direction of a map: the displacement that carries most of what is uncertain in its shape.

    P v = mu M^-1 v,  mu the largest            the first principal axis of P in the metric M

and once combinations F of the unknowns are taken as known, that of P - P F' (F P F')^-1 F P.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array
from teamslam.trust.weak.knowledge import DENSE, Knowledge, Stacks, worst_variances

ROUNDING = 1e-9  # of a correlation


@dataclass(frozen=True)
class Least:
    """The largest standard deviation of any place [m] and of any heading or turn [rad] (0 where nothing has one), and
    the keys of these."""

    place_m: float
    place: int
    heading_rad: float
    heading: int


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What is known once the combinations `functions` (dof, k) of the unknowns are known too."""

    knowledge: Knowledge
    functions: Array

    @cached_property
    def _gone(self) -> Array:
        """X (dof, k) with P given F = P - X X'."""
        spread = self.knowledge.spread(self.functions)
        together = self.functions.T @ spread
        scale = np.sqrt(np.diagonal(together))
        sizes, ways = np.linalg.eigh(together / np.outer(scale, scale))
        fresh = sizes > ROUNDING  # combinations that others of them tell as well add nothing
        return np.asarray((spread / scale) @ (ways[:, fresh] / np.sqrt(sizes[fresh])))

    def spread(self, f: Array) -> Array:
        """The covariance times functions f (dof, ...)."""
        found = self.knowledge.spread(f)
        return np.asarray(found - self._gone @ (self._gone.T @ f))

    @cached_property
    def stacks(self) -> Stacks:
        """The covariance of every variable."""
        parts = ((at, blocks, self._gone[at]) for at, blocks in self.knowledge.stacks)
        return [(at, blocks - x @ np.swapaxes(x, 1, 2)) for at, blocks, x in parts]

    @cached_property
    def least(self) -> "Least":
        """What is known least, relative to the map as a whole."""
        layout = self.knowledge.values.layout
        # What is known exactly has a variance of zero, give or take rounding.
        places, headings = (np.maximum(np.nan_to_num(v), 0.0) for v in worst_variances(layout, self.stacks))
        place, heading = (int(np.argmax(variances)) for variances in (places, headings))
        return Least(
            float(np.sqrt(places[place])), int(layout.keys[place]),
            float(np.sqrt(headings[heading])), int(layout.keys[heading]),
        )  # fmt: skip

    @property
    def total(self) -> float:
        """The sum of all variances, in the metric: what its directions share among them."""
        known = self.knowledge
        return known.total - float(np.sum(known.weight[:, None] * self._gone**2))

    def weakest(self) -> tuple[Array, float]:
        """The direction v (dof,), of length one in M, and its variance mu."""
        from scipy.sparse.linalg import LinearOperator, eigsh

        root = np.sqrt(self.knowledge.weight)
        dof = len(root)

        def times(y: Array) -> Array:
            weighed = (root * np.asarray(y).T).T
            return np.asarray((root * self.spread(weighed).T).T)

        if dof <= DENSE:
            values, vectors = np.linalg.eigh(times(np.eye(dof)))
            return vectors[:, -1] / root, float(values[-1])
        operator = LinearOperator((dof, dof), matvec=times, matmat=times, dtype=float)
        start = np.random.default_rng(0).standard_normal(dof)
        values, vectors = eigsh(operator, k=1, v0=start, which="LA", tol=1e-6)
        return vectors[:, 0] / root, float(values[0])
