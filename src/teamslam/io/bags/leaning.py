"""How a camera is turned in its robot, by the axes about which both turned: a team file that says otherwise is told.

A tag that was seen twice says how the camera turned meanwhile, odometry how the robot did. With R the camera in the
body, the vectors of these rotations are b = R c, wherever camera and tag are. Stated is R; what fits best is by Kabsch.
On the ground b is the vertical, and only how the camera leans can be told.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.turns import carried_along, pairs_between
from teamslam.geometry import Array, IntArray, Pose, so3
from teamslam.io.bags.first_guess import Look, Looks
from teamslam.io.bags.seen import Seen

TURNED = 0.25  # [rad]: what turned less has no axis
ALIKE = 0.2  # of an angle: where both tell another, a pose was flipped, or stamps are apart
FEWEST = 12  # rotations
APART, FITS = np.radians(25.0), np.radians(10.0)  # between axes by what is stated, and by what fits best
DIVERSE = 0.1  # of the largest: a second singular value, from which all of R is known


def leaning(team: Sequence[Seen], looked: Looks) -> list[str]:
    """A sentence for each camera that is turned in its robot otherwise than stated."""
    found = (
        _leaning(robot, camera, look)
        for (k, camera), look in looked.items()
        if look is not None and (robot := team[k]).track is not None
    )
    return [sentence for sentence in found if sentence is not None]


def _leaning(robot: Seen, camera: int, look: Look) -> str | None:
    """That of one camera; None where it is as stated, or too little is known."""
    assert robot.track is not None
    rows = np.flatnonzero(~look.robots)
    before, after = (rows[ends] for ends in pairs_between(look.stamps[rows], look.ids[rows]))
    seen = look.rotations[before] @ np.swapaxes(look.rotations[after], -1, -2)
    late = round(robot.views[camera].entry.delay_s * TICKS_PER_S)
    body = _turned(robot.track, look.stamps[before] - late, look.stamps[after] - late)
    mine, theirs = so3.log(seen), so3.log(body)
    angle, other = (np.linalg.norm(v, axis=-1) for v in (mine, theirs))
    good = (np.minimum(angle, other) > TURNED) & (np.abs(angle - other) < ALIKE * other)
    if np.count_nonzero(good) < FEWEST:
        return None
    mine, theirs = mine[good] / angle[good, None], theirs[good] / other[good, None]
    stated = robot.views[camera].entry.pose.rotation
    fits, diverse = _best(mine, theirs)
    if _between(stated, mine, theirs) < APART or _between(fits, mine, theirs) > FITS:
        return None
    who = f"robot {robot.entry.name}, camera {robot.views[camera].entry.name}"
    off = np.degrees(_between(stated, mine, theirs))
    said = f"{who}: it turned about axes that are {off:.0f} degrees from those which quaternion_wxyz has it turn about"
    if diverse:
        turn = Pose(fits, np.zeros(3)).quaternion_wxyz()
        return f"{said}; {[round(float(q), 3) + 0.0 for q in turn]} would fit"
    lean, say = (np.degrees(np.arcsin(np.clip(axes[2, 2], -1.0, 1.0))) for axes in (fits, stated))
    return f"{said}: it looks {lean:.0f} degrees up from the ground, and is said to look {say:.0f}"


def _turned(track: Track, start: IntArray, stop: IntArray) -> Array:
    """How the robot turned from some moments to others (n, 3, 3), in its own axes."""
    before, after = (carried_along(track, ticks).rotation for ticks in (start, stop))
    return np.asarray(np.swapaxes(before, -1, -2) @ after)


def _best(mine: Array, theirs: Array) -> tuple[Array, bool]:
    """The rotation that leads unit vectors (n, 3) to others, and whether they tell all of it."""
    U, s, Vt = np.linalg.svd(theirs.T @ mine)
    flip = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    return U @ flip @ Vt, bool(s[1] > DIVERSE * s[0])


def _between(rotation: Array, mine: Array, theirs: Array) -> float:
    """The angle that half of the pairs are apart at most."""
    return float(np.median(np.arccos(np.clip(np.sum(mine @ rotation.T * theirs, -1), -1.0, 1.0))))
