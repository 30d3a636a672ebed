"""A robot's recording, or folder of images, read: its streams, and the tags that were looked for in its images."""

from dataclasses import dataclass
from pathlib import Path

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.detect import Looking, of_one_family
from teamslam.io.bags.calibration import camera_in, read_camera
from teamslam.io.bags.looked import Progress, refuse_other_size, tags_in
from teamslam.io.bags.opened import is_recording, opened
from teamslam.io.bags.pictures import Pictures, pictures_of_folder, pictures_of_topic
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.streams import read_corners, read_track
from teamslam.io.bags.team_file import CameraEntry, RobotEntry
from teamslam.model import Dropped


def seen_by(entry: RobotEntry, folder: Path, looking: Looking, progress: Progress | None) -> Seen:
    """A robot's recording, or folder of images, read."""
    path = folder / entry.recording
    if path.is_dir() and not is_recording(path):
        return _seen_in_files(entry, folder, looking, progress)
    with opened(path) as recording:
        track = read_track(recording, entry.odometry) if entry.odometry is not None else None
        truth = read_track(recording, entry.truth) if entry.truth is not None else None
        views, dropped, notes = [], [], []
        for camera in entry.camera:
            if camera.calibration.startswith("/") and camera.calibration in recording.topics:
                known = camera_in(recording, camera.calibration)
            else:
                known = read_camera(
                    folder / camera.calibration, camera.calibration_name, (camera.tags or camera.images,)
                )
            if camera.tags:
                views.append(View(camera, known, read_corners(recording, camera.tags)))
                continue
            look = _look(entry, camera, known, pictures_of_topic(recording, camera.images), looking, progress)
            views.append(look.view)
            dropped += look.dropped
            notes.append(look.note)
        dropped += [Dropped(d.count, f"robot {entry.name}: {d.reason}") for d in recording.dropped]
        return Seen(entry, track, truth, tuple(views), tuple(dropped), tuple(notes))


def _seen_in_files(entry: RobotEntry, folder: Path, looking: Looking, progress: Progress | None) -> Seen:
    """A robot whose recording is a folder of images."""
    path = folder / entry.recording
    for name in ("odometry", "truth"):
        if getattr(entry, name) is not None:
            raise InputError(f"a folder of images has no {name}", path=path, field=f"robot.{name}")
    looks = []
    for camera in entry.camera:
        if not camera.images:
            raise InputError(
                "a folder of images has no topics; name its images with a pattern, images = '*.png'",
                path=path,
                field="robot.camera.images",
            )
        known = read_camera(folder / camera.calibration, camera.calibration_name)
        pictures = pictures_of_folder(path, camera.images, camera.rate_hz)
        looks.append(_look(entry, camera, known, pictures, looking, progress))
    return Seen(
        entry,
        None,
        None,
        tuple(look.view for look in looks),
        tuple(dropped for look in looks for dropped in look.dropped),
        tuple(look.note for look in looks),
    )


@dataclass(frozen=True, eq=False)
class _Look:
    """What came of looking for tags in a camera's images."""

    view: View
    dropped: list[Dropped]
    note: str


def _look(
    entry: RobotEntry,
    camera: CameraEntry,
    known: Camera,
    pictures: Pictures,
    looking: Looking,
    progress: Progress | None,
) -> _Look:
    who = f"robot {entry.name}, camera {camera.name}"
    found = tags_in(pictures, looking, progress, f"tags of {entry.name}, {camera.name}")
    refuse_other_size(found.size, known.size, camera.name)
    corners, twice = of_one_family(found.corners)
    dropped = [Dropped(count, f"{who}: images {reason}") for reason, count in found.lost.items()]
    dropped += [Dropped(count, f"{who}: sightings of tags {reason}") for reason, count in twice.items()]
    note = f"{who}: {len(corners)} sightings of {', '.join(looking.families)} in {len(corners.frames)} images"
    return _Look(View(camera, known, corners), dropped, note)
