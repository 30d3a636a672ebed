"""A robot's map in the browser while it drives: the ways and landmarks that it knows of the team, and where it is now.

It is served from a thread of viser's own; a step never waits for who looks at it.
"""

from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.geometry import Array
from teamslam.model import Submap, index_of, is_landmark, is_pose, robot_of
from teamslam.robot import Estimate

COLOURS = ((31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (255, 127, 14), (23, 190, 207))
MARK = (90, 90, 90)


class LiveMap:
    """A map that changes, at `address`. Raises MissingExtraError without viser, InputError where the port is taken."""

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        try:
            import viser
        except ModuleNotFoundError:
            raise MissingExtraError("a live map needs viser: pip install 'teamslam[view]'") from None
        try:
            with redirect_stdout(StringIO()):  # its greeting: whoever starts it says where it is
                self.server: Any = viser.ViserServer(host=host, port=port, label="teamslam", verbose=False)
        except OSError as error:
            raise InputError(f"port {port} cannot be used: {error}", field="view") from None
        self.server.scene.set_up_direction("+z")
        self._base: int | None = None
        self._drawn: set[str] = set()

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

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
        self.server.stop()


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
