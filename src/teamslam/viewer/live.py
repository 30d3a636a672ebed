"""A robot's map in the browser while it drives: the ways and landmarks that it knows of the team, and where it is now.

It is served from a thread of viser's own; a step never waits for who looks at it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.model import Submap, index_of, is_landmark, is_pose, robot_of
from teamslam.robot import Estimate
from teamslam.viewer.server import address_of, follow, framed, started, stopped

COLOURS = ((31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (255, 127, 14), (23, 190, 207))
MARK = (90, 90, 90)


class LiveMap:
    """A map that changes, at `address`. Raises MissingExtraError without viser, InputError where the port is taken."""

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        try:
            self.server: Any = started(host, port)
        except OSError as error:
            raise InputError(f"port {port} cannot be used: {error}", field="view") from None
        self._base: int | None = None
        self._drawn: set[str] = set()
        self._from = np.zeros(3)
        self._look(np.zeros((1, 3)))

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return address_of(self.server)

    def show(self, known: Submap) -> None:
        """The map as it is known now, in place of the one before."""
        scene, drawn = self.server.scene, set[str]()
        for robot, ends in ways(known).items():
            colour = COLOURS[robot % len(COLOURS)]
            scene.add_line_segments(f"/ways/{robot}", ends, colour, thickness=2.0, thickness_units="screen")
            drawn.add(f"/ways/{robot}")
        places = marks(known)
        if places:
            points = np.array(list(places.values()))
            scene.add_point_cloud("/marks", points, MARK, point_size=0.1)
            drawn.add("/marks")
        for name, place in places.items():
            scene.add_label(f"/names/{name}", name, position=place)
            drawn.add(f"/names/{name}")
        for gone in self._drawn - drawn:
            scene.remove_by_name(gone)
        self._base, self._drawn = known.base, drawn
        self._look(known.all_values.positions(np.sort(known.keys), 3))

    def at(self, now: Estimate) -> None:
        """Where the robot is now, if that is written in the frame of the map that is shown."""
        if self._base not in (None, now.frame):
            return
        pose = now.pose.lift(3)
        self.server.scene.add_frame(
            "/now", axes_length=0.5, axes_radius=0.03, wxyz=pose.quaternion_wxyz(), position=pose.translation
        )

    def close(self) -> None:
        """End the server."""
        stopped(self.server)

    def _look(self, places: Array) -> None:
        """So that all places (n, 3) are in view: for who comes, and for who has not looked around."""
        look_at, position = framed(places)
        self.server.initial_camera.look_at, self.server.initial_camera.position = look_at, position
        follow(self.server.get_clients().values(), self._from, look_at, position)
        self._from = position


def ways(known: Submap) -> dict[int, Array]:
    """The ways of a map's robots by number, as pieces (n, 2, 3) between poses that follow each other in time."""
    values = known.all_values
    keys = np.sort(values.layout.keys[is_pose(values.layout.keys)])
    found = {}
    for robot in np.unique(robot_of(keys)).tolist():
        places = values.positions(keys[robot_of(keys) == robot], 3)
        if len(places) > 1:
            found[int(robot)] = np.stack([places[:-1], places[1:]], 1)
    return found


def marks(known: Submap) -> dict[str, Sequence[float]]:
    """The places (3,) of a map's landmarks by name."""
    keys = known.keys[is_landmark(known.keys)]
    called = [known.names.landmark(int(number)) for number in index_of(keys)]
    return dict(zip(called, known.values.positions(keys, 3).tolist(), strict=True))
