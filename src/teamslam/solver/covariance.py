"""Covariances of an estimate, read from its information matrix: of one variable, of several, of one seen from another.

All are in the chart of `geometry.pose`: of a pose [dT, dw], dT in the map's frame [m^2], dw in the pose's own [rad^2].

They are of the information J'W'WJ. An optimum may be held in some direction by how residuals bend alone, such as the
height of a landmark that is ranged too short from sensors at its own height. To first order nothing is measured there:
a pivot of zero is an error that names the variable, and one that rounding made is a variance beyond all sense, never a
small one.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from teamslam.geometry import AnyArray, Array, Pose, lift_tangent
from teamslam.geometry import rotations as group_of
from teamslam.model import Kind, Layout, Names, Submap, Values
from teamslam.solver.linear import Factor, Matrix


class Covariances:
    """The covariances of a map. Factorises once, on first use. Raises SolveError where a variable is not determined.

    The base pose of a map is its frame: it is no variable, and asking for it raises ModelError.
    """

    def __init__(
        self,
        layout: Layout,
        information: Matrix | sp.csr_array | Callable[[], Matrix | sp.csr_array],
        names: Names | None = None,
        values: Values | None = None,
    ) -> None:
        """`information` may be what makes it, when it is first asked for; `values`, the estimate, saves time."""
        self.layout, self._information, self._names, self._values = layout, information, names, values

    @classmethod
    def of_map(cls, submap: Submap) -> "Covariances":
        """The covariances of a submap or joined map, in its frame."""
        return cls(submap.values.layout, lambda: submap.information, submap.names, submap.values)

    @cached_property
    def _factor(self) -> Factor:
        information = self._information() if callable(self._information) else self._information
        return Factor.of(self.layout, information, self._names, self._values)

    def determined(self) -> "Covariances":
        """Itself, its factor made. Raises SolveError where a variable is not determined."""
        self._factor  # noqa: B018
        return self

    @cached_property
    def all(self) -> list[Array]:
        """The marginal covariance of every variable, in the order of the layout; all at once (selected inverse)."""
        return self._factor.marginals()

    def of(self, key: int) -> Array:
        """The marginal covariance (dof, dof) of one variable. Raises ModelError for an unknown key."""
        return self.all[int(self.layout.index(key))]

    def blocks(self, keys: AnyArray) -> list[Array]:
        """The marginal covariances of several variables, in the order of `keys`; quicker than `all` where they are
        few."""
        places = self.layout.index(keys)
        if not len(places):
            return []
        if "all" in vars(self) or 2 * len(places) > len(self.layout):
            return [self.all[place] for place in places.tolist()]
        return self._factor.marginals(places)

    def draws(self, white: AnyArray) -> Array:
        """Errors that the estimate may have, in its chart: P^1/2 white, white (dof,) or (dof, k).

        Law: of columns of white noise it makes draws whose covariance is P; with the unit matrix D, D D' = P.
        """
        return self._factor.draws(np.asarray(white, float))

    def joint(self, keys: AnyArray) -> Array:
        """The joint covariance of several variables, dense, in the order of `keys`."""
        columns = self.layout.unknowns(np.asarray(keys))
        unit = np.zeros((self.layout.dof, len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        covariance = self._factor.solve(unit)[columns]
        return np.asarray(0.5 * (covariance + covariance.T))

    def relative(self, values: Values, observer: int, target: int) -> Array:
        """The covariance of a target as seen from an observer's pose: of X_o^-1 X_t, or of R_o'(p - T_o).

        `values` is the estimate that the covariances belong to.
        """
        joint = self.joint(np.array([observer, target]))
        kind_o, kind_t = (Kind(int(self.layout.kinds[self.layout.index(k)])) for k in (observer, target))
        dim = max(kind_o.dim, kind_t.dim)
        turn, group = lift_tangent(kind_o.dim, dim), group_of(dim)
        seen_from = values.pose(observer).lift(dim)
        back = seen_from.rotation.T
        where = seen_from.unact(values.positions(np.array([target]), dim)[0])
        d = dim
        rows = d + (group.DOF if kind_t.is_pose else 0)
        of_observer = np.zeros((rows, d + group.DOF))
        of_observer[:d, :d] = -back
        for k, axis in enumerate(np.eye(group.DOF)):
            of_observer[:d, d + k] = -group.hat(axis) @ where
        if kind_t.is_pose:
            relative = seen_from.between(_pose(values, target).lift(dim))
            of_observer[d:, d:] = -group.adjoint(relative.rotation.T)
            of_target = np.zeros((rows, d + group.DOF))
            of_target[:d, :d] = back
            of_target[d:, d:] = np.eye(group.DOF)
            of_target = of_target @ lift_tangent(kind_t.dim, dim)
        else:
            of_target = back
        jacobian = np.concatenate([of_observer @ turn, of_target], 1)
        return np.asarray(jacobian @ joint @ jacobian.T)


def _pose(values: Values, key: int) -> Pose:
    return values.pose(key)
