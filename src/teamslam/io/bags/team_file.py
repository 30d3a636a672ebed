"""The team file: which recordings are robots, where their cameras are, and which tags there are. TOML.

[tags]                            what holds for all tags
size_m = 0.15                     the edge of the black square
[tags.sizes_m]                    exceptions, by number
7 = 0.30

[[robot]]
name = "one"
recording = "one.bag"             beside this file, or absolute; a list: the parts into which it was split
odometry = "/odom"                a topic, or a transform, "odom -> base_link"; without it the motion model ties frames
[[robot.camera]]
name = "left"
tags = "/left/tags"               a topic of detections; or images = "/left/image_raw", in which tags are looked for
calibration = "/left/camera_info" a topic, or a file
xyz_m = [0.1, 0.0, 0.2]           of the camera in the body that odometry moves; z ahead, x right
quaternion_wxyz = [1, 0, 0, 0]
[[robot.tag]]                     a tag on the robot: who sees it, sees the robot
number = 100
xyz_m = [0.0, 0.07, 0.3]

[[landmark]]                      a landmark that carries several tags
name = "box"
[[landmark.tag]]
number = 20
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
import tomli_w

from teamslam.errors import InputError
from teamslam.frontend.tags.detect import Looking
from teamslam.frontend.tags.rows import Tag
from teamslam.frontend.way_noise import WayNoise
from teamslam.geometry import Pose
from teamslam.io.files.toml import converted, read_toml
from teamslam.io.files.whole import whole_file


class Placed(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A pose in a body: where, and how it is turned, as a quaternion or a rotation vector [rad]."""

    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion_wxyz: tuple[float, float, float, float] | None = None
    rotation_vector: tuple[float, float, float] | None = None

    @property
    def pose(self) -> Pose:
        """As a Pose. InputError for a quaternion of length zero, or both ways of turning at once."""
        if self.quaternion_wxyz is not None and self.rotation_vector is not None:
            raise InputError("give quaternion_wxyz or rotation_vector, not both")
        if self.rotation_vector is not None:
            return Pose.from_tangent(np.array([*self.xyz_m, *self.rotation_vector]), 3)
        turn = np.array(self.quaternion_wxyz or (1.0, 0.0, 0.0, 0.0))
        if not 0.5 < np.linalg.norm(turn) < 2.0:
            raise InputError(f"a quaternion has length 1, found {np.linalg.norm(turn):g}", field="quaternion_wxyz")
        return Pose.from_quaternion(np.array(self.xyz_m), turn)


class PlacedTag(Placed, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A tag somewhere."""

    number: int
    size_m: float | None = None


class UnsureTag(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """How well what is stated of a tag on a body is known, standard deviations: what is above 0 is estimated, as far as
    the recording tells. Of where it is (`xyz_m`) and how it is turned (`rotation_rad`) about each axis of the body; of
    its edge a share."""

    xyz_m: float = 0.0
    rotation_rad: float = 0.0
    edge: float = 0.0


class CarriedTag(PlacedTag, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A tag on a body, and how well that is known."""

    sigma: UnsureTag = UnsureTag()


class StatedClock(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A robot's clock beside the first robot's: how much later its stamps are in the middle of its recording, by how
    much more that grows in a second (1e-6: a microsecond), and the standard deviations of both: 0, as stated; left out,
    as stated unless the recordings contradict that."""

    offset_s: float = 0.0
    drift: float = 0.0
    offset_sigma_s: float | None = None
    drift_sigma: float | None = None


class Unsure(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """How well what is stated of a camera is known, standard deviations: what is above 0 is estimated, as far as the
    recording tells; `delay_s` left out, where it contradicts what is stated. Of where a camera is (`xyz_m`) and how it
    is turned (`rotation_rad`) about each axis of the body; of its focal lengths a share, of its principal point pixels,
    right and down (`centre_px`)."""

    delay_s: float | None = None
    line_s: float = 0.0
    xyz_m: float = 0.0
    rotation_rad: float = 0.0
    focal: float = 0.0
    centre_px: float = 0.0


class CameraEntry(Placed, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A camera of a robot, with a topic of detections (`tags`) or of images, in which tags are looked for; where the
    robot's recording is a video or a folder of images, `images` is a pattern of their names (of a video anything), and
    `rate_hz` says how many there are a second where these are no stamps, or `stamps` names a list of them
    (`io.bags.image_stamps`). `rectified`: the images, or those in which a detector found its corners, were rectified by
    the `camera_info` that is its calibration. `depth` is a topic of images of depth, registered to those in which tags
    are seen, pixel for pixel, and `depth_floor` the share of the distance by which all of them may be off. `floor_px`
    and `edge_px` are the corners' noise (frontend.tags.noise); `delay_s` is how long before its stamp the middle line
    of an image was taken; `line_s` is how much later than the line above each line is read, 0 where all are exposed at
    once (below zero: from below); `focal_scale` is how much longer its focal lengths are than its calibration says, and
    `centre_px` how much farther right and down its principal point is. `sigma` says how well these are known."""

    name: str
    tags: str = ""
    images: str = ""
    rate_hz: float | None = None
    stamps: str = ""
    depth: str = ""
    calibration: str
    calibration_name: str | None = None
    rectified: bool = False
    floor_px: float = 0.5
    edge_px: float = 0.5
    depth_floor: float = 0.005
    delay_s: float = 0.0
    line_s: float = 0.0
    focal_scale: float = 1.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    sigma: Unsure = Unsure()


class RobotEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A robot: its recording (a list: the parts into which it was split), the topic of its odometry, its cameras and
    the tags it carries. Of its images one is used every `image_every_s`, the one that shows most tags. `truth` is a
    topic with its true poses, as motion capture gives them: results are scored against it, and how late its stamps are
    is found out, unless it is `truth_in_time`."""

    name: str
    recording: str | list[str]
    odometry: str | None = None
    truth: str | None = None
    truth_in_time: bool = False
    dim: int = 3
    image_every_s: float = 0.25
    motion: WayNoise = WayNoise()
    clock: StatedClock = StatedClock()
    camera: list[CameraEntry] = []
    tag: list[CarriedTag] = []

    @property
    def parts(self) -> list[str]:
        """The files of its recording."""
        return [self.recording] if isinstance(self.recording, str) else self.recording


class LandmarkEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A landmark that carries tags."""

    name: str
    tag: list[CarriedTag]


class Tags(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """What holds for all tags. One seen in fewer than `fewest` images of a robot is taken for a misread; of more than
    `most_mended` bits that were wrong, too. In images tags of `families` are looked for; `decimate` as in
    `frontend.tags.detect.Looking`. All edges are `size_scale` times as long as stated, which is known to `size_sigma`
    (a printer's; 0: as stated)."""

    size_m: float
    sizes_m: dict[str, float] = {}
    size_scale: float = 1.0
    size_sigma: float = 0.0
    ignore: list[int] = []
    fewest: int = 3
    most_mended: int = 2
    loss: str = "cauchy"
    loss_scale: float = 4.0
    families: tuple[str, ...] = ("tag36h11",)
    decimate: float = 1.0

    def looking(self) -> Looking:
        """How tags are looked for in images. InputError where they cannot be."""
        return Looking(self.families, self.decimate)


class TeamFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The whole file. `truth` says where tags truly are, in the frame of the robots' true poses; `options` are those of
    the run, as an options file has them."""

    tags: Tags
    robot: list[RobotEntry]
    landmark: list[LandmarkEntry] = []
    truth: list[PlacedTag] = []
    options: dict[str, object] = {}

    def with_recordings(self, others: Sequence[str], path: Path) -> "TeamFile":
        """With `others` for the recordings in it, or their parts, in the order in which it first names them; none: as
        it is. Of a team with one recording they are its parts. InputError where there are more or fewer."""
        if not others:
            return self
        if len({tuple(robot.parts) for robot in self.robot}) == 1:
            parts: str | list[str] = others[0] if len(others) == 1 else list(others)
            robots = [msgspec.structs.replace(robot, recording=parts) for robot in self.robot]
            return msgspec.structs.replace(self, robot=robots)
        named = list(dict.fromkeys(part for robot in self.robot for part in robot.parts))
        if len(named) != len(others):
            raise InputError(
                f"the team file names {len(named)} recordings ({', '.join(named)}), and {len(others)} are given",
                path=path,
                field="robot.recording",
            )
        instead = dict(zip(named, others, strict=True))
        robots = [
            msgspec.structs.replace(
                robot,
                recording=instead[robot.recording]
                if isinstance(robot.recording, str)
                else [instead[part] for part in robot.recording],
            )
            for robot in self.robot
        ]
        return msgspec.structs.replace(self, robot=robots)

    def carried(self) -> dict[int, Tag]:
        """The tags on robots and on landmarks of several tags, by number. InputError for one that stands twice."""
        out: dict[int, Tag] = {}
        for name, is_robot, tag in self.bodies():
            if tag.number in out:
                raise InputError(f"tag {tag.number} is on {out[tag.number].carrier} and on {name}", field="tag")
            size = self.stated_size_of(tag) * self.tags.size_scale
            out[tag.number] = Tag(tag.number, size, name, is_robot, tag.pose)
        return out

    def size_of(self, number: int) -> float:
        """The edge of a tag [m]."""
        return self.stated_size_of(PlacedTag(number=number)) * self.tags.size_scale

    def stated_size_of(self, tag: PlacedTag) -> float:
        """The edge of a tag on a body as it is stated, before all are scaled [m]."""
        return self.tags.sizes_m.get(str(tag.number), self.tags.size_m) if tag.size_m is None else tag.size_m

    def bodies(self) -> Iterator[tuple[str, bool, CarriedTag]]:
        """Every tag on a body: who carries it, and whether that is a robot."""
        for robot in self.robot:
            yield from ((robot.name, True, tag) for tag in robot.tag)
        for landmark in self.landmark:
            yield from ((landmark.name, False, tag) for tag in landmark.tag)


def is_team_file(path: Path) -> bool:
    """Whether a path is a team file: TOML in which somebody has a recording."""
    if path.suffix != ".toml" or not path.is_file():
        return False
    return re.search(rb"^\s*recording\s*=", path.read_bytes(), re.MULTILINE) is not None


def read_team_file(path: Path) -> TeamFile:
    """The team file at a path. InputError names the field that is wrong."""
    read = read_toml(path)
    if wrong := next(_no_numbers(read), None):
        raise InputError(f"expected a number, found {wrong[1]}", path=path, field=wrong[0])
    team = converted(read, TeamFile, path=path)
    try:
        _check(team)
    except InputError as error:
        raise InputError(error.problem, path=path, field=error.field) from None
    return team


def write_team_file(team: TeamFile, path: Path) -> None:
    """A team file, what is as usual left out. Law: read_team_file gives the same team."""
    with whole_file(path) as file:
        tomli_w.dump(msgspec.to_builtins(team), file)


def _check(team: TeamFile) -> None:
    if not team.robot:
        raise InputError("a team has at least one [[robot]]", field="robot")
    names = [robot.name for robot in team.robot]
    if len(set(names)) < len(names):
        raise InputError(f"two robots are called {max(names, key=names.count)}", field="robot.name")
    for kind, called in (("robot", names), ("landmark", [landmark.name for landmark in team.landmark])):
        if not all(name.strip() for name in called):
            raise InputError(f"a {kind} has a name; this one's is empty", field=f"{kind}.name")
    team.tags.looking()
    sizes = [team.tags.size_m, *team.tags.sizes_m.values(), *(tag.size_m for tag in team.carried().values())]
    if unnamed := next((name for name in team.tags.sizes_m if not name.isdecimal()), None):
        raise InputError(f"edges of tags go by their numbers, found '{unnamed}'", field="tags.sizes_m")
    if not all(0.0 < size < np.inf for size in sizes):
        raise InputError("the edge of a tag is above 0 [m]", field="tags.size_m")
    if not all(_sigmas(*msgspec.structs.astuple(tag.sigma)) for _, _, tag in team.bodies()):
        raise InputError("standard deviations are 0 or more", field="tag.sigma")
    if not 0.0 <= team.tags.size_sigma < 1.0:
        raise InputError("size_sigma is a share, from 0 to 1", field="tags.size_sigma")
    for robot in team.robot:
        if not robot.parts:
            raise InputError(f"robot {robot.name} has no recording", field="robot.recording")
        if robot.dim not in (2, 3):
            raise InputError(f"a robot moves in the plane (2) or in space (3), found {robot.dim}", field="robot.dim")
        if robot.dim == 2 and robot.odometry is None:
            raise InputError(f"robot {robot.name} moves on the ground and needs odometry", field="robot.odometry")
        _check_motion(robot)
        if robot.image_every_s < 0.0:
            raise InputError("image_every_s is 0 or more", field="robot.image_every_s")
        clock = robot.clock
        if not (
            np.isfinite(clock.offset_s) and abs(clock.drift) < 0.01 and _sigmas(clock.offset_sigma_s, clock.drift_sigma)
        ):
            raise InputError("offset_s is finite, drift within 0.01, sigmas 0 or more", field="robot.clock")
        for camera in robot.camera:
            if not _sigmas(*msgspec.structs.astuple(camera.sigma)):
                raise InputError("standard deviations are 0 or more", field="robot.camera.sigma")
            if not np.isfinite(camera.centre_px).all():
                raise InputError("centre_px is two finite numbers of pixels", field="robot.camera.centre_px")
            if not 0.0 < camera.focal_scale < np.inf:
                raise InputError("focal_scale is above 0", field="robot.camera.focal_scale")
            if bool(camera.tags) == bool(camera.images):
                raise InputError(
                    f"camera {camera.name} needs either a topic of detections (tags) or one of images, and has "
                    f"{'both' if camera.tags else 'neither'}",
                    field="robot.camera.tags",
                )
            if not (np.isfinite(camera.delay_s) and abs(camera.line_s) < 0.01):
                raise InputError(
                    f"camera {camera.name}: delay_s is finite, and a line is read within 0.01 s",
                    field="robot.camera.line_s",
                )
            if camera.rate_hz is not None and not 0.0 < camera.rate_hz < np.inf:
                raise InputError("rate_hz is above 0", field="robot.camera.rate_hz")
            if not 0.0 <= camera.depth_floor < 1.0:
                raise InputError("depth_floor is a share, from 0 to 1", field="robot.camera.depth_floor")
            if not (camera.floor_px >= 0.0 and camera.edge_px >= 0.0 and camera.floor_px + camera.edge_px > 0.0):
                raise InputError("floor_px and edge_px are 0 or more, and not both 0", field="robot.camera.floor_px")


def _no_numbers(read: object, field: str = "") -> Iterator[tuple[str, float]]:
    """Fields that hold what is no number, or none that ends; speeds that nothing exceeds may be such."""
    if isinstance(read, dict):
        for name, value in read.items():
            yield from _no_numbers(value, f"{field}.{name}" if field else str(name))
    elif isinstance(read, list):
        for k, value in enumerate(read):
            yield from _no_numbers(value, f"{field}[{k}]")
    elif isinstance(read, float) and not np.isfinite(read) and not ("fastest" in field and read > 0.0):
        yield field, read


def _check_motion(robot: RobotEntry) -> None:
    """InputError where what is stated of a robot's motion can be none."""
    motion = robot.motion
    if not min(motion.speed_m_s, motion.turn_rad_s, motion.fastest_m_s, motion.fastest_rad_s) > 0.0:
        raise InputError(f"speeds of robot {robot.name} are above 0", field="robot.motion")
    if min(motion.drift_m, motion.slip_m, motion.drift_rad, motion.slip_rad) < 0.0:
        raise InputError(f"drift and slip of robot {robot.name} are 0 or more", field="robot.motion")
    if not (motion.drift_m + motion.slip_m > 0.0 and motion.drift_rad + motion.slip_rad > 0.0):
        raise InputError(f"of drift and slip of robot {robot.name} one is above 0: odometry errs", field="robot.motion")


def _sigmas(*numbers: float | None) -> bool:
    return all(number is None or 0.0 <= number < np.inf for number in numbers)
