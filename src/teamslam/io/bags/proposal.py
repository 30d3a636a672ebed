"""A first team file for a recording: robots, cameras and topics as they seem to belong together, with what only people
know left open.

One odometry is one robot. Of several in one recording each has the topics that begin as its own does (/robot1/odom and
/robot1/camera/tags); where no camera's topic begins so, they are several of one robot. A camera is a topic of tags or
images, and goes with the calibration beside it (camera_info). Poses whose topic is called after motion capture, or the
truth, are no odometry.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from os.path import commonpath
from pathlib import PurePosixPath

import numpy as np

from teamslam.geometry import Array
from teamslam.io.bags.contents import Contents, TopicContents
from teamslam.io.bags.roles import TRUTH
from teamslam.io.bags.tree import body_of, standing_in

CLOCKS_S = 0.5  # between the clocks of robots in one recording: what is less, runs find by themselves
COMMON = {"tags", "detections", "tag_detections", "image", "image_raw", "image_rect", "image_color", "compressed"}


def proposal(*recordings: Contents) -> str:
    """The text of a team file (TOML) for what recordings hold, each of robots of its own; lines to check end in '# ?'.
    It is to lie beside them, or in the folder that has all of their folders in it."""
    folder = commonpath([path.absolute().parent for found in recordings for path in found.paths])
    lines = ["[tags]", "size_m = 0.15  # ? the edge of the black square", ""]
    stems = [_stem(found) for found in recordings]
    if len(set(stems)) < len(stems):
        stems = [found.paths[0].absolute().parent.name for found in recordings]
    for k, found in enumerate(recordings):
        stem = stems[k] if stems.count(stems[k]) == 1 else f"{stems[k]}_{k + 1}"
        lines += _proposed(found, stem, folder)
    return "\n".join(lines).rstrip() + "\n"


def _proposed(found: Contents, stem: str, folder: str) -> Iterator[str]:
    """The lines of one recording; of its robots, where it is of one, called `stem`."""
    robots, lines = list(_robots(found, stem)), list[str]()
    for robot in robots:
        lines += ["[[robot]]", f"name = {_text(robot.name)}", f"recording = {_recording(found, folder)}"]
        if robot.ways:
            others = " or ".join(way.name for way in robot.ways[1:])
            others = f"  # ? or {others}" if others else "  # ? by tf" if "->" in robot.ways[0].name else ""
            lines.append(f"odometry = {_text(robot.ways[0].name)}{others}")
            if robot.ways[0].planar:
                lines.append("# dim = 2  # ? on the ground: this odometry never leaves the plane")
        if (apart := round(_late(robot) - _late(robots[0]), 2)) and abs(apart) > CLOCKS_S:
            lines.append(
                f"clock = {{ offset_s = {apart} }}  # ? by when messages were recorded, its stamps are so much later "
                f"than those of {robots[0].name}"
            )
        for truth in _truths(found):
            if len(robots) == 1 or robot.name in truth.name.split("/"):
                lines.append(f"truth = {_text(truth.name)}  # ? results are scored against it, no map is made by it")
                break
        lines.append("")
        for camera, called in zip(robot.cameras, _names(robot.cameras), strict=True):
            body = robot.ways[0].frames[1] if robot.ways else ""
            lines += [*_camera(camera, called, found, body), ""]
    told = {camera.name for robot in robots for camera in robot.cameras}
    yield from lines
    yield from (f"# {topic.name}: ? a camera of which robot" for topic in _seeing(found) if topic.name not in told)


@dataclass(frozen=True)
class _Robot:
    """A robot, its odometry, the likeliest first, and the topics of its cameras."""

    name: str
    ways: Sequence[TopicContents]
    cameras: Sequence[TopicContents]


def _robots(found: Contents, stem: str) -> Iterator[_Robot]:
    ways, seeing = _ways(found), _seeing(found)
    spaces = [_space(way.name) for way in ways]
    own = [[topic for topic in seeing if _space(topic.name) == space] for space in spaces]
    if len(ways) < 2 or len(set(spaces)) < len(spaces) or (seeing and not any(own)):
        yield _Robot(stem, sorted(ways, key=lambda way: -len(way.stamps_s)), seeing)
        return
    for way, space, cameras in zip(ways, spaces, own, strict=True):
        yield _Robot(space, [way], cameras)


def _late(robot: _Robot) -> float:
    """By how much a robot's stamps are later than when they were recorded."""
    return float(np.median([topic.late_s for topic in (*robot.ways[:1], *robot.cameras)] or [0.0]))


def _recording(found: Contents, folder: str) -> str:
    """Where it is, as seen from a folder, or the list of its parts."""
    names = [_text(path.absolute().relative_to(folder).as_posix()) for path in found.paths]
    return names[0] if len(names) == 1 else f"[{', '.join(names)}]"


def _stem(found: Contents) -> str:
    """What a recording is called; of several parts what their names begin with."""
    first, *others = (path.stem for path in found.paths)
    letters = takewhile(lambda alike: len(set(alike)) == 1, zip(first, *others, strict=False))
    return (first if not others else "".join(letter for letter, *_ in letters).rstrip("_-. ")) or first


def _ways(found: Contents) -> list[TopicContents]:
    """The topics that say how robots moved."""
    odometry, poses = ([t for t in found.of_role(role) if not TRUTH.search(t.name)] for role in ("odometry", "pose"))
    return odometry or poses[:1]


def _truths(found: Contents) -> list[TopicContents]:
    """The topics that say where robots truly were."""
    return [t for role in ("pose", "odometry") for t in found.of_role(role) if TRUTH.search(t.name)]


def _seeing(found: Contents) -> Sequence[TopicContents]:
    """The topics of cameras: of tags, or else of images."""
    return found.of_role("tags") or _images(found) or found.of_role("tag poses")


def _images(found: Contents) -> list[TopicContents]:
    """The topics of images in which tags can be: none of depth, and of those that one camera has (raw, rectified, in
    colour, compressed) one: not compressed before compressed, raw before others."""
    topics = [topic for topic in found.of_role("image") if "depth" not in topic.name.lower()]
    best: dict[str, TopicContents] = {}
    for topic in sorted(topics, key=lambda t: (t.name.endswith("/compressed"), not _plain(t).endswith("raw"), t.name)):
        name = PurePosixPath(_plain(topic))
        best.setdefault(str(name.parent) if name.name.startswith("image") else str(name), topic)
    return [topic for topic in topics if topic in best.values()]


def _plain(topic: TopicContents) -> str:
    """A topic's name, compressed or not."""
    return topic.name.removesuffix("/compressed")


def _depths(found: Contents) -> list[TopicContents]:
    """The topics of images of depth that are registered to a camera of colour, by what drivers call them."""
    topics = [t for t in found.of_role("image") if "depth" in t.name.lower()]
    topics = [t for t in topics if "registered" in t.name.lower() or "aligned" in t.name.lower()]
    return sorted(topics, key=lambda topic: topic.name.lower().endswith("compresseddepth"))


def _camera(topic: TopicContents, called: str, found: Contents, body: str) -> Iterator[str]:
    parent = PurePosixPath(topic.name).parent
    yield "[[robot.camera]]"
    yield f"name = {_text(called)}"
    yield f"{'images' if topic.role == 'image' else 'tags'} = {_text(topic.name)}"
    beside = [c for c in found.of_role("calibration") if PurePosixPath(c.name).parent in (parent, parent.parent)]
    if beside:
        yield f"calibration = {_text(beside[0].name)}"
        if topic.role == "image" and "rect" in PurePosixPath(_plain(topic)).name:
            yield "rectified = true"
        elif topic.role == "tags":
            yield "# rectified = true  # ? the detector looked at images that were rectified (image_rect)"
    else:
        yield 'calibration = "calibration.yaml"  # ? no camera_info beside it: a file of ROS, OpenCV, Kalibr, ...'
    if deep := [t for t in _depths(found) if _space(t.name) == _space(topic.name)]:
        yield f"depth = {_text(deep[0].name)}  # ? registered to this camera, pixel for pixel"
    stands, eye, names = None, "", [t.frames[0] for t in (topic, *beside[:1]) if t.frames[0]]
    for eye in names:
        above = body or body_of(found.transforms, eye)
        stands = None if above == eye else standing_in(found.transforms, above, eye)
        if stands is not None:
            body = above
            break
    if stands is None:
        yield "xyz_m = [0.0, 0.0, 0.0]  # ? where the camera is in the robot's body"
        yield "quaternion_wxyz = [1.0, 0.0, 0.0, 0.0]  # ? and how it is turned (z looks ahead, x to the right)"
    else:
        yield f"xyz_m = {_numbers(stands.translation)}  # ? {eye} in {body}, by tf"
        yield f"quaternion_wxyz = {_numbers(stands.quaternion_wxyz())}  # ? if {eye} looks along z, x to the right"


def _numbers(some: Array) -> list[float]:
    return [round(number, 9) + 0.0 for number in some.tolist()]


def _names(topics: Sequence[TopicContents]) -> list[str]:
    """For each topic of a robot's cameras the last part of its name that is neither common nor in all of them; where
    that does not tell them apart, the whole of it."""
    parts = [topic.name.strip("/").split("/") for topic in topics]
    shared = COMMON | (set.intersection(*map(set, parts)) if len(parts) > 1 else set())
    short = [next((part for part in reversed(own) if part not in shared), "/".join(own)) for own in parts]
    return short if len(set(short)) == len(short) else ["/".join(own) for own in parts]


def _space(topic: str) -> str:
    return topic.strip("/").split("/")[0]


def _text(words: str) -> str:
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'
