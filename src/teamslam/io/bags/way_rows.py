"""A robot's way as a table: odometry between its keyframes, or the ties of a camera that was carried by hand."""

import numpy as np

from teamslam.frontend.stamps import keyframe_of
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.way import Steps, diagonal, standing, steps_between
from teamslam.frontend.way_noise import WayNoise
from teamslam.geometry import IntArray, Pose
from teamslam.io.bags.seen import Book, Seen
from teamslam.model import Table, pack, pose_key, whitening
from teamslam.model.sparse import sp


def way_of(robot: Seen, number: int, ticks: IntArray, book: Book) -> list[Table]:
    """The odometry of a robot between keyframes at `ticks`; none where it has but one. `book` notes what it found."""
    noise, dim = robot.entry.motion, robot.entry.dim
    if robot.track is not None:
        pairs = np.stack([ticks[:-1], ticks[1:]], -1)
        steps = steps_between(robot.track, ticks, noise)
        poses, covariances = steps.poses, steps.covariances
        book.notes += _told(robot, steps, ticks, noise)
    else:
        pairs = _ties(robot, ticks)
        poses, variances = standing((pairs[:, 1] - pairs[:, 0]) / TICKS_PER_S, noise)
        covariances = diagonal(variances)
        book.notes.append(
            f"robot {robot.entry.name} has no odometry: {_model(noise)} those of its frames that tags tie to each "
            f"other, in {len(ticks) - len(pairs)} parts"
        )
    if not len(pairs):
        return []
    if dim == 2:
        poses = Pose.from_xytheta(poses.xytheta())
        covariances = covariances[:, [[0], [1], [5]], [0, 1, 5]]
    pairs = pose_key(number, pairs)
    return [
        Table(
            number, "odometry", "relative_pose", dim, pairs, pack(poses), whitening(covariances), np.arange(len(pairs))
        )
    ]


def _ties(robot: Seen, ticks: IntArray) -> IntArray:
    """Pairs (n, 2) of keyframes of a robot without odometry: each with the next of those that share tags with it, or
    with others that do, and so on. Between such parts nothing is known, not even that the camera hardly moved."""
    from scipy.sparse.csgraph import connected_components

    views = robot.views
    frame = np.concatenate(
        [np.zeros(0, np.int64), *(np.searchsorted(ticks, keyframe_of(ticks, v.ticks)) for v in views)]
    )
    names, mark = np.unique([tag.carrier for v in views for tag in v.tags], return_inverse=True)
    n = len(ticks)
    graph = sp.coo_array((np.ones(len(frame)), (frame, n + mark)), shape=(n + len(names),) * 2)
    part = np.asarray(connected_components(graph, directed=False)[1], np.int64)[:n]
    order = np.lexsort([ticks, part])
    same = np.diff(part[order]) == 0
    pairs = np.stack([ticks[order[:-1]][same], ticks[order[1:]][same]], -1)
    return np.asarray(pairs[np.argsort(pairs[:, 0], kind="stable")])


def _model(noise: WayNoise) -> str:
    return f"the motion model ({noise.speed_m_s:g} m/s, {noise.turn_rad_s:g} rad/s) ties"


def _told(robot: Seen, steps: Steps, ticks: IntArray, noise: WayNoise) -> list[str]:
    """What is to be said of a robot's way."""
    assert robot.track is not None
    who, model = f"robot {robot.entry.name}", f"{_model(noise)} its frames"
    notes = []
    if len(steps.jumps):
        at = ", ".join(f"{(tick - robot.track.ticks.min()) / TICKS_PER_S:.2f} s" for tick in steps.jumps[:8].tolist())
        more = f" and {len(steps.jumps) - 8} more" if len(steps.jumps) > 8 else ""
        notes.append(f"{who}: odometry jumped {len(steps.jumps)} times, at {at}{more} after its start; {model} there")
    track = robot.track.ticks
    if len(track) and len(ticks) and (track.max() < ticks[0] or track.min() > ticks[-1]):
        notes.append(
            f"{who}: its odometry is stamped {_span(track)}, and sightings {_span(ticks)}, so that it says nothing of "
            f"them; {model} throughout. Are these stamps by different clocks?"
        )
    elif steps.missing:
        notes.append(f"{who}: odometry is missing in {steps.missing} of {len(ticks) - 1} steps; {model} there")
    return notes


def _span(ticks: IntArray) -> str:
    return f"{ticks.min() / TICKS_PER_S:.1f} s to {ticks.max() / TICKS_PER_S:.1f} s"
