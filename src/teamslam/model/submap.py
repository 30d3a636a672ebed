"""A submap: a robot's own map of a stretch of its way, as one big measurement.

The estimate S^ (paper, eq. 1) is written in the frame of the base pose, which is not among its variables (any of its
robot's poses: see `rebased`); the information I_S = J' W J (eq. 9) is over the estimate's unknowns in the mixed chart.
Joining submaps gives a submap again, so this is also what a finished map is. `sources` says which rows of whose log
went in, so that nothing is ever counted twice.

The information matrix, not its triangular root, is what is kept: it is sparse where the measurements are, while the
root fills in; `square_root` gives the triangle where one is wanted.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NoReturn, overload

import numpy as np

from teamslam.cards import card
from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose, read_only
from teamslam.model.keys import WORLD, Names, is_landmark, is_pose, robot_of
from teamslam.model.layout import pose_kind
from teamslam.model.sources import Sources
from teamslam.model.sparse import sp
from teamslam.model.tables import Table
from teamslam.model.values import Values


def frozen(matrix: sp.csr_array) -> sp.csr_array:
    """The same matrix, not to be written into; whoever made it may still write."""
    parts = (matrix.data, matrix.indices, matrix.indptr)
    if not any(part.flags.writeable for part in parts):
        return matrix
    in_order = matrix.has_sorted_indices, matrix.has_canonical_format
    out = sp.csr_array.__new__(sp.csr_array)  # made of parts, it would look through the same numbers once more
    vars(out).update(vars(matrix))
    out.data, out.indices, out.indptr = map(read_only, parts)
    out.has_sorted_indices, out.has_canonical_format = in_order
    return out


class Made:
    """A field that holds a matrix, or what makes it when it is first asked for."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, owner: None, kind: type) -> NoReturn: ...
    @overload
    def __get__(self, owner: "Submap", kind: type) -> sp.csr_array: ...
    def __get__(self, owner: "Submap | None", kind: type) -> sp.csr_array:
        if owner is None:
            raise AttributeError(self._name)  # dataclasses take this for a field without a default
        held: sp.csr_array | Callable[[], sp.csr_array] = owner.__dict__[self._name]
        if callable(held):
            held = owner.__dict__[self._name] = owner.checked(held())
        return held

    def __set__(self, owner: "Submap", matrix: sp.csr_array | Callable[[], sp.csr_array]) -> None:
        owner.__dict__[self._name] = matrix if callable(matrix) else owner.checked(matrix)


@dataclass(frozen=True, eq=False)
class Submap:
    """An estimate with its information, in the frame of its base pose.

    `id` and `version`: a newer version of the same id replaces the older. `base`: the key of the pose that is the frame
    (WORLD for surveyed frames), of dimension `base_dim`; not among `values`. `information`: symmetric, sparse,
    (values.layout.dof, values.layout.dof), in the order of the layout's unknowns; given as a matrix or as what makes
    one, which is called when the information is first asked for. `cost` is what the measurements
    inside it cost at its optimum (sum of losses, no factor 1/2); `chi2` their squared whitened residuals; `rows` their
    number.
    """

    id: str
    version: int
    base: int
    base_dim: int
    values: Values
    information: Made = Made()
    sources: Sources  # type: ignore[misc]  # what stands before it is no default
    names: Names = field(default_factory=Names)
    raw: tuple[Table, ...] = ()
    cost: float = 0.0
    chi2: float = 0.0
    rows: int = 0

    def __post_init__(self) -> None:
        if self.values.layout.contains(self.base):
            raise ModelError(
                f"submap {self.id}: its base, {self.names.describe(self.base)}, is its frame, not a variable"
            )

    def __repr__(self) -> str:
        waiting = sum(map(len, self.raw))
        return f"Submap({self.id}, version {self.version}, {self.values!r}" + (
            f", {waiting:,} raw rows)" if waiting else ")"
        )

    def _repr_html_(self) -> str:
        from teamslam.model.portrait import portrait

        frame = self.names.describe(self.base)
        poses, marks = int(is_pose(self.keys).sum()), len(self.landmark_keys)
        facts = [
            ("version", str(self.version)),
            ("frame", frame),
            ("holds", f"{poses:,} poses, {marks:,} landmarks"),
            ("made of", f"{self.rows:,} numbers measured, cost {self.cost:.6g}"),
            *([("raw rows", f"{sum(map(len, self.raw)):,}")] if self.raw else []),
        ]
        return card(
            f"Submap {self.id}", facts, picture=portrait(self.values if self.base == WORLD else self.all_values)
        )

    def checked(self, information: sp.csr_array) -> sp.csr_array:
        """The information, if it fits the unknowns; else ModelError."""
        n = self.dof
        if information.shape != (n, n):
            raise ModelError(
                f"submap {self.id}: {n} unknowns need an information matrix ({n}, {n}), found {information.shape}"
            )
        return frozen(information)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"information": self.information}  # what makes it does not travel

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state | {"information": frozen(state["information"])})

    @property
    def dof(self) -> int:
        """Unknowns."""
        return self.values.layout.dof

    @cached_property
    def keys(self) -> IntArray:
        """The variables, the base pose included, sorted."""
        return np.sort(np.append(self.values.layout.keys, self.base))

    @property
    def robots(self) -> tuple[int, ...]:
        """The robots whose measurements it holds."""
        return tuple(sorted({stretch.robot for stretch in self.sources}))

    @cached_property
    def robots_in_it(self) -> tuple[int, ...]:
        """The robots that have a pose in it, rising."""
        return tuple(int(robot) for robot in np.unique(robot_of(self.keys)) if robot > 0)

    @cached_property
    def all_values(self) -> Values:
        """The estimate with the base pose itself, which is the identity."""
        base = Values.of({pose_kind(self.base_dim): (np.array([self.base]), Pose.identity(self.base_dim, (1,)))})
        return base.update(self.values)

    def rows_of(self, table: Table) -> BoolArray:
        """Which rows (m,) of a table it was made of: those of its sources that do not travel raw, nor wait for a
        variable that it lacks, or for the world's frame. A row may speak of what a map knows and yet not be in it, as
        the rows of a piece that no submap could be built of."""
        mine = self.sources.rows_of(table)
        if self.base != WORLD and table.row.unary:
            mine[:] = False
        if mine.any():
            layout = self.values.layout if self.base == WORLD else self.all_values.layout
            mine[mine] = (table if mine.all() else table.select(mine)).told_by(layout)
        for raw in self.raw:
            if (raw.robot, raw.source) == (table.robot, table.source):
                mine &= ~np.isin(table.ids, raw.ids)
        return mine

    def trajectory_keys(self, robot: int) -> IntArray:
        """The keys of one robot's poses in time order, the base among them where it is the robot's."""
        keys = self.keys
        return np.asarray(keys[is_pose(keys) & (robot_of(keys) == robot)])

    @cached_property
    def first_pose(self) -> int:
        """The key of the earliest pose of its base's robot, from which a map that begins with it is seen; WORLD where
        that is its frame."""
        return self.base if self.base == WORLD else int(self.trajectory_keys(int(robot_of(self.base)))[0])

    @cached_property
    def landmark_keys(self) -> IntArray:
        """The keys of its landmarks."""
        keys = self.keys
        return np.asarray(keys[is_landmark(keys) & (keys != WORLD)])

    @cached_property
    def square_root(self) -> Array:
        """R upper triangular with information = R'R (dense). Raises ModelError where the information is indefinite."""
        try:
            return np.linalg.cholesky(self.information.toarray()).T
        except np.linalg.LinAlgError:
            raise ModelError(f"submap {self.id}: its information matrix is not positive definite") from None

    def information_of(self, keys: AnyArray) -> Array:
        """The block of the information matrix over some variables (the others held fixed), dense."""
        at = self.values.layout.unknowns(keys)
        return np.asarray(self.information[at][:, at].toarray())
