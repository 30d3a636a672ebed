"""How far a map is from the truth.

After one rigid alignment of the whole team (see `frames`):

    position RMSE   root of the mean squared distance of poses, or of landmarks [m]
    per number      the paper's RMSE: root of the mean over all numbers of a class (x, y, heading; x, y, z), metres and
                    radians alike
    ATE, RPE        of each robot alone, as Sturm et al. (2012): with its own alignment; over consecutive poses
    between robots  how far the pose of one robot seen from another is off: what a separate alignment would hide
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.errors import in_words
from teamslam.geometry import Array, IntArray, Pose, align
from teamslam.metrics.frames import Aligned, truth_at_base
from teamslam.model import Kind, Layout, Names, Submap, Values, index_of, is_landmark, is_pose, robot_of


@dataclass(frozen=True)
class PerNumber:
    """Root mean squares over the numbers of all variables, of poses, of landmarks; None for a class without any."""

    state: float | None
    robot_pose: float | None
    landmark: float | None

    @classmethod
    def of(cls, layout: Layout, squared: Array) -> "PerNumber":
        """From a square for each unknown: of an error, or a variance. Landmarks count by position only."""
        robots = np.repeat(is_pose(layout.keys), layout.dofs)
        places = np.arange(layout.dof) - np.repeat(layout.dof_start[:-1], layout.dofs)
        dims = np.repeat(2 + layout.kinds % 2, layout.dofs)
        marks = ~robots & (places < dims)
        return cls(_root(squared[robots | marks]), _root(squared[robots]), _root(squared[marks]))


@dataclass(frozen=True)
class RobotErrors:
    """One robot's errors: of position and orientation after the team's alignment, ATE after its own, RPE over steps."""

    robot: str
    poses: int
    position_rmse_m: float
    turn_rmse_rad: float | None
    ate_rmse_m: float
    rpe_rmse_m: float | None
    rpe_rmse_rad: float | None


@dataclass(frozen=True)
class LandmarkErrors:
    """How far one landmark is off, after the team's alignment [m]; heights count only where both know them."""

    landmark: str
    position_m: float


@dataclass(frozen=True)
class PairErrors:
    """Errors (RMSE) of the pose of the second robot as seen from the first: at each pose of the first, the pose of the
    second that is nearest in time."""

    robots: tuple[str, str]
    position_rmse_m: float
    turn_rmse_rad: float


@dataclass(frozen=True, eq=False)
class Track:
    """One robot's errors along its way, after the team's alignment: distance [m], and angle [rad] (nan: unknown)."""

    robot: str
    stamps_s: Array
    position_m: Array
    turn_rad: Array

    def __repr__(self) -> str:
        return f"Track(robot {in_words(self.robot)}: {len(self.stamps_s):,} poses)"


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of a map after one alignment of the whole team; None where there is nothing to compare. `poses` and
    `landmarks` are how many were compared."""

    poses: int
    landmarks: int
    robot_position_rmse_m: float | None
    robot_turn_rmse_rad: float | None
    landmark_rmse_m: float | None
    per_number: PerNumber
    robots: tuple[RobotErrors, ...]
    pairs: tuple[PairErrors, ...]
    tracks: tuple[Track, ...]
    each_landmark: tuple[LandmarkErrors, ...] = ()

    def __repr__(self) -> str:
        return f"Accuracy({self.poses:,} poses of {len(self.robots)} robots and {self.landmarks:,} landmarks compared)"


def accuracy(aligned: Aligned, names: Names) -> Accuracy:
    """All errors of an aligned map."""
    keys = aligned.keys
    poses, marks = keys[is_pose(keys)], keys[is_landmark(keys)]
    by_robot = {int(r): poses[robot_of(poses) == r] for r in np.unique(robot_of(poses))}
    return Accuracy(
        poses=len(poses),
        landmarks=len(marks),
        robot_position_rmse_m=_rmse(aligned.positions(poses)),
        robot_turn_rmse_rad=_rmse(aligned.turns(aligned.known_poses(poses))),
        landmark_rmse_m=_rmse(aligned.positions(marks)),
        per_number=_per_number(aligned),
        robots=tuple(_robot_errors(aligned, names.robot(r), own) for r, own in by_robot.items()),
        pairs=tuple(_pairs(aligned, names, {r: aligned.known_poses(own) for r, own in by_robot.items()})),
        tracks=tuple(_track(aligned, names, r, own) for r, own in by_robot.items()),
        each_landmark=tuple(_landmarks(aligned, names, np.sort(marks))),
    )


def errors_at_base(submap: Submap, truth: Values) -> PerNumber | None:
    """The paper's RMSE as it stands in Tables 1 and 2: in the frame of the map's base pose, without any alignment.

    It compares with the Cramer-Rao bound in that frame. None where the truth does not know the base pose.
    """
    known = truth_at_base(submap, truth)
    if known is None:
        return None
    return PerNumber.of(known.layout, known.minus(submap.values.only(known.layout.keys)) ** 2)


def _per_number(aligned: Aligned) -> PerNumber:
    """As `errors_at_base`, after the team's alignment: squares of each class, spread over its numbers."""
    layout = aligned.estimate.layout
    squares, kinds, keys = [], [], []
    for kind in Kind:
        own = aligned.keys[layout.kinds[layout.index(aligned.keys)] == kind]
        own = aligned.known_poses(own) if kind.is_pose else own
        error = aligned.positions(own)[:, : kind.dim]
        if kind.is_pose:
            turn = aligned.turns(own)
            error = np.concatenate([error, turn[:, 2:] if kind.dim == 2 else turn], -1)
        order = np.argsort(own)
        squares.append(error[order].ravel() ** 2)
        keys.append(own[order])
        kinds.append(np.full(len(own), int(kind)))
    return PerNumber.of(Layout(np.concatenate(keys), np.concatenate(kinds)), np.concatenate(squares))


def _robot_errors(aligned: Aligned, name: str, keys: IntArray) -> RobotErrors:
    oriented = aligned.known_poses(keys)
    true, estimate = aligned.poses(oriented)
    drift = true[:-1].between(true[1:]).between(estimate[:-1].between(estimate[1:]))
    return RobotErrors(
        robot=name,
        poses=len(keys),
        position_rmse_m=_rmse(aligned.positions(keys)) or 0.0,
        turn_rmse_rad=_rmse(aligned.turns(oriented)),
        ate_rmse_m=_ate(aligned, keys),
        rpe_rmse_m=_rmse(drift.translation),
        rpe_rmse_rad=_rmse(_turn(drift)),
    )


def _landmarks(aligned: Aligned, names: Names, keys: IntArray) -> Iterator[LandmarkErrors]:
    distances = np.linalg.norm(aligned.positions(keys), axis=-1)
    for number, distance in zip(index_of(keys).tolist(), distances.tolist(), strict=True):
        yield LandmarkErrors(names.landmark(number), distance)


def _ate(aligned: Aligned, keys: IntArray) -> float:
    """Root mean square of what one robot's own rigid alignment leaves of its positions [m]."""
    dim = aligned.pose.dim
    return align(aligned.estimate.positions(keys, dim), aligned.truth.positions(keys, dim)).rms


def _pairs(aligned: Aligned, names: Names, by_robot: dict[int, IntArray]) -> Iterator[PairErrors]:
    robots = [r for r, keys in by_robot.items() if len(keys)]
    for first, a in enumerate(robots):
        for b in robots[first + 1 :]:
            here, there = by_robot[a], by_robot[b]
            nearest = there[_nearest(index_of(here), index_of(there))]
            (true_a, estimate_a), (true_b, estimate_b) = aligned.poses(here), aligned.poses(nearest)
            off = true_a.between(true_b).between(estimate_a.between(estimate_b))
            yield PairErrors((names.robot(a), names.robot(b)), _rmse(off.translation) or 0.0, _rmse(_turn(off)) or 0.0)


def _nearest(stamps: IntArray, others: IntArray) -> IntArray:
    """The place in `others`, which rise, of the one nearest to each stamp."""
    after = np.minimum(np.searchsorted(others, stamps), len(others) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(others[before] - stamps) <= np.abs(others[after] - stamps), before, after)


def _track(aligned: Aligned, names: Names, robot: int, keys: IntArray) -> Track:
    turn = np.full(len(keys), np.nan)
    oriented = aligned.known_poses(keys)
    turn[np.isin(keys, oriented)] = np.linalg.norm(aligned.turns(oriented), axis=-1)
    distance = np.linalg.norm(aligned.positions(keys), axis=-1)
    return Track(names.robot(robot), np.asarray(names.stamps_s(keys), float), distance, turn)


def _turn(off: Pose) -> Array:
    return off.minus(Pose.identity(3, off.batch))[..., 3:]


def _rmse(errors: Array) -> float | None:
    """Root of the mean squared length of errors (n, d); None for none."""
    return float(np.sqrt(np.mean(np.sum(errors**2, -1)))) if len(errors) else None


def _root(squared: Array) -> float | None:
    return float(np.sqrt(squared.mean())) if len(squared) else None
