"""How sure several things are together, and one as seen from another."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.answers.columns import AXES, POSE_ERRORS, UNITS, Columns, Tabular, dataframe
from teamslam.answers.maps import Maps, found_in, frame_of
from teamslam.errors import ModelError, in_words
from teamslam.geometry import Array, Pose, Sealed, seal
from teamslam.model import Asked, Kind, Submap, key_asked

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False)
class JointCovariance(Sealed, Tabular):
    """The joint covariance of several variables: `matrix` (n, n), each of its rows and columns called in `labels`, such
    as 'landmark door x_m'. Of `things`, `sizes` says how many numbers each has.

    Poses err by [dT, dw], dT in the map's frame [m], dw in the pose's own [rad]; points by [x y (z)] [m].
    """

    things: tuple[str, ...]
    sizes: tuple[int, ...]
    labels: tuple[str, ...]
    matrix: Array
    frame: str

    def __post_init__(self) -> None:
        seal(self, "matrix")

    def __repr__(self) -> str:
        return f"JointCovariance({', '.join(map(in_words, self.things))}: {len(self.labels)} x {len(self.labels)})"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.matrix, dtype) if copy or dtype is not None else self.matrix

    @property
    def sigmas(self) -> Array:
        """Standard deviations (n,), [m] and [rad]."""
        return np.sqrt(np.maximum(np.diagonal(self.matrix), 0.0))

    @property
    def correlations(self) -> Array:
        """(n, n), from -1 to 1; 0 with what is known exactly."""
        sigmas = np.where(self.sigmas > 0.0, self.sigmas, np.inf)
        return np.asarray(self.matrix / np.outer(sigmas, sigmas))

    def block(self, first: int, second: int) -> Array:
        """The covariance of the first thing with the second, counted from 0 in the order asked."""
        ends = np.cumsum(self.sizes)
        rows, columns = (slice(ends[n] - self.sizes[n], ends[n]) for n in (first, second))
        return self.matrix[rows, columns]

    def columns(self) -> Columns:
        """A column for each number."""
        return dict(zip(self.labels, self.matrix.T, strict=True))

    def to_dataframe(self) -> "pandas.DataFrame":
        """The matrix with its labels on both sides. Raises MissingExtraError without pandas."""
        return dataframe(self.columns(), self.labels)


@dataclass(frozen=True, eq=False)
class Relative(Sealed):
    """A thing as seen from a pose: `position` (d,) [m] in the observer's body, forward first; `pose`, where the target
    is one; `covariance` (n, n) of [dT, dw] or of the position alone."""

    target: str
    observer: str
    position: Array
    pose: Pose | None
    covariance: Array

    def __post_init__(self) -> None:
        seal(self, "position", "covariance")

    def __repr__(self) -> str:
        place = ", ".join(f"{axis} {value:.3f}" for axis, value in zip(AXES, self.position.tolist(), strict=False))
        sigmas = ", ".join(f"{sigma:.3f}" for sigma in self.sigmas[: len(self.position)].tolist())
        return f"Relative({in_words(self.target)} seen from {in_words(self.observer)}: {place} m, sigma {sigmas} m)"

    @property
    def sigmas(self) -> Array:
        """Standard deviations (n,), [m] and [rad]."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def distance(self) -> float:
        """From the observer to the target [m]."""
        return float(np.linalg.norm(self.position))

    @property
    def distance_sigma(self) -> float:
        """Standard deviation of the distance [m], to first order; of a distance of 0, the largest of the position."""
        d = len(self.position)
        block = self.covariance[:d, :d]
        if self.distance == 0.0:
            return float(np.sqrt(np.linalg.norm(block, 2)))
        along = self.position / self.distance
        return float(np.sqrt(along @ block @ along))


def joint_of(team: Maps, asked: Sequence[Asked], component: int | None) -> JointCovariance:
    """The joint covariance of variables that are in one map. ModelError in words where they are not."""
    if not asked:
        raise ModelError("name what the covariance is asked of, such as 'door' and 'red@12.5'")
    number, keys = found_in(team, asked, key_asked, component)
    submap = team.maps[number - 1]
    errors = [_errors(submap, key) for key in keys]
    things = tuple(submap.names.describe(key) for key in keys)
    labels = tuple(f"{thing} {e}_{UNITS[e]}" for thing, own in zip(things, errors, strict=True) for e in own)
    matrix = team.covariances[number - 1].joint(keys)
    return JointCovariance(things, tuple(map(len, errors)), labels, matrix, frame_of(submap))


def relative_of(team: Maps, target: Asked, observer: Asked, component: int | None) -> Relative:
    """A variable as seen from a pose in the same map. ModelError in words where there is none."""
    number, (seen, seer) = found_in(team, [target, observer], key_asked, component)
    submap = team.maps[number - 1]
    values, names = submap.all_values, submap.names
    if _kind(submap, seer) >= Kind.POINT2:
        raise ModelError(f"things are seen from a pose, such as 'red@12.5'; {names.describe(seer)} is a place alone")
    if seen == seer:
        raise ModelError(f"{names.describe(seen)} as seen from itself: name two different things")
    kinds = _kind(submap, seen), _kind(submap, seer)
    dim = max(kind.dim for kind in kinds)
    from_here = values.pose(seer).lift(dim)
    pose = from_here.between(values.pose(seen).lift(dim)) if kinds[0].is_pose else None
    return Relative(
        names.describe(seen),
        names.describe(seer),
        from_here.unact(values.positions(np.array(seen), dim)),
        pose,
        team.covariances[number - 1].relative(values, seer, seen),
    )


def _kind(submap: Submap, key: int) -> Kind:
    layout = submap.all_values.layout
    return Kind(int(layout.kinds[layout.index(key)]))


def _errors(submap: Submap, key: int) -> tuple[str, ...]:
    """What the numbers of a variable's error are called."""
    kind = _kind(submap, key)
    return POSE_ERRORS[kind.dim] if kind.is_pose else AXES[: kind.dim]
