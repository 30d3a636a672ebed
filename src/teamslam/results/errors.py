"""Errors of a map along each robot's way, in the frame of the map, beside the standard deviations it claims.

A map's covariances are relative to its base pose, so the truth is brought into the map by the truth of that pose: then
the error at the base is 0 and grows away from it, as the covariances say. (Scores such as RMSE align the whole team
instead.) Where the truth of the base is unknown, the whole team is aligned, and the bands are on the wide side.
"""

import numpy as np

from teamslam.metrics import align_team, truth_at_base
from teamslam.metrics.frames import as_kinds
from teamslam.model import Submap, Values
from teamslam.results.tables import submap_robots
from teamslam.solver import Covariances
from teamslam.viz import ErrorTrack

LABELS = {3: ("x", "y", "heading"), 6: ("x", "y", "z", "roll", "pitch", "yaw")}
UNITS = {3: ("m", "m", "rad"), 6: ("m", "m", "m", "rad", "rad", "rad")}


def error_tracks(submap: Submap, truth: Values, covariances: Covariances) -> list[ErrorTrack]:
    """A track for each robot whose true poses are known; empty where nothing can be compared."""
    true = truth_at_base(submap, truth)
    true = truth_by_team(submap, truth) if true is None else true
    start_s = float(min(submap.names.stamps_s(submap.trajectory_keys(r)[0]) for r in submap_robots(submap)))
    tracks = (_track(submap, true, covariances, robot, start_s) for robot in submap_robots(submap))
    return [track for track in tracks if track is not None]


def truth_by_team(submap: Submap, truth: Values) -> Values:
    """The truth of the map's variables in the frame of the map, by one rigid fit of the whole team.

    Empty where the two have nothing in common.
    """
    known = as_kinds(truth, submap.all_values.layout)
    aligned = align_team(submap, truth)
    return known if aligned is None else known.transform(aligned.pose.inverse())


def _track(submap: Submap, truth: Values, covariances: Covariances, robot: int, start_s: float) -> ErrorTrack | None:
    keys = submap.trajectory_keys(robot)
    keys = keys[truth.layout.contains(keys) & (keys != submap.base)]
    if not len(keys):
        return None
    estimate, true = submap.values.only(keys), truth.only(keys)
    error = estimate.minus(true).reshape(len(keys), -1)
    blocks = np.stack(covariances.blocks(estimate.layout.keys))
    dof = error.shape[-1]
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(blocks, error[..., None])[..., 0]) / dof
    sigma = np.sqrt(np.diagonal(blocks, axis1=-2, axis2=-1))
    stamps = submap.names.stamps_s(estimate.layout.keys) - start_s
    return ErrorTrack(submap.names.robot(robot), stamps, error, sigma, nees, LABELS[dof], UNITS[dof])
