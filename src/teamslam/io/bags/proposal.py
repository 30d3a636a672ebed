"""A first team file for a recording: robots, cameras and topics as they seem to belong together, with what only people
know left open.

One odometry is one robot; of several in one recording each has the topics that begin as its own does (/robot1/odom and
/robot1/camera/tags). A camera is a topic of tags or images, and goes with the calibration beside it (camera_info).
"""

from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from teamslam.io.bags.contents import Contents, TopicContents

COMMON = {"tags", "detections", "tag_detections", "image", "image_raw", "image_rect", "image_color", "compressed"}


def proposal(found: Contents) -> str:
    """The text of a team file (TOML) for what a recording holds; lines to check end in '# ?'."""
    lines = ["[tags]", "size_m = 0.15  # ? the edge of the black square", ""]
    for name, odometry, cameras in _robots(found):
        lines += ["[[robot]]", f"name = {_text(name)}", f"recording = {_text(found.path.name)}"]
        if odometry is not None:
            lines.append(f"odometry = {_text(odometry.name)}")
        lines.append("")
        for camera in cameras:
            lines += [*_camera(camera, found), ""]
    return "\n".join(lines).rstrip() + "\n"


def _robots(found: Contents) -> Iterator[tuple[str, TopicContents | None, Sequence[TopicContents]]]:
    ways = found.of_role("odometry") or found.of_role("pose")[:1]
    seeing = found.of_role("tags") or _images(found) or found.of_role("tag poses")
    if len(ways) < 2:
        yield found.path.stem, ways[0] if ways else None, seeing
        return
    spaces = [_space(way.name) for way in ways]
    if len(set(spaces)) < len(spaces):  # several odometries of one robot: the most frequent is taken
        yield found.path.stem, max(ways, key=lambda way: len(way.stamps_s)), seeing
        return
    for way, space in zip(ways, spaces, strict=True):
        yield space, way, [topic for topic in seeing if _space(topic.name) == space]


def _images(found: Contents) -> list[TopicContents]:
    """The topics of images in which tags can be: none of depth, and of a camera's raw and compressed images one."""
    topics = [topic for topic in found.of_role("image") if "depth" not in topic.name.lower()]
    names = {topic.name for topic in topics}
    return [topic for topic in topics if topic.name.removesuffix("/compressed") not in names - {topic.name}]


def _depths(found: Contents) -> list[TopicContents]:
    """The topics of images of depth that are registered to a camera of colour, by what drivers call them."""
    topics = [t for t in found.of_role("image") if "depth" in t.name.lower()]
    topics = [t for t in topics if "registered" in t.name.lower() or "aligned" in t.name.lower()]
    return sorted(topics, key=lambda topic: topic.name.lower().endswith("compresseddepth"))


def _camera(topic: TopicContents, found: Contents) -> Iterator[str]:
    parent = PurePosixPath(topic.name).parent
    yield "[[robot.camera]]"
    yield f"name = {_text(_called(topic.name))}"
    yield f"{'images' if topic.role == 'image' else 'tags'} = {_text(topic.name)}"
    beside = [c for c in found.of_role("calibration") if PurePosixPath(c.name).parent in (parent, parent.parent)]
    if beside:
        yield f"calibration = {_text(beside[0].name)}"
    else:
        yield 'calibration = "calibration.yaml"  # ? no camera_info beside it: a file of ROS, OpenCV, Kalibr, ...'
    if deep := [t for t in _depths(found) if _space(t.name) == _space(topic.name)]:
        yield f"depth = {_text(deep[0].name)}  # ? registered to this camera, pixel for pixel"
    yield "xyz_m = [0.0, 0.0, 0.0]  # ? where the camera is in the robot's body"
    yield "quaternion_wxyz = [1.0, 0.0, 0.0, 0.0]  # ? and how it is turned (z looks ahead, x to the right)"


def _called(topic: str) -> str:
    """The part of a topic's name that tells one camera from another."""
    parts = [part for part in topic.strip("/").split("/") if part not in COMMON]
    return parts[-1] if parts else topic.strip("/")


def _space(topic: str) -> str:
    return topic.strip("/").split("/")[0]


def _text(words: str) -> str:
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'
