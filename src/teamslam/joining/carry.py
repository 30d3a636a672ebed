"""Moving a map without bending it: submaps are carried by their frames.

A join's step turns whole submaps. Written as straight lines in the map's frame, a turn by a bends a submap at lever
arm l by l a^2 / 2, which its information forbids; steps then creep. Here every variable moves with the frame of one
submap that holds it, its home, and frames move with the submap in which they stand (strands):

    X_v = B @ Y_v,     B+ = B (+) d_B,     Y_v+ = Y_v (+) d_Y,     X_v+ = B+ @ Y_v+

with d_Y chosen so that to first order X_v+ = X_v (+) d_v. The step and the normal equations are those of the paper;
only the curve along which the step is taken differs, and along it a submap's own residuals stay linear.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, lift_points, lift_tangent
from teamslam.geometry import rotations as group_of
from teamslam.model import Kind, Layout, Submap, Values, pack


class Carrier:
    """The retraction of a join: `move(values, delta)` with delta over all unknowns of `layout`.

    `submaps` in an order in which each one's base is known before it (as `place` gives them).
    """

    def __init__(self, layout: Layout, submaps: Sequence[Submap]) -> None:
        self.layout = layout
        self.dim = 3 if (layout.kinds % 2 == 1).any() else 2
        bases = np.array([s.base for s in submaps])
        self._bases, first = np.unique(bases, return_index=True)
        frame_of = np.searchsorted(self._bases, bases)  # submaps that share a base share a frame
        self._base_places = layout.index(self._bases)
        keys = np.concatenate([s.values.layout.keys for s in submaps])
        holder = np.repeat(np.arange(len(submaps)), [len(s.values) for s in submaps])
        # What lives in the plane is not carried by a frame in space.
        flat = layout.kinds[layout.index(keys)] % 2 == 0
        fits = ~flat | np.array([s.base_dim == 2 for s in submaps])[holder]
        known, at = np.unique(keys[fits], return_index=True)
        home = holder[fits][at]
        self._home = np.full(len(layout), -1)
        self._home[layout.index(known)] = frame_of[home]
        self._home[self._base_places] = -1
        # A frame stands in a submap that comes before its own, so frames form a forest.
        self._parent = np.full(len(self._bases), -1)
        held = np.flatnonzero(np.isin(self._bases, known))
        stands_in = home[np.searchsorted(known, self._bases[held])]
        earlier = stands_in < first[held]
        self._parent[held[earlier]] = frame_of[stands_in[earlier]]

    def move(self, values: Values, delta: Array) -> Values:
        """values (+) delta along the curve above. Law: to first order in delta it is values.retract(delta)."""
        old = values.poses_of(self._bases, self.dim)
        turn = self._tangents(delta, self._base_places)
        new = self._carry_frames(old, turn)
        state = values.retract(delta).state.copy()
        self._put(state, self._base_places, new)
        for kind in Kind:
            places = self.layout.stretch(kind)
            carried = places.start + np.flatnonzero(self._home[places] >= 0)
            if not len(carried):
                continue
            homes = self._home[carried]
            things = values.gather(self.layout.keys[carried], kind)
            lifted = things.lift(self.dim) if isinstance(things, Pose) else lift_points(things, self.dim)
            within = _inner(old[homes], turn[homes], lifted, self._tangents(delta, carried))
            self._put(
                state,
                carried,
                (new[homes] @ within).sharpened() if isinstance(within, Pose) else new[homes].act(within),
            )
        return Values(self.layout, state)

    def _put(self, state: Array, places: IntArray, things: Pose | Array) -> None:
        """Write things into the state, those of the plane flat."""
        kinds = self.layout.kinds[places]
        for kind in map(Kind, np.unique(kinds).tolist()):
            mask = kinds == kind
            if isinstance(things, Pose):
                part = things[mask]
                flat = part if part.dim == kind.dim else Pose.from_xytheta(part.xytheta())
                rows = pack(flat)
            else:
                rows = things[mask][:, : kind.dim]
            state[self.layout.state_start[places[mask]][:, None] + np.arange(kind.size)] = rows

    def _tangents(self, delta: Array, places: IntArray) -> Array:
        """The parts of delta that belong to some variables (of points, padded), as tangents of the common space."""
        out = np.zeros((len(places), 3 if self.dim == 2 else 6))
        for kind in map(Kind, np.unique(self.layout.kinds[places]).tolist()):
            mask = self.layout.kinds[places] == kind
            part = delta[self.layout.dof_start[places[mask]][:, None] + np.arange(kind.dof)]
            if kind.is_pose:
                out[mask] = part @ lift_tangent(kind.dim, self.dim).T
            else:
                out[mask, : kind.dim] = part
        return out

    def _carry_frames(self, old: Pose, turn: Array) -> Pose:
        """The frames after the step: each within its parent's submap, then composed along the forest."""
        new, child = old.retract(turn), np.flatnonzero(self._parent >= 0)
        if not len(child):
            return new
        above = self._parent[child]
        inner = _inner(old[above], turn[above], old[child], turn[child])
        assert isinstance(inner, Pose)
        rotation, translation, parent = new.rotation.copy(), new.translation.copy(), self._parent.copy()
        rotation[child], translation[child] = inner.rotation, inner.translation
        while (parent >= 0).any():  # each round doubles how far up a frame is composed
            step = np.flatnonzero(parent >= 0)
            up = parent[step]
            composed = Pose(rotation[up], translation[up]) @ Pose(rotation[step], translation[step])
            rotation[step], translation[step] = composed.rotation, composed.translation
            parent[step] = parent[up]
        return Pose(rotation, translation).sharpened()  # else the errors of a strand would add up, step after step


def _inner(frame: Pose, turn: Array, thing: Pose | Array, delta: Array) -> Pose | Array:
    """Y (+) d_Y: a thing within its frame after the step.

    dy = R'(dT_v - dT) - dw x y and, for poses, dw_y = dw_v - R_y' dw.
    """
    d, group = frame.dim, group_of(frame.dim)
    place = thing.translation if isinstance(thing, Pose) else thing
    within = frame.unact(place)
    back = np.swapaxes(frame.rotation, -1, -2)
    shift = (back @ (delta[:, :d] - turn[:, :d])[..., None])[..., 0]
    shift = shift - (group.hat(turn[:, d:]) @ within[..., None])[..., 0]
    if not isinstance(thing, Pose):
        return np.asarray(within + shift)
    relative = back @ thing.rotation
    of_frame = (np.swapaxes(group.adjoint(relative), -1, -2) @ turn[:, d:, None])[..., 0]
    return Pose(relative @ group.exp(delta[:, d:] - of_frame), within + shift)
