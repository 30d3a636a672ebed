"""A robot's recording, video or folder of images, read: its streams, and the tags that were looked for in images."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.bent import straightened
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.detect import Looking, of_one_family
from teamslam.frontend.tags.implied import TagPoses, implied_corners
from teamslam.io.bags.calibration import camera_in, read_camera
from teamslam.io.bags.depths import with_depths
from teamslam.io.bags.image_stamps import read_stamps
from teamslam.io.bags.looked import Progress, refuse_other_size, tags_in
from teamslam.io.bags.opened import Recording, is_recording, opened
from teamslam.io.bags.pictures import Pictures, pictures_of_folder, pictures_of_topic
from teamslam.io.bags.roles import ROLES
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.streams import enclosed, read_corners, read_tag_poses, read_track
from teamslam.io.bags.team_file import CameraEntry, RobotEntry, TeamFile
from teamslam.io.bags.videos import is_video, pictures_of_video
from teamslam.model import Dropped

SIZE_DIFFERS = 0.01  # of a tag's edge, from where on it is told


def seen_by(entry: RobotEntry, folder: Path, team: TeamFile, progress: Progress | None) -> Seen:
    """A robot's recording, video or folder of images, read."""
    if (path := _files(entry, folder)) is not None:
        return _seen_in_files(entry, path, folder, team.tags.looking(), progress)
    with opened(_parts(entry, folder)) as recording:
        track = read_track(recording, entry.odometry) if entry.odometry is not None else None
        truth = read_track(recording, entry.truth) if entry.truth is not None else None
        looks = [_seen_by_camera(entry, camera, folder, recording, team, progress) for camera in entry.camera]
        views = [look.view for look in looks]
        dropped = [left for look in looks for left in look.dropped]
        notes = [look.note for look in looks if look.note]
        for k, camera in enumerate(entry.camera):
            if camera.depth:
                deep = with_depths(views[k], recording, f"robot {entry.name}, camera {camera.name}")
                views[k] = deep.view
                dropped += deep.dropped
                notes.append(deep.note)
        dropped += [Dropped(d.count, f"robot {entry.name}: {d.reason}") for d in recording.dropped]
        read = [entry.odometry, entry.truth, *(camera.tags or camera.images for camera in entry.camera)]
        notes += [
            f"robot {entry.name}: messages of {topic} have no time in their headers; that at which they were recorded "
            f"stands for it, which is later by as long as they took"
            for topic in dict.fromkeys(read)
            if topic in recording.unstamped
        ]
        return Seen(entry, track, truth, tuple(views), tuple(dropped), tuple(notes))


def _seen_by_camera(
    entry: RobotEntry,
    camera: CameraEntry,
    folder: Path,
    recording: Recording,
    team: TeamFile,
    progress: Progress | None,
) -> "_Look":
    """What a camera of a recording saw: as a detector told it, or in its images."""
    known = _camera_of(camera, folder, recording)
    if camera.tags and _role(recording, camera.tags) == "tag poses":
        return _implied(entry, camera, known, read_tag_poses(recording, camera.tags), team)
    if camera.tags:
        corners = read_corners(recording, camera.tags)
        return _Look(View(camera, known, corners), [], _askew(corners, f"robot {entry.name}, camera {camera.name}"))
    pictures = pictures_of_topic(recording, camera.images)
    return _look(entry, camera, known, pictures, team.tags.looking(), progress)


def cameras_of(entry: RobotEntry, folder: Path) -> tuple[Camera, ...]:
    """The calibrated cameras of a robot, in the order of its entry."""
    if _files(entry, folder) is not None:
        return tuple(_camera_of(camera, folder, None) for camera in entry.camera)
    with opened(_parts(entry, folder)) as recording:
        return tuple(_camera_of(camera, folder, recording) for camera in entry.camera)


@contextmanager
def images_of(entry: RobotEntry, camera: CameraEntry, folder: Path) -> Iterator[Pictures]:
    """The images of a camera, while its recording is open."""
    if (path := _files(entry, folder)) is not None:
        yield _pictures_in_files(path, camera, folder)
        return
    with opened(_parts(entry, folder)) as recording:
        yield pictures_of_topic(recording, camera.images)


def _parts(entry: RobotEntry, folder: Path) -> list[Path]:
    """Where a robot's recording is, or its parts."""
    return [folder / part for part in entry.parts]


def _files(entry: RobotEntry, folder: Path) -> Path | None:
    """The video or the folder of images that is a robot's recording; None where it is one of ROS. InputError for a list
    of such."""
    paths = _parts(entry, folder)
    found = [path for path in paths if is_video(path) or (path.is_dir() and not is_recording(path))]
    if not found or len(paths) == 1:
        return found[0] if found else None
    raise InputError(
        "only recordings of ROS come in parts; of videos and folders of images give each its own robot",
        path=found[0],
        field="robot.recording",
    )


def _pictures_in_files(path: Path, camera: CameraEntry, folder: Path) -> Pictures:
    stamps = read_stamps(folder / camera.stamps) if camera.stamps else None
    if is_video(path):
        return pictures_of_video(path, camera.rate_hz, None if stamps is None else stamps[1])
    return pictures_of_folder(path, camera.images, camera.rate_hz, stamps)


def _camera_of(camera: CameraEntry, folder: Path, recording: Recording | None) -> Camera:
    return _calibrated(camera, folder, recording).longer(camera.focal_scale).shifted(*camera.centre_px)


def _calibrated(camera: CameraEntry, folder: Path, recording: Recording | None) -> Camera:
    file = (folder / camera.calibration).is_file()
    topic = camera.calibration.startswith("/") and "." not in camera.calibration  # of which no topic has one
    if recording is not None and not file and (topic or camera.calibration in recording.topics):
        return camera_in(recording, camera.calibration, rectified=camera.rectified)
    if camera.rectified:
        raise InputError(
            "only a topic of camera_info says what rectified images are like; of a file give the calibration of these, "
            "without distortion, and leave `rectified` out",
            path=folder / camera.calibration,
            field="robot.camera.rectified",
        )
    topics = () if recording is None else (camera.tags or camera.images,)
    return read_camera(folder / camera.calibration, camera.calibration_name, topics)


def _seen_in_files(entry: RobotEntry, path: Path, folder: Path, looking: Looking, progress: Progress | None) -> Seen:
    """A robot whose recording is a video, or a folder of images."""
    kind = "folder of images" if path.is_dir() else "video"
    for name in ("odometry", "truth"):
        if getattr(entry, name) is not None:
            raise InputError(f"a {kind} has no {name}", path=path, field=f"robot.{name}")
    looks = []
    for camera in entry.camera:
        if camera.depth:
            raise InputError(f"a {kind} has no topic of depths", path=path, field="robot.camera.depth")
        if not camera.images:
            raise InputError(
                f"a {kind} has no topics; name its images with a pattern, images = '*.png' (of a video: '*')",
                path=path,
                field="robot.camera.images",
            )
        known = _camera_of(camera, folder, None)
        looks.append(_look(entry, camera, known, _pictures_in_files(path, camera, folder), looking, progress))
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


def _askew(seen: TagCorners, who: str) -> str:
    """A sentence where corners that a detector told go round the wrong way; else nothing."""
    wrong = int(np.count_nonzero(enclosed(seen.corners) < 0.0))
    if not wrong:
        return ""
    return (
        f"{who}: the corners of {wrong} of {len(seen)} sightings go round the wrong way (right is: bottom left, bottom "
        f"right, top right, top left), so that these tags seem to be seen from behind; does the detector name corners "
        f"in another order, or are images mirrored?"
    )


def _role(recording: Recording, topic: str) -> str:
    types, _ = recording.topics.get(topic, (("",), 0))
    return ROLES.get(types[0], "")


def _implied(entry: RobotEntry, camera: CameraEntry, known: Camera, seen: TagPoses, team: TeamFile) -> "_Look":
    """Poses of tags as the corners that they imply."""
    carried, who = team.carried(), f"robot {entry.name}, camera {camera.name}"
    sizes = np.array([carried[n].size_m if n in carried else team.size_of(n) for n in seen.ids.tolist()])
    corners, unseen = implied_corners(seen, known, sizes)
    count = int(unseen.sum())
    dropped = [Dropped(count, f"{who}: poses of tags that this camera cannot have seen")] if count else []
    told = np.isfinite(seen.sizes_m) & (np.abs(seen.sizes_m / sizes - 1.0) > SIZE_DIFFERS)
    note = f"{who}: {len(corners)} sightings of tags came as poses; they count as the corners that these imply"
    numbers = dict[tuple[str, str], list[str]]()
    for number in np.unique(seen.ids[told]).tolist():
        row = int(np.flatnonzero(told & (seen.ids == number))[0])
        numbers.setdefault((f"{seen.sizes_m[row]:g}", f"{sizes[row]:g}"), []).append(str(number))
    for (theirs, ours), tags in numbers.items():
        which = f"tag{'s' * (len(tags) > 1)} {', '.join(tags)}"
        note += f"; the detector took {which} for {theirs} m, and the team file says {ours} m"
    return _Look(View(camera, known, corners), dropped, note)


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
    return _Look(View(camera, known, straightened(corners, known)), dropped, note)
