"""A server of viser that says nothing on stdout, whose words are its caller's; and where to look from."""

import logging
from collections.abc import Iterable
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import numpy as np

from teamslam.errors import MissingExtraError
from teamslam.geometry import Array

FROM = np.array([-0.2, -0.5, 0.45])  # the direction from which maps are looked at
FIELD_RAD = np.deg2rad(75.0)  # of view, from top to bottom: viser's own


def started(host: str, port: int) -> Any:
    """A server that runs. Raises MissingExtraError without viser, OSError where the port cannot be had."""
    try:
        import viser
    except ModuleNotFoundError:
        raise MissingExtraError("the map in the browser needs viser: pip install 'teamslam[view]'") from None
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # browsers connect ahead, and may ask nothing
    with redirect_stdout(StringIO()):  # its greeting: whoever starts it says where it is
        server = viser.ViserServer(host=host, port=port, label="teamslam", verbose=False)
    server.scene.set_up_direction("+z")
    return server


def stopped(server: Any) -> None:
    """It runs no more."""
    with redirect_stdout(StringIO()):  # its farewell
        server.stop()


def address_of(server: Any) -> str:
    """Where a browser finds it."""
    return f"http://{server.get_host()}:{server.get_port()}"


def framed(places: Array) -> tuple[Array, Array]:
    """What to look at, and from where, both (3,), so that all places (n, 3) are in view."""
    low, high = places.min(0), places.max(0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0
    away = 0.5 * size / np.sin(0.5 * FIELD_RAD)  # of the ball around all of it
    return middle, middle + away * FROM / np.linalg.norm(FROM)


def follow(clients: Iterable[Any], before: Array, look_at: Array, position: Array) -> None:
    """Move the cameras of those who look on from where they were put `before` (3,); who has looked around stays."""
    for client in clients:
        camera = client.camera
        try:
            at = camera.position
        except AssertionError:  # it has not said yet where it is, and begins where the next begin
            continue
        if np.allclose(at, before, rtol=1e-3, atol=1e-3):
            camera.position, camera.look_at = position, look_at
