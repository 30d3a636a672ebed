"""Maps for rerun (.rrd): a file a map, opened with `rerun map.rrd`.

    map/robots/NAME         the robot's pose over time            (Transform3D)
    map/ways/NAME           its way, always there                 (LineStrips3D)
    map/landmarks           where landmarks are, by name          (Points3D)
    map/regions             95 % ellipsoids of the landmarks      (Ellipsoids3D)

The timeline is `time`, stamps of the log [s]; of logs that count poses it is `pose`.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.io.files.whole import beside, named
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.space import Course, balls, courses
from teamslam.model import Dropped

LANDMARK = (0.48, 0.12, 0.36)


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: its poses and places read back, in 32 bits. InputError where rerun
    is not installed."""
    try:
        import rerun as rr
    except ImportError:
        raise InputError("writing .rrd needs rerun; install it with `pip install teamslam[rerun]`") from None
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        with _recording(rr, file) as recording:
            recording.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            for course in courses(found):
                _log_course(rr, recording, course, found.names.counts)
            _log_landmarks(rr, recording, found)
    poses = sum(len(course.stamps_s) for found in maps for course in courses(found))
    return (Dropped(poses, "covariances of poses: not drawn in .rrd"),) if poses else ()


@contextmanager
def _recording(rr: Any, path: Path) -> Iterator[Any]:
    """A recording that takes the place of `path` once all is in it."""
    draft = beside(path)
    with named(path, draft):
        path.parent.mkdir(parents=True, exist_ok=True)
        recording = rr.RecordingStream("teamslam")
        try:
            recording.save(str(draft))
            yield recording
            recording.flush()
            recording.disconnect()
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)


def _log_course(rr: Any, recording: Any, course: Course, counts: bool) -> None:
    name, colour = rr.escape_entity_path_part(course.robot), [*course.colour, 1.0]
    places, turns = course.poses.translation, np.roll(course.poses.quaternion_wxyz(), -1, axis=-1)
    recording.log(f"map/ways/{name}", rr.LineStrips3D([places], colors=[colour]), static=True)
    time = (
        rr.TimeColumn("pose", sequence=course.stamps_s.astype(np.int64))
        if counts
        else rr.TimeColumn("time", duration=course.stamps_s)
    )
    columns = rr.Transform3D.columns(translation=places, quaternion=turns)
    recording.send_columns(f"map/robots/{name}", indexes=[time], columns=columns)
    size = 0.02 * float(np.ptp(places, axis=0).max() or 1.0)
    arrow = rr.Arrows3D(vectors=[[size, 0.0, 0.0]], colors=[colour], labels=[course.robot])
    recording.log(f"map/robots/{name}", arrow, static=True)


def _log_landmarks(rr: Any, recording: Any, found: MapEstimate) -> None:
    seen = balls(found)
    if not len(seen.places):
        return
    look = {"labels": seen.names, "colors": [*LANDMARK, 1.0]}
    recording.log("map/landmarks", rr.Points3D(seen.places, **look, show_labels=len(seen.names) <= 60), static=True)
    if len(seen.half_axes):
        turns = np.roll(seen.turns.quaternion_wxyz(), -1, axis=-1)
        regions = rr.Ellipsoids3D(
            centers=seen.places, half_sizes=seen.half_axes, quaternions=turns, colors=[*LANDMARK, 1.0]
        )
        recording.log("map/regions", regions, static=True)
