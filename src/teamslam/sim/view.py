"""What is in view: pairs of poses and targets within a sensor's range and field of view."""

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, directions


def landmarks_in_view(eyes: Pose, points: Array, range_m: float, field_of_view_rad: float) -> tuple[IntArray, IntArray]:
    """Which of the sensors `eyes` (n,) sees which of `points` (k, d): two index arrays, rising by eye, then point."""
    from scipy.spatial import cKDTree

    if not len(points):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = list(cKDTree(points).query_ball_point(eyes.translation, range_m, return_sorted=True))
    seen_by = [np.asarray(f, np.int64) for f in found]
    at = np.repeat(np.arange(len(seen_by)), [len(s) for s in seen_by])
    seen = np.concatenate(seen_by)
    keep = _within(eyes[at].unact(points[seen]), range_m, field_of_view_rad)
    return at[keep], seen[keep]


def robot_in_view(eyes: Pose, others: Array, range_m: float, field_of_view_rad: float) -> IntArray:
    """At which of n instants the sensors `eyes` (n,) see a robot that is then at `others` (n, d)."""
    return np.flatnonzero(_within(eyes.unact(others), range_m, field_of_view_rad))


def _within(seen: Array, range_m: float, field_of_view_rad: float) -> Array:
    distance = np.linalg.norm(seen, axis=-1)
    ahead = seen[..., 0] >= np.cos(0.5 * field_of_view_rad) * distance
    # A target at the sensor itself has no direction, and no instrument reports it.
    return np.asarray((distance <= range_m) & (distance > 1e-6) & (ahead | (field_of_view_rad >= 2.0 * np.pi)))


def anywhere_in_view(count: int, dim: int, range_m: float, field_of_view_rad: float, rng: np.random.Generator) -> Pose:
    """False alarms: targets spread evenly over distance and direction within view, turned at random."""
    distance = rng.uniform(0.0, range_m, (count, 1))
    return Pose.scattered(distance * directions(dim).cone(count, field_of_view_rad, rng), rng)
