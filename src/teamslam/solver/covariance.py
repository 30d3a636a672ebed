"""Covariances of an estimate, read from its information matrix: of one variable, of several, of one seen from another.

All are in the chart of `geometry.pose`: of a pose [dT, dw], dT in the map's frame [m^2], dw in the pose's own [rad^2].

They are of the information J'W'WJ. An optimum may be held in some direction by how residuals bend alone, such as the
height of a landmark that is ranged too short from sensors at its own height. To first order nothing is measured there:
a pivot of zero is an error that names the variable, and one that rounding made is a variance beyond all sense, never a
small one.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from teamslam.cards import card
from teamslam.geometry import AnyArray, Array, IntArray, Pose, lift_tangent
from teamslam.geometry import rotations as group_of
from teamslam.model import WORLD, Asked, Kind, Layout, Names, Submap, Values, is_landmark, key_asked, pose_kind
from teamslam.model.layout import among
from teamslam.model.portrait import portrait
from teamslam.model.sparse import sp
from teamslam.solver.linear import Factor, Matrix

MANY = 30  # variables whose joint covariance is found by eliminating the others
MOST_DRAWN = 500  # landmarks: of more, regions take longer than a card may


class Covariances:
    """The covariances of a map. Factorises once, on first use. Raises SolveError where a variable is not determined.

    Variables are asked for by key or in words ('door', 'red@12.5': see `teamslam.model.asked`). The base pose of a map
    is its frame: it is no variable of the layout, and known exactly, so that its covariances are 0.
    """

    def __init__(
        self,
        layout: Layout,
        information: Matrix | sp.csr_array | Callable[[], Matrix | sp.csr_array],
        names: Names | None = None,
        values: Values | None = None,
        *,
        base: int = WORLD,
        base_kind: Kind = Kind.POSE2,
    ) -> None:
        """`information` may be what makes it, when it is first asked for; `values`, the estimate, saves time; `base`
        is the pose that is the frame, WORLD for none."""
        self.layout, self._information, self._names, self._values = layout, information, names, values
        self._base, self._base_kind = base, base_kind

    @classmethod
    def of_map(cls, submap: Submap) -> "Covariances":
        """The covariances of a submap or joined map, in its frame."""
        return cls(
            submap.values.layout,
            lambda: submap.information,
            submap.names,
            submap.values,
            base=submap.base,
            base_kind=pose_kind(submap.base_dim),
        )

    def __repr__(self) -> str:
        return f"Covariances of {len(self.layout):,} variables, {self.layout.dof:,} unknowns"

    def _repr_html_(self) -> str:
        marks = self.layout.keys[is_landmark(self.layout.keys)]
        facts = [("variables", f"{len(self.layout):,}"), ("unknowns", f"{self.layout.dof:,}")]
        picture = ""
        if self._values is not None and len(marks) <= MOST_DRAWN:
            regions = np.array([block[:2, :2] for block in self.blocks(marks)]).reshape(-1, 2, 2)
            picture = portrait(self._values, marks, regions)
            if len(marks):
                sigmas = np.sqrt(np.trace(regions, axis1=1, axis2=2))
                facts.append(("landmarks", f"sigma of position {sigmas.min():.3g} to {sigmas.max():.3g} m"))
        return card("Covariances", facts, picture=picture)

    def __getstate__(self) -> dict[str, Any]:
        """What travels: the information as a matrix, and what was found with it; not the factor."""
        known = self._information() if callable(self._information) else self._information
        held = {name: value for name, value in vars(self).items() if name != "_factor"}
        return held | {"_information": known.to_csr() if isinstance(known, Matrix) else known}

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

    @cached_property
    def keys(self) -> IntArray:
        """The variables, sorted, the base pose among them."""
        return np.sort(np.append(self.layout.keys, [self._base] if self._base != WORLD else np.zeros(0, np.int64)))

    def of(self, asked: Asked) -> Array:
        """The marginal covariance (dof, dof) of one variable. Raises ModelError for one that is not there, and says
        what is."""
        key = self._key(asked)
        return np.zeros((self._base_kind.dof,) * 2) if key == self._base else self.all[int(self.layout.index(key))]

    def blocks(self, keys: AnyArray) -> list[Array]:
        """The marginal covariances of several variables, in the order of `keys`; quicker than `all` where they are
        few."""
        keys = np.asarray(keys, np.int64)
        still = keys == self._base
        places = self.layout.index(keys[~still])
        if "all" in vars(self) or 2 * len(places) > len(self.layout):
            found = [self.all[place] for place in places.tolist()]
        else:
            found = self._factor.marginals(places) if len(places) else []
        if not still.any():
            return found
        others, zero = iter(found), np.zeros((self._base_kind.dof,) * 2)
        return [zero.copy() if base else next(others) for base in still.tolist()]

    def draws(self, white: AnyArray) -> Array:
        """Errors that the estimate may have, in its chart: P^1/2 white, white (dof,) or (dof, k).

        Law: of columns of white noise it makes draws whose covariance is P; with the unit matrix D, D D' = P.
        """
        return self._factor.draws(np.asarray(white, float))

    def joint(self, asked: AnyArray | Sequence[Asked]) -> Array:
        """The joint covariance of several variables, dense, in the order asked."""
        keys = np.array([self._key(one) for one in (asked.tolist() if isinstance(asked, np.ndarray) else asked)])
        dofs = np.array([self._kind(key).dof for key in keys.tolist()], np.int64)
        own = np.repeat(keys != self._base, dofs)
        mine = self.layout.select(among(self.layout.keys, np.unique(keys)))
        known = self._solved(mine) if len(mine) < MANY else self._eliminated(mine)
        at = mine.unknowns(keys[keys != self._base])
        covariance = np.zeros((len(own), len(own)))
        covariance[np.ix_(own, own)] = 0.5 * (known + known.T)[np.ix_(at, at)]
        return covariance

    def _solved(self, mine: Layout) -> Array:
        """The joint covariance of some variables, column by column."""
        columns = self.layout.unknowns(mine.keys)
        unit = np.zeros((self.layout.dof, len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        return np.asarray(self._factor.solve(unit)[columns])

    def _eliminated(self, mine: Layout) -> Array:
        """The same, by their information when all others are eliminated: of many variables in a third of the time."""
        return np.asarray(np.linalg.inv(self._factor.information_of(self.layout.index(mine.keys))))

    def relative(self, values: Values, observer: Asked, target: Asked) -> Array:
        """The covariance of a target as seen from an observer's pose: of X_o^-1 X_t, or of R_o'(p - T_o).

        `values` is the estimate that the covariances belong to, the base pose among them where it is asked for.
        """
        observer, target = self._key(observer), self._key(target)
        joint = self.joint([observer, target])
        kind_o, kind_t = self._kind(observer), self._kind(target)
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

    def _key(self, asked: Asked) -> int:
        return key_asked(asked, self._names or Names(), self.keys)

    def _kind(self, key: int) -> Kind:
        return self._base_kind if key == self._base else Kind(int(self.layout.kinds[self.layout.index(key)]))


def _pose(values: Values, key: int) -> Pose:
    return values.pose(key)
