"""A finished map as files of maps hold it: where everything is, and how well each variable is known by itself."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array
from teamslam.model import WORLD, Names, Sources, Submap, Values, is_parameter, is_pose, robot_of
from teamslam.model.sparse import sp


@dataclass(frozen=True, eq=False)
class MapEstimate:
    """The estimate of a map in the frame of its base pose, which is among the values (WORLD: a surveyed frame).

    `covariances`: the marginal covariance (dof, dof) of each variable in the order of the layout, in the chart of
    `geometry.pose`; zero of the base; None where a file does not hold them. Raises ModelError where they do not fit.
    """

    values: Values
    covariances: tuple[Array, ...] | None
    base: int
    names: Names = field(default_factory=Names)

    def __post_init__(self) -> None:
        dofs = self.values.layout.dofs.tolist()
        if self.covariances is not None and [c.shape for c in self.covariances] != [(d, d) for d in dofs]:
            raise ModelError(f"a map of {len(dofs)} variables needs a covariance of each, in their order")

    @classmethod
    def of(cls, submap: Submap, marginals: Sequence[Array]) -> "MapEstimate":
        """The estimate of a map's poses and landmarks, with the marginal covariances of all its variables, given in the
        order of its layout."""
        values = submap.values if submap.base == WORLD else submap.all_values
        values = values.select(~is_parameter(values.layout.keys))
        blocks = dict(zip(submap.values.layout.keys.tolist(), marginals, strict=True))
        still = {} if submap.base == WORLD else {submap.base: np.zeros((3 * submap.base_dim - 3,) * 2)}
        return cls(
            values, tuple((blocks | still)[key] for key in values.layout.keys.tolist()), submap.base, submap.names
        )

    def as_submap(self, id: str) -> Submap:
        """A map that says nothing of how sure it is: its information is zero, and it holds no rows."""
        held = self.values.select(self.values.layout.keys != self.base)
        poses = self.values.layout.kinds[is_pose(self.values.layout.keys)]
        dim = 2 + int((poses % 2).max(initial=0))
        nothing = sp.csr_array((held.layout.dof,) * 2)
        return Submap(id, 0, self.base, dim, held, nothing, Sources(), self.names)

    @property
    def robots(self) -> list[int]:
        """The robots with a pose in it, rising."""
        keys = self.values.layout.keys
        return [int(robot) for robot in np.unique(robot_of(keys[is_pose(keys)]))]


def paths_of(path: Path, count: int) -> list[Path]:
    """A file for each of several maps: the path itself, then with `_part_2`, ... before its ending."""
    return [path, *(path.with_stem(f"{path.stem}_part_{number}") for number in range(2, count + 1))]
