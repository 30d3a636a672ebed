"""A mission as people plan it: ways as corners, landmarks by name, sensors; from a TOML file.

    speed_m_s = 0.5                      # along the ways
    period_s = 1.0                       # from pose to pose
    [[robot]]
    name = "red"
    way = [[0, 0], [8, 0], [8, 5]]       # corners [m]; of a robot in the air with a height
    odometry = { sigma_m = 0.02, sigma_rad = 0.01 }          # of each step
    landmarks = { model = "range_bearing", range_m = 6.0 }   # what sees landmarks: fields of teamslam.sim.Sensor
    robots = { model = "relative_pose", every = 5 }          # what sees other robots
    [[landmark]]
    name = "door"
    at = [2.0, 3.5]

Sensors that are left out are the simulator's own; `false` stands for none. Where every landmark and corner has two
numbers all is in the plane. Robots start together and stop where their way ends.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.toml import converted, read_toml
from teamslam.model import Dataset, Names, landmark_number
from teamslam.sim import Odometry, Robot, Sensor, World, observe

T = TypeVar("T")
KEYS = {
    "": ("speed_m_s", "period_s", "robot", "landmark"),
    "robot": ("name", "way", "odometry", "landmarks", "robots"),
    "landmark": ("name", "at"),
}


@dataclass(frozen=True, eq=False)
class Mission:
    """Planned `ways` and `kinds` of robots by number, `landmarks` (k, d) by `names`, poses `period_s` apart."""

    ways: dict[int, Pose]
    kinds: dict[int, Robot]
    landmarks: dict[int, Array]
    names: Names
    period_s: float

    @property
    def dim(self) -> int:
        """Of the world: 2 where nothing has a height."""
        places = [*self.landmarks.values(), *(way.translation[0] for way in self.ways.values())]
        return max(len(place) for place in places)

    def dataset(self) -> Dataset:
        """What the team would measure, with the truth: for what it will know, noise does not matter.

        Raises InputError where nobody would measure anything.
        """
        marks = sorted(self.landmarks)
        places = np.array([_lifted(self.landmarks[mark], self.dim) for mark in marks]).reshape(-1, self.dim)
        turns = np.broadcast_to(np.eye(self.dim), (len(marks), self.dim, self.dim))
        world = _NumberedWorld(self.ways, Pose(turns.copy(), places), self.period_s, tuple(marks))
        return replace(observe(world, self.kinds, 0), names=self.names, origin="mission")

    @property
    def named_landmarks(self) -> dict[int, str]:
        """What every landmark is called, by its key."""
        return {mark: self.names.landmark(mark) for mark in self.landmarks}


@dataclass(frozen=True, eq=False)
class _NumberedWorld(World):
    """A world whose landmarks have numbers of their own."""

    numbers: tuple[int, ...] = ()

    @property
    def landmark_keys(self) -> Any:
        """The keys of the landmarks."""
        return np.array(self.numbers, np.int64)


def read_mission(path: str | Path) -> Mission:
    """The mission in a TOML file. InputError names the file, the key and the cure."""
    path = Path(path)
    given = read_toml(path)
    try:
        return mission_from(given)
    except InputError as error:
        raise InputError(error.problem, path=path, field=error.field) from None


def mission_from(given: Mapping[str, Any]) -> Mission:
    """The mission in a nested table, as TOML gives it. Raises InputError that names the key at fault."""
    _known(given, KEYS[""], "")
    speed, period = (
        _above_zero(given.get(name, value), name) for name, value in (("speed_m_s", 0.5), ("period_s", 1.0))
    )
    robots, landmarks = _list(given, "robot"), _list(given, "landmark")
    if not robots:
        raise InputError("expected at least one [[robot]] with a name and a way", field="robot")
    ways: dict[int, Pose] = {}
    kinds: dict[int, Robot] = {}
    called: dict[int, str] = {}
    for number, robot in enumerate(robots, start=1):
        field = f"robot[{number - 1}]"
        _known(robot, KEYS["robot"], field)
        called[number] = _name(robot, field, called.values())
        corners = _points(robot.get("way"), f"{field}.way", least=2)
        ways[number] = along(corners, speed * period)
        kinds[number] = Robot(
            odometry=_record(Odometry, robot.get("odometry", {}), f"{field}.odometry"),
            landmarks=_sensor(robot, "landmarks", Robot().landmarks, field),
            robots=_sensor(robot, "robots", Robot().robots, field),
        )
    marks: dict[int, Array] = {}
    mark_names: dict[int, str] = {}
    for place, landmark in enumerate(landmarks):
        field = f"landmark[{place}]"
        _known(landmark, KEYS["landmark"], field)
        name = _name(landmark, field, mark_names.values())
        mark_names[landmark_number(name)] = name
        marks[landmark_number(name)] = _points([landmark.get("at")], f"{field}.at", least=1)[0]
    return Mission(ways, kinds, marks, Names(called, mark_names), period)


def along(corners: Array, step_m: float) -> Pose:
    """Poses (n,) about `step_m` apart along straight legs between corners (c, d), each looking along its leg."""
    legs = np.diff(corners, axis=0)
    steps = np.maximum(np.ceil(np.linalg.norm(legs, axis=-1) / step_m - 1e-9).astype(int), 1)
    places, headings = [], []
    for corner, leg, count in zip(corners, legs, steps, strict=False):
        places.append(corner + leg * (np.arange(count) / count)[:, None])
        headings.append(np.full(count, np.arctan2(leg[1], leg[0])))
    xy = np.concatenate([*places, corners[-1:]])
    heading = np.concatenate([*headings, headings[-1][-1:]])
    turned = Pose.from_xytheta(np.concatenate([xy[:, :2], heading[:, None]], -1)).lift(corners.shape[-1])
    return Pose(turned.rotation, xy)


# --- checks -----------------------------------------------------------------------------------------------------------


def _sensor(robot: Mapping[str, Any], name: str, usual: Sensor | None, field: str) -> Sensor | None:
    given = robot.get(name, {})
    if given is False:
        return None
    if given is True:
        return usual
    assert usual is not None
    return replace(usual, **_checked(Sensor, given, f"{field}.{name}"))


def _record(kind: type[T], given: Any, field: str) -> T:
    return kind(**_checked(kind, given, field))


def _checked(kind: type, given: Any, field: str) -> dict[str, Any]:
    """The fields of a record that were given, of the right types."""
    if not isinstance(given, Mapping):
        raise InputError(f"expected a table of {', '.join(f.name for f in fields(kind))}", field=field)
    _known(given, tuple(f.name for f in fields(kind)), field)
    record: object = converted(given, kind, within=field)
    return {name: getattr(record, name) for name in given}


def _known(given: Mapping[str, Any], known: tuple[str, ...], field: str) -> None:
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(known)}"
            raise InputError(f"unknown key '{name}'; {hint}", field=field or None)


def _list(given: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    found = given.get(name, [])
    if not isinstance(found, list) or not all(isinstance(entry, Mapping) for entry in found):
        raise InputError(f"expected tables [[{name}]]", field=name)
    return found


def _name(given: Mapping[str, Any], field: str, taken: Any) -> str:
    name = given.get("name")
    if isinstance(name, int) and not isinstance(name, bool):
        name = str(name)
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"expected a name, found {name!r}", field=f"{field}.name")
    if name in taken:
        raise InputError(f"the name '{name}' stands twice; give each its own", field=f"{field}.name")
    return name


def _above_zero(value: Any, field: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < np.inf:
        raise InputError(f"a number above zero is needed, found {value!r}", field=field)
    return float(value)


def _points(given: Any, field: str, least: int) -> Array:
    """Places (n, 2 or 3)."""
    wanted = "a place [x, y] or [x, y, z]" if least == 1 else "corners [[x, y], [x, y], ...], with z in the air"
    try:
        points = np.array(given, float)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < least or not np.isfinite(points).all():
        raise InputError(f"expected {wanted}, found {given!r}"[:300], field=field)
    if len(points) > 1 and not np.diff(points, axis=0).any(-1).all():
        raise InputError("two corners in a row are the same place", field=field)
    return points


def _lifted(place: Array, dim: int) -> Array:
    return np.concatenate([place, np.zeros(dim - len(place))])
