"""What may stand in team.toml: records, checked by name and type when they are read."""

import difflib
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.io.files.toml import read_toml, told_by
from teamslam.model import LOSSES, MODELS
from teamslam.model.keys import MAX_ROBOT

STREAMS = ("odometry_poses", "velocity")  # rows that are turned into increments between keyframes
KEYFRAMES = ("interpolate", "given")
FILE = "team.toml"


class Robot(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One robot. `dim` 2: moves in the plane, 3: in space. `number` is its place in the list unless given.

    `sensors` are the poses of its sensors in its body, by name.
    """

    name: str
    dim: int = 2
    number: int | None = None
    sensors: dict[str, dict[str, float]] = {}


class Noise(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Square roots of the noise densities of velocities, as in `velocity.VelocityNoise`."""

    forward: float
    sideways: float
    turn: float
    forward_per_metre: float = 0.0
    sideways_per_metre: float = 0.0
    turn_per_metre: float = 0.0
    turn_per_radian: float = 0.0


class Log(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One CSV file of one sensor.

    `model` is a row of MODELS, or 'odometry_poses' or 'velocity'. `source` is what the log is called ('odometry',
    'landmarks', 'robots', 'fixes' by what the rows name, unless given). `robot` is who logged it, unless a column says
    so. `sigma` or `covariance` hold for rows that bring none. `sensor` is a pose in the body, or the name of one of the
    robot's sensors.
    """

    file: str
    model: str
    source: str | None = None
    robot: str | None = None
    dim: int | None = None
    sigma: list[float] | None = None
    covariance: list[list[float]] | None = None
    noise: Noise | None = None
    every_s: float = 1.0
    sensor: str | dict[str, float] | None = None
    loss: str = "squared"
    loss_scale: float = 1.0


class Known(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Files of truth or of initial values."""

    robots: str | list[str] = []
    landmarks: str | list[str] = []


class Left(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rows that were left out before this folder was written."""

    count: int
    reason: str


class Team(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The whole of team.toml.

    `keyframes` 'interpolate': sightings between two stamps of the odometry get a pose there; 'given': every stamp is a
    pose as it stands. Stamps nearer than `tolerance_s` are one. `tick_s` is the resolution of time (1.0: poses are
    counted). `landmarks` gives names numbers of their own.
    """

    robot: list[Robot]
    log: list[Log] = []
    keyframes: str = "interpolate"
    tolerance_s: float = 0.001
    truth_gap_s: float = 1.0
    tick_s: float = 1e-6
    landmarks: dict[str, int] = {}
    truth: Known = Known()
    initial: Known = Known()
    dropped: list[Left] = []


def read_team(folder: Path) -> Team:
    """The team.toml of a folder. InputError names the key at fault, what was expected, and the nearest known key."""
    path = folder / FILE
    if not folder.is_dir():
        raise InputError("no such folder; expected a folder with team.toml and CSV files", path=folder)
    try:
        team = msgspec.convert(read_toml(path), Team)
    except msgspec.ValidationError as error:
        raise _translated(error, path) from None
    _check(team, path)
    return team


def _translated(error: msgspec.ValidationError, path: Path) -> InputError:
    """msgspec's complaint in our words: Object contains unknown field 'sgima', in log[0]."""
    problem, field = told_by(error)
    if unknown := re.search(r"unknown field '(.*)'", problem):
        record = Team
        for part in re.findall(r"[a-z]+", field):
            record = {
                "log": Log,
                "robot": Robot,
                "truth": Known,
                "initial": Known,
                "noise": Noise,
                "dropped": Left,
            }.get(part, record)  # type: ignore[assignment]
        near = difflib.get_close_matches(unknown[1], record.__struct_fields__, 1)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(record.__struct_fields__)}"
        problem = f"unknown key '{unknown[1]}'; {hint}"
    elif missing := re.search(r"missing required field '(.*)'", problem):
        problem = f"the key '{missing[1]}' is missing"
    else:
        problem = problem[:1].lower() + problem[1:]
    return InputError(problem, path=path, field=field or None)


def _check(team: Team, path: Path) -> None:
    def fail(problem: str, field: str) -> InputError:
        return InputError(problem, path=path, field=field)

    def choice(value: str, choices: Any, field: str) -> None:
        if value not in choices:
            near = difflib.get_close_matches(value, list(choices), 1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise fail(f"expected one of {', '.join(choices)}, found '{value}'{hint}", field)

    choice(team.keyframes, KEYFRAMES, "keyframes")
    for name in ("tolerance_s", "truth_gap_s"):
        if not 0.0 <= getattr(team, name) < np.inf:
            raise fail(f"expected a number of seconds of 0 or more, found {getattr(team, name)}", name)
    if not 0.0 < team.tick_s < np.inf:
        raise fail(f"expected a number of seconds above 0, found {team.tick_s}", "tick_s")
    if not team.robot:
        raise fail("expected at least one [[robot]] with a name", "robot")
    for k, robot in enumerate(team.robot):
        if not robot.name.strip():
            raise fail("a robot needs a name", f"robot[{k}].name")
        if robot.dim not in (2, 3):
            raise fail(f"expected 2 (plane) or 3 (space), found {robot.dim}", f"robot[{k}].dim")
        if robot.number is not None and not 1 <= robot.number <= MAX_ROBOT:
            raise fail(f"expected a number from 1 to {MAX_ROBOT}, found {robot.number}", f"robot[{k}].number")
    for what, found in (("name", [r.name for r in team.robot]), ("number", numbers_of(team))):
        for k, value in enumerate(found):
            if value in found[:k]:
                raise fail(f"two robots have the {what} '{value}'; give each its own", f"robot[{k}].{what}")
    for name, number in team.landmarks.items():
        if not 0 <= number < 1 << 51:
            raise fail(f"expected a number from 0 to 2^51 - 1, found {number}", f"landmarks.{name}")
    if len(set(team.landmarks.values())) < len(team.landmarks):
        raise fail("two names have one number; give each its own", "landmarks")
    for k, log in enumerate(team.log):
        place = f"log[{k}] ({log.file})"
        if Path(log.file) in (Path(earlier.file) for earlier in team.log[:k]):
            raise fail("this file stands in another [[log]] already, and its rows would count twice", f"{place}.file")
        choice(log.model, (*MODELS, *STREAMS), f"{place}.model")
        choice(log.loss, LOSSES, f"{place}.loss")
        if not 0.0 < log.loss_scale < np.inf:
            raise fail(f"expected a number of sigmas above 0, found {log.loss_scale}", f"{place}.loss_scale")
        if log.robot is not None:
            choice(log.robot, [r.name for r in team.robot], f"{place}.robot")
        if log.dim not in (None, 2, 3):
            raise fail(f"expected 2 (plane) or 3 (space), found {log.dim}", f"{place}.dim")
        if not log.every_s > 0.0:
            raise fail(f"expected a number of seconds above 0, found {log.every_s}", f"{place}.every_s")
        if log.sigma is not None and log.covariance is not None:
            raise fail("give sigma or covariance, not both", f"{place}.sigma")
        if log.sigma is not None and not all(0.0 < s < np.inf for s in log.sigma):
            raise fail(f"standard deviations are above 0, found {log.sigma}", f"{place}.sigma")
        if (log.model == "velocity") != (log.noise is not None):
            raise fail(
                "velocities need [log.noise] (forward, sideways, turn), and nothing else has it", f"{place}.noise"
            )
        if log.noise is not None:
            for name in log.noise.__struct_fields__:
                least_ok = getattr(log.noise, name) > 0 if name in ("forward", "sideways", "turn") else True
                if not (least_ok and 0.0 <= getattr(log.noise, name) < np.inf):
                    raise fail(f"expected a number above 0, found {getattr(log.noise, name)}", f"{place}.noise.{name}")


def numbers_of(team: Team) -> list[int]:
    """The robots' numbers: their own, or their place in the list."""
    return [robot.number if robot.number is not None else k for k, robot in enumerate(team.robot, 1)]
