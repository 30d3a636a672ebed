"""Errors of a map along each robot's way, in the frame of the map, beside the standard deviations it claims.

A map's covariances are relative to its base pose, so the truth is brought into the map by the truth of that pose: then
the error at the base is 0 and grows away from it, as the covariances say. (Scores such as RMSE align the whole team
instead.) Where the truth of the base is unknown, the whole team is aligned, and the bands are on the wide side.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.metrics import align_team, truth_at_base
from teamslam.metrics.frames import as_kinds
from teamslam.model import WORLD, Kind, Submap, Values, is_landmark
from teamslam.solver import Covariances
from teamslam.viz import ErrorTrack

LABELS = {3: ("x", "y", "heading"), 6: ("x", "y", "z", "rx", "ry", "rz")}
UNITS = {3: ("m", "m", "rad"), 6: ("m", "m", "m", "rad", "rad", "rad")}


@dataclass(frozen=True, eq=False)
class Tracks:
    """A track for each robot whose true poses are known, and in words the frame that they are in."""

    tracks: list[ErrorTrack]
    frame: str


def error_tracks(submap: Submap, truth: Values, covariances: Covariances) -> Tracks:
    """The errors of all robots along their ways; no track where nothing can be compared."""
    true, frame = truth_at_base(submap, truth), f"in the frame of {submap.names.describe(submap.base)}"
    if submap.base == WORLD:
        frame = "in the world frame, without any alignment"
    if true is None:
        true = truth_by_team(submap, truth)
        frame = f"after one alignment of the team: no truth of {submap.names.describe(submap.base)}"
    firsts = [submap.names.stamps_s(submap.trajectory_keys(r)[0]) for r in submap.robots_in_it]
    start_s = float(min(firsts, default=np.float64(0.0)))
    tracks = (_track(submap, true, covariances, robot, start_s) for robot in submap.robots_in_it)
    return Tracks([track for track in tracks if track is not None], frame)


def truth_by_team(submap: Submap, truth: Values) -> Values:
    """The truth of the map's variables in the frame of the map, by one rigid fit of the whole team; of landmarks of
    which nobody says how they are turned, where they are.

    Empty where the two have nothing in common, or too little to hold the fit.
    """
    aligned = align_team(submap, truth)
    if aligned is None or not aligned.held:
        return Values.of({})
    layout = submap.all_values.layout
    known, keys = as_kinds(truth, layout), truth.layout.keys
    alone = is_landmark(keys) & layout.contains(keys) & ~known.layout.contains(keys)
    told, held = truth.layout.kinds[alone].tolist(), layout.kinds[layout.index(keys[alone])].tolist()
    alone[alone] = [Kind(a).dim >= Kind(b).dim for a, b in zip(told, held, strict=True)]
    return known.update(truth.select(alone)).transform(aligned.pose.inverse())


def _track(submap: Submap, truth: Values, covariances: Covariances, robot: int, start_s: float) -> ErrorTrack | None:
    keys = submap.trajectory_keys(robot)
    keys = keys[truth.layout.contains(keys) & (keys != submap.base)]
    if not len(keys):
        return None
    estimate, true = submap.values.only(keys), truth.only(keys)
    error = estimate.minus(true).reshape(len(keys), -1)
    blocks = np.array(covariances.blocks(estimate.layout.keys))
    dof = error.shape[-1]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(blocks, error[..., None])[..., 0]) / dof
    sigma = np.sqrt(np.diagonal(blocks, axis1=-2, axis2=-1))
    stamps = submap.names.stamps_s(estimate.layout.keys) - start_s
    return ErrorTrack(submap.names.robot(robot), stamps, error, sigma, nees, LABELS[dof], UNITS[dof])
