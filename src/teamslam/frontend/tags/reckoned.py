"""Tags whose number stands at several places, told by the way that a robot drove between its sightings of them.

    place:   a tag's centre by a sighting, where dead reckoning has it
    same:    two sightings are of one place where they are no farther apart than

                 SLACK_M + SLACK (way driven between + how far off the tag was each time) + SIGMAS s

             s^2 the largest variance of the place, by odometry's noise between the two: X_k moves a place p by
             t + w x p, and covariances of (t, w) in the frame of the start add up along the way
    apart:   a sighting that is of none of the places so far, each by the nearest of its FEWEST latest sightings (the
             last one may be a misread), is at a new one

The slack is for what nobody stated: a wrong edge, a camera that is turned in the body, a clock that is late, wheels of
another size. A place of fewer than FEWEST sightings is a misread, not a place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.frontend.tags.identities import SLACK, SLACK_M, Place, places_in_time
from teamslam.frontend.tags.whole_poses import hypotheses
from teamslam.geometry import Array, IntArray, Pose, compose_along, lift_tangent, so3
from teamslam.model import Kind, Table, index_of, is_landmark, unpack

SIGMAS = 6.0
FEWEST = 3


def places_by_way(tables: Sequence[Table], way: Sequence[Table]) -> list[Place]:
    """The places of all tags of one robot's sightings that have more than one; `way` holds its odometry, a step from
    each keyframe to the next, or nothing: then nobody is told apart."""
    seen = [t.select(is_landmark(t.keys[:, 1])) for t in tables if t.model == "corners"]
    seen = [t for t in seen if len(t)]
    if not seen or not any(len(table) for table in way):
        return []
    reckoning = _Reckoning.of(way[0])
    keys, centres = np.concatenate([t.keys for t in seen]), np.concatenate([_centres(t) for t in seen])
    at = np.searchsorted(reckoning.keys, keys[:, 0])
    order = np.lexsort([at, keys[:, 1]])
    out: list[Place] = []
    for tag in np.unique(keys[:, 1]).tolist():
        own = order[keys[order, 1] == tag]
        out += _told(tag, index_of(keys[own, 0]), _seats(reckoning, at[own], centres[own]))
    return out


@dataclass(frozen=True, eq=False)
class _Reckoning:
    """A way by odometry: poses (n,) of keyframes `keys` in the frame of the first, the way driven until each (n,), and
    the covariance (n, 6, 6) of what noise until each adds to the place t + w x p of whatever is seen after it."""

    keys: IntArray
    poses: Pose
    driven: Array
    noise: Array

    @classmethod
    def of(cls, way: Table) -> "_Reckoning":
        steps = unpack(way.values, Kind(way.dim - 2))
        assert isinstance(steps, Pose)
        lifted = steps.lift(3)
        led = compose_along(lifted)
        up = lift_tangent(way.dim, 3)
        covariances = up @ np.linalg.inv(np.swapaxes(way.whitening, 1, 2) @ way.whitening) @ up.T
        shift = np.zeros((len(lifted), 6, 6))  # of t and w by a step's own noise: places turn about where it ends
        before, after = led.rotation[:-1], led.rotation[1:]
        shift[:, :3, :3], shift[:, 3:, 3:] = before, after
        shift[:, :3, 3:] = so3.hat(led.translation[1:]) @ after
        added = shift @ covariances @ np.swapaxes(shift, 1, 2)
        return cls(
            np.concatenate([way.keys[:1, 0], way.keys[:, 1]]),
            led,
            np.concatenate([[0.0], np.cumsum(np.linalg.norm(lifted.translation, axis=1))]),
            np.concatenate([np.zeros((1, 6, 6)), np.cumsum(added, 0)]),
        )

    def spread(self, first: int, last: int, place: Array) -> float:
        """How well a place (3,) that was seen at both keyframes is known from the one at the other, one sigma [m]."""
        move = np.concatenate([np.eye(3), -so3.hat(place[None])[0]], 1)
        return float(np.sqrt(np.linalg.eigvalsh(move @ (self.noise[last] - self.noise[first]) @ move.T)[-1].clip(0.0)))


def _centres(table: Table) -> Array:
    """Where the tag of each row is in its observer (m, 3), by the pose that fits best."""
    return np.asarray(hypotheses(table)[0].translation[:, 0])


def _seats(reckoning: _Reckoning, at: IntArray, centres: Array) -> IntArray:
    """Which place (k,) each sighting of a tag is of, in the order of time: from keyframes `at`, of `centres` (k, 3)."""
    led, away = reckoning.poses[at].act(centres), np.linalg.norm(centres, axis=1)
    latest: list[list[int]] = []
    seat = np.zeros(len(at), np.int64)
    for k in range(len(at)):
        apart = [min(_apart(reckoning, at, led, away, one, k) for one in some) for some in latest]
        if apart and min(apart) < 1.0:
            seat[k] = int(np.argmin(apart))
            latest[seat[k]] = [*latest[seat[k]], k][-FEWEST:]
        else:
            seat[k] = len(latest)
            latest.append([k])
    return seat


def _apart(reckoning: _Reckoning, at: IntArray, led: Array, away: Array, one: int, other: int) -> float:
    """How far two sightings of a tag are apart, over what explains that."""
    first, last = int(at[one]), int(at[other])
    driven = reckoning.driven[last] - reckoning.driven[first]
    allowed = SLACK_M + SLACK * (driven + away[one] + away[other]) + SIGMAS * reckoning.spread(first, last, led[other])
    return float(np.linalg.norm(led[one] - led[other]) / allowed)


def _told(tag: int, ticks: IntArray, seat: IntArray) -> list[Place]:
    """A tag's places, where there are several: a place of few sightings is none."""
    kept = np.isin(seat, [place for place in np.unique(seat).tolist() if np.count_nonzero(seat == place) >= FEWEST])
    return places_in_time(tag, ticks[kept], ticks[kept], seat[kept])
