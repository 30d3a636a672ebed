"""A first guess of clocks and latencies, by how robots turned (`frontend.turns`): what least squares then refines.

A camera's latency: how its robot turned between two sightings of a tag that stands still, against its odometry. A
robot's clock: how it turned between two sightings of one of its tags by another robot, whose own turning, by odometry,
is taken out.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.rows import LOOKING, corner_rows
from teamslam.frontend.turns import Turns, carried_along, lateness, turns_between
from teamslam.geometry import Array, IntArray
from teamslam.geometry.resection import resect
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.unknowns import CLOCK, DELAY, Stated

MOST = 3000  # sightings of a camera that are looked at


Looks = Mapping[tuple[int, int], "Look | None"]
"""What each camera of each robot (their places) saw; None where it saw nothing."""


def looks_of(team: Sequence[Seen]) -> Looks:
    """The sightings of all cameras of a team."""
    return {(k, j): Look.of(view) for k, robot in enumerate(team) for j, view in enumerate(robot.views)}


def first_guess(team: Sequence[Seen], stated: Sequence[Stated], looked: Looks) -> Array:
    """The values (k,) from which to start: as stated, but for clocks and latencies that turns tell clearly."""
    values = np.array([one.unknown.stated for one in stated])
    places = {(one.what, one.robot, one.camera): n for n, one in enumerate(stated)}
    late = {(k, j): values[n] for (what, k, j), n in places.items() if what == DELAY}
    for (k, j), before in late.items():
        track, look = team[k].track, looked[k, j]
        if track is not None and look is not None:
            still = look.turns(~look.robots, look.rotations)
            found = lateness(still, track, before)
            late[k, j] = values[places[DELAY, k, j]] = before if found is None else found
    for (what, k, _), n in places.items():
        if what == CLOCK:
            values[n] = _offset(team, k, looked, late, float(values[n]))
    return values


class Look:
    """The sightings (m,) of a camera, some of them where there are many: stamps, tags, whether they are on robots, and
    how they stood in the camera (m, 3, 3)."""

    def __init__(self, view: View) -> None:
        values, white, good = corner_rows(
            view.corners, view.camera, list(view.tags), view.entry.floor_px, view.entry.edge_px
        )
        self.view, self.stamps, self.ids = view, view.corners.ticks[good], view.corners.ids[good]
        self.robots = np.array([tag.is_robot for tag in view.tags], bool)[good]
        self.carriers = np.array([tag.carrier for tag in view.tags], object)[good]
        rays, points = (values[good][:, part].reshape(-1, 4, 3) for part in (slice(0, 12), slice(12, 24)))
        self.rotations = LOOKING.rotation @ resect(rays, points, white[good]).poses.rotation[:, 0]

    @classmethod
    def of(cls, view: View) -> "Look | None":
        """Of a camera that saw something."""
        return cls(_some(view)) if len(view.corners) else None

    def turns(self, rows: Array, rotations: Array, stamps: IntArray | None = None) -> Turns:
        """How what was seen turned."""
        ticks = self.stamps if stamps is None else stamps
        return turns_between(ticks[rows], self.ids[rows], rotations[rows])


def _some(view: View) -> View:
    """Of many sightings a stretch in the middle: neighbours in time stay neighbours."""
    if len(view.corners) <= MOST:
        return view
    first = (len(view.corners) - MOST) // 2
    return view.select(np.argsort(view.corners.ticks, kind="stable")[first : first + MOST])


def _offset(
    team: Sequence[Seen],
    robot: int,
    looked: Looks,
    late: dict[tuple[int, int], float],
    stated: float,
) -> float:
    """How much later a robot's stamps are than those of who sees it: the middle of what each camera tells."""
    mine, found = team[robot].track, []
    for (k, j), look in looked.items():
        track = team[k].track
        if look is None or mine is None or track is None or k == robot:
            continue
        rows = look.robots & (look.carriers == team[robot].entry.name)
        stamps = look.stamps - round(late.get((k, j), look.view.entry.delay_s) * TICKS_PER_S)
        eye = carried_along(track, stamps).rotation @ look.view.entry.pose.rotation
        # to the robot, a stamp of the other's clock is early by its own offset, and late by the other's
        told = lateness(look.turns(rows, eye @ look.rotations, stamps), mine, -stated)
        if told is not None:
            found.append(-told + (team[k].entry.clock.offset_s if k else 0.0))
    return float(np.median(found)) if found else stated
