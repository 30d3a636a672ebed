"""A map and a truth brought together: what both know, and in which frame they are compared.

aligned      the whole team is moved onto the truth by one rigid fit (one for all robots and landmarks, so that
             errors between robots stay visible); for errors in metres
at base      the truth is written in the frame of the map's base pose, as the map and its covariances are
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, Told, align, register
from teamslam.model import WORLD, Kind, Layout, Submap, Values, is_pose

HELD = 1e-9  # of the spread of points: with less rigidity a fit is free to turn


def shared_keys(submap: Submap, truth: Values) -> IntArray:
    """The variables that both know, the base pose among them."""
    keys = submap.keys
    return np.asarray(keys[truth.layout.contains(keys) & (keys != WORLD)])


def as_kinds(truth: Values, layout: Layout) -> Values:
    """The truth of those variables of a layout that it fully knows, as the kinds that the layout has.

    A planar pose is lifted into space at height 0; a spatial one casts its shadow on the ground. Where the truth says
    less than the layout asks for (a point for a pose, no height for a point in space), the variable is left out.
    """
    common = layout.select(truth.layout.contains(layout.keys))
    theirs = truth.layout.kinds[truth.layout.index(common.keys)]
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in Kind:
        known = (theirs < Kind.POINT2) if kind.is_pose else (theirs % 2 >= kind % 2)
        if len(keys := common.keys[(common.kinds == kind) & known]):
            parts[kind] = (keys, _poses(truth, keys, kind.dim) if kind.is_pose else truth.positions(keys, kind.dim))
    return Values.of(parts)


def _poses(values: Values, keys: IntArray, dim: int) -> Pose:
    lifted = values.poses_of(keys, 3)
    return lifted if dim == 3 else Pose.from_xytheta(lifted.xytheta())


@dataclass(frozen=True, eq=False)
class Aligned:
    """A map moved onto the truth by `pose`: `keys` are known to both. `basis` says what the fit rests on; `held` is
    false where that leaves it free to turn."""

    keys: IntArray
    estimate: Values
    truth: Values
    pose: Pose
    basis: str
    held: bool

    @property
    def alike(self) -> bool:
        """False where the errors are as large as what is compared, as they are between maps of two worlds."""
        there = self.truth.positions(self.keys, 3)
        spread = np.mean(np.sum((there - there.mean(0)) ** 2, -1))
        return len(self.keys) < 3 or float(np.mean(np.sum(self.positions(self.keys) ** 2, -1))) < 0.25 * float(spread)

    @property
    def moved_m(self) -> float:
        """How far the middle of what both know was moved onto the truth [m]."""
        middle = self.truth.positions(self.keys, 3)[:, : self.pose.dim].mean(0)
        return float(np.linalg.norm(middle - self.pose.inverse().act(middle)))

    def positions(self, keys: IntArray) -> Array:
        """Errors of position (n, 3) [m]; heights count only where both know them."""
        return self._errors[self._layout.index(keys)]

    def turns(self, keys: IntArray) -> Array:
        """Errors of orientation (n, 3) [rad], as rotation vectors, of poses known as such to both."""
        return self._turns[self._oriented.index(keys)]

    def poses(self, keys: IntArray) -> tuple[Pose, Pose]:
        """True and estimated poses (n,), in space; where the estimate lies in the plane, so does the truth."""
        true, estimate = self._poses
        at = self._oriented.index(keys)
        return true[at], estimate[at]

    def known_poses(self, keys: IntArray) -> IntArray:
        """Those of `keys` that are poses in both."""
        return np.asarray(keys[self._oriented.contains(keys)])

    # All at once, when one is first asked for: errors are asked for robot by robot, and again for each pair.

    @cached_property
    def _layout(self) -> Layout:
        return self.estimate.layout.select(np.isin(self.estimate.layout.keys, self.keys))

    @cached_property
    def _oriented(self) -> Layout:
        keys = self._layout.keys
        return self._layout.select(_is_oriented(self.estimate, keys) & _is_oriented(self.truth, keys))

    @cached_property
    def _errors(self) -> Array:
        keys = self._layout.keys
        error = self.estimate.positions(keys, 3) - self.truth.positions(keys, 3)
        error[~(_is_spatial(self.estimate, keys) & _is_spatial(self.truth, keys)), 2] = 0.0
        return error

    @cached_property
    def _poses(self) -> tuple[Pose, Pose]:
        keys = self._oriented.keys
        true, flat = self.truth.poses_of(keys, 3), ~_is_spatial(self.estimate, keys)
        shadow = Pose.from_xytheta(true.xytheta()).lift(3)
        rotation = np.where(flat[:, None, None], shadow.rotation, true.rotation)
        translation = np.where(flat[:, None], shadow.translation, true.translation)
        return Pose(rotation, translation), self.estimate.poses_of(keys, 3)

    @cached_property
    def _turns(self) -> Array:
        true, estimate = self._poses
        return estimate.minus(true)[..., 3:]


def align_team(submap: Submap, truth: Values) -> Aligned | None:
    """The map after one rigid motion of the whole team onto the truth; None where they have nothing in common.

    The closed-form fit over the positions of all shared poses and landmarks (Umeyama 1991); where these leave it free
    to turn (all in line, or only one), the orientations of shared poses come in. A team in the plane is moved in it. Of
    points that have no height in the truth x and y count alone.
    """
    keys = shared_keys(submap, truth)
    if not len(keys):
        return None
    estimate = submap.values if submap.base == WORLD else submap.all_values
    dim = 2 if submap.base_dim == 2 or (estimate.layout.kinds % 2 == 0).any() else 3
    here, there = estimate.positions(keys, dim), truth.positions(keys, dim)
    fit = align(here, there)
    robots = is_pose(keys).any()
    basis = "robots and landmarks" if robots and not is_pose(keys).all() else "robots" if robots else "landmarks"
    spread = float(np.mean(np.sum((there - there.mean(0)) ** 2, -1)))
    held = fit.rigidity > HELD * spread and len(keys) > 1
    oriented = keys[_is_oriented(estimate, keys) & _is_oriented(truth, keys)]
    if not held and len(oriented):
        turned = [_poses(values, oriented, dim).rotation for values in (estimate, truth)]
        fit = align(here, there, source_rotations=turned[0], target_rotations=turned[1])
        basis, held = f"{basis} and their orientations", True
    flat = truth.layout.kinds[truth.layout.index(keys)] == Kind.POINT2
    pose = fit.pose if dim == 2 or not flat.any() else _without_heights(here, there, flat, fit.pose)
    return Aligned(keys, estimate.transform(pose), truth, pose, basis, held)


def _without_heights(here: Array, there: Array, flat: BoolArray, near: Pose) -> Pose:
    """The fit in space of points of which some are `flat` (n,): nobody knows their heights. It begins at the fit of all
    others, where these are held, and else `near`."""
    known = np.ones(here.shape, bool)
    known[flat, 2] = False
    if np.count_nonzero(~flat) > 2:
        others = align(here[~flat], there[~flat])
        spread = float(np.mean(np.sum((there[~flat] - there[~flat].mean(0)) ** 2, -1)))
        near = others.pose if others.rigidity > HELD * spread else near
    return register(Told.of_points(here, there, known), near).pose


def in_another_world(submap: Submap, aligned: Aligned) -> bool:
    """Whether a map that is written in the world's frame and a truth that it is like are of two worlds: it was moved
    farther onto it than it is large."""
    there = aligned.truth.positions(aligned.keys, 3)
    large = 2.0 * float(np.linalg.norm(there - there.mean(0), axis=-1).max())
    return submap.base == WORLD and aligned.alike and aligned.moved_m > large


def truth_at_base(submap: Submap, truth: Values) -> Values | None:
    """What the truth knows of the map's variables (the base left out), in the map's own frame and kinds.

    None where the truth does not know the base pose, so that the map's frame is nowhere in it.
    """
    if submap.base == WORLD:
        return as_kinds(truth, submap.values.layout)
    known = as_kinds(truth, submap.all_values.layout)
    if not known.layout.contains(submap.base):
        return None
    moved = known.transform(known.pose(submap.base).inverse())
    return moved.select(moved.layout.keys != submap.base)


def _is_spatial(values: Values, keys: IntArray) -> BoolArray:
    return np.asarray(values.layout.kinds[values.layout.index(keys)] % 2 == 1)


def _is_oriented(values: Values, keys: IntArray) -> BoolArray:
    return np.asarray(values.layout.kinds[values.layout.index(keys)] < Kind.POINT2)
