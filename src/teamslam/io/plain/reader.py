"""A team's log from a folder in the plain format."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.keyframes import Stream, place_keyframes, without_repeats
from teamslam.frontend.velocity import VelocityNoise
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import read_csv
from teamslam.io.files.options import options_of
from teamslam.io.plain.columns import (
    components,
    covariance_columns,
    dim_of,
    information_columns,
    noise_columns,
    notes_of_angles,
    read_noise,
    read_poses,
    read_values,
    sigma_columns,
    ticks_of,
    value_columns,
)
from teamslam.io.plain.headings import notes_of_headings
from teamslam.io.plain.known import read_known
from teamslam.io.plain.roster import NAMED, Roster
from teamslam.io.plain.schema import FILE, STREAMS, Log, Team, read_team
from teamslam.model import MODELS, Dataset, Dropped, Loss, Table, is_landmark, pose_key, robot_of, unnamed_key

SENSOR_KEYS = ("x", "y", "z", "theta", "qw", "qx", "qy", "qz")
ROWS_OF_A_FILE = 30  # bits: files of one robot count their rows apart
KEY_COLUMNS = ("robot", "observer", "from_stamp", "to_stamp", "stamp", "landmark", "other", "other_stamp", "id")


@dataclass(frozen=True)
class Options:
    """None: the plain format's options stand in team.toml."""


def sniff(path: Path) -> bool:
    """True for a folder with a team.toml."""
    return (path / FILE).is_file()


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The team's log in a folder. InputError names file, line and field of what cannot be read, and the cure."""
    options_of(Options, options, reader="plain")
    folder = Path(path)
    team = read_team(folder)
    roster = Roster(folder, team)
    tables, streams, notes = _read_logs(folder, team, roster)
    dropped: list[Dropped] = []
    if team.keyframes == "interpolate":
        tables, dropped = _interpolated(folder, team, roster, tables, streams)
    dropped += [Dropped(left.count, left.reason) for left in team.dropped]
    dataset = Dataset(roster.dims, tuple(tables), roster.names, dropped=tuple(dropped), origin=str(folder))
    truth = read_known(folder, team.truth, team, roster, dataset, notes)
    initial = read_known(folder, team.initial, team, roster, dataset, notes)
    return replace(dataset, truth=truth, initial=initial, names=roster.names, notes=tuple(notes))


def _interpolated(
    folder: Path, team: Team, roster: Roster, tables: list[Table], streams: list[Stream]
) -> tuple[list[Table], list[Dropped]]:
    """The tables without repeated rows, all at keyframes, and what was left out."""
    if not tables and not streams:
        raise InputError(
            "there is nothing to read: expected a [[log]] for each CSV file of measurements, with rows in it",
            path=folder / FILE,
        )
    fresh = [without_repeats(table) for table in tables]
    repeats = sum(map(len, tables)) - sum(map(len, fresh))
    placed, dropped = place_keyframes(
        fresh, streams, tolerance=round(team.tolerance_s / team.tick_s), names=roster.names
    )
    return placed, [Dropped(repeats, "rows that repeat an earlier one in every number")] * (repeats > 0) + dropped


# --- one CSV file -------------------------------------------------------------------------------------------------


def _read_logs(folder: Path, team: Team, roster: Roster) -> tuple[list[Table], list[Stream], list[str]]:
    """Every [[log]] as tables and streams, one for each robot that it speaks of, and words on what is odd in them."""
    tables: list[Table] = []
    streams: list[Stream] = []
    notes: list[str] = []
    taken: dict[tuple[int, str], int] = {}  # rows so far of each robot's log of each source
    for place, log in enumerate(team.log):
        csv = read_csv(folder / log.file, words=NAMED)
        if log.model in STREAMS:
            if team.keyframes == "given":
                raise InputError(
                    f'{log.model} needs keyframes = "interpolate"', path=folder / FILE, field=f"log[{place}].model"
                )
            streams += _read_streams(csv, log, team, roster, notes)
            if log.model == "odometry_poses" and csv.has("theta"):
                notes += notes_of_headings(csv, _robots(csv, log, roster))
        else:
            tables += read_tables(csv, log, team, roster, taken, place, notes)
            notes += notes_of_angles(csv, log.model, tables[-1].dim) if len(csv) else []
    return tables, streams, notes


def read_tables(
    csv: Csv,
    log: Log,
    team: Team,
    roster: Roster,
    taken: dict[tuple[int, str], int],
    place: int,
    notes: list[str] | None = None,
) -> list[Table]:
    """A file of increments, sightings or fixes: the one at a `place` in team.toml. `taken`: how many rows each robot's
    log of each source has so far; it is brought up to date. Words on columns without a meaning are added to `notes`;
    None: there may be none."""
    planar = all(dim == 2 for dim in roster.dims.values())
    dim = dim_of(csv, log.model, log.dim, 2 if planar else 3)
    noise = components(log.model, dim)
    if notes is None:
        csv.refuse_others(_known(log.model, dim))
    else:
        notes += csv.notes_of_others(_known(log.model, dim))
    robots = _robots(csv, log, roster)
    keys, source = _keys(csv, log, team, roster, robots, place)
    values = read_values(csv, log.model, dim)
    whitening = read_noise(csv, noise, log.sigma, log.covariance)
    given_ids = csv.numbers("id")[:, 0] if csv.has("id") else None
    if team.keyframes == "interpolate" and source == "odometry" and csv.has("from_stamp"):
        _check_order(csv, keys, values, team.tick_s)
    tables = []
    for robot in _speakers(log, roster, robots):
        rows = np.flatnonzero(robots == robot)
        if team.keyframes == "interpolate" and MODELS[log.model].targets_pose:
            _check_dim(csv, dim, roster, robot, at_least=not csv.has("from_stamp"))
        first = taken.get((robot, source), 0)
        ids = np.arange(first, first + len(rows)) if given_ids is None else _ids(csv, given_ids, rows)
        taken[robot, source] = max(first + len(rows), int(ids.max(initial=-1)) + 1)
        tables.append(
            Table(
                robot,
                source,
                log.model,
                dim,
                keys[rows],
                values[rows],
                whitening if len(whitening) == 1 and not _has_own_noise(csv, noise) else whitening[rows],
                ids,
                sensor=_sensor(csv, log, roster, robot, dim, keys[rows]),
                loss=Loss(log.loss, log.loss_scale),
            )
        )
    return tables


def _known(model: str, dim: int) -> list[str]:
    return [*KEY_COLUMNS, *value_columns(model, dim), *noise_columns(components(model, dim))]


def _read_streams(csv: Csv, log: Log, team: Team, roster: Roster, notes: list[str]) -> list[Stream]:
    """A file of absolute odometry poses or of velocities."""
    robots = _robots(csv, log, roster)
    ticks = ticks_of(csv, "stamp", team.tick_s)
    noise = (
        None if log.noise is None else VelocityNoise(**{f: getattr(log.noise, f) for f in log.noise.__struct_fields__})
    )
    columns = ("v", "w") if noise is not None else value_columns("pose", dim_of(csv, "pose", log.dim, 2))
    notes += csv.notes_of_others(["robot", "stamp", *columns])
    every = max(round(min(log.every_s, 1e12) / team.tick_s), 1)
    streams = []
    for robot in _speakers(log, roster, robots):
        rows = np.flatnonzero(robots == robot)
        back = np.flatnonzero(np.diff(ticks[rows]) < 0)
        if len(back):
            row = int(rows[back[0] + 1])
            raise csv.fail(
                row, f"time goes back by {(ticks[rows[back[0]]] - ticks[row]) * team.tick_s:.6g} s; "
                "sort the rows by stamp, or leave out those from before the clock was set", "stamp",
            )  # fmt: skip
        rows = rows[np.append(np.diff(ticks[rows]) > 0, True)] if len(rows) else rows  # of one stamp, the last row
        if len(rows) < 2:
            raise InputError(
                f"robot {roster.names.robot(robot)} needs at least two rows at different stamps", path=csv.path
            )
        common = (robot, log.source or "odometry", ticks[rows], every, Loss(log.loss, log.loss_scale))
        if noise is not None:
            if roster.dims[robot] != 2:
                raise InputError("velocities v, w are of a robot in the plane (dim = 2)", path=csv.path)
            streams.append(Stream(*common, velocities=csv.numbers("v", "w")[rows], noise=noise))
        else:
            dim = dim_of(csv, "pose", log.dim, 2)
            _check_dim(csv, dim, roster, robot)
            W = read_noise(csv, components("pose", dim), log.sigma, log.covariance)
            streams.append(Stream(*common, poses=read_poses(csv, dim)[rows], rate_whitening=W))
    return streams


def _check_dim(csv: Csv, dim: int, roster: Roster, robot: int, *, at_least: bool = False) -> None:
    """InputError where poses are not of the robot's dimension (or more: a planar robot may see tags in space)."""
    entry = roster.entries[robot]
    if dim != entry.dim and not (at_least and dim > entry.dim):
        raise InputError(
            f"these poses are of dimension {dim}, but robot {entry.name} has dim = {entry.dim} in {FILE}; "
            f"change it there, or give poses with the columns {', '.join(value_columns('pose', entry.dim))}",
            path=csv.path,
            line=1,
        )


# --- columns of names and stamps ----------------------------------------------------------------------------------


def _robots(csv: Csv, log: Log, roster: Roster) -> IntArray:
    """Who logged each row (m,)."""
    if csv.has("robot"):
        return roster.robots(csv, "robot")
    if log.robot is None and MODELS[log.model].unary and csv.has("landmark"):
        return np.full(len(csv), next(iter(roster.entries)), np.int64)  # surveyed by nobody of the team
    if log.robot is None:
        raise InputError(
            "no such column; add it, or write robot = \"...\" into this file's [[log]]",
            path=csv.path, line=1, field="robot",
        )  # fmt: skip
    return np.full(len(csv), roster.number(log.robot), np.int64)


def _speakers(log: Log, roster: Roster, robots: IntArray) -> list[int]:
    """The robots that a file speaks of, in the order of team.toml."""
    said = set(robots.tolist()) | ({roster.number(log.robot)} if log.robot is not None else set())
    return [number for number in roster.entries if number in said]


def _keys(csv: Csv, log: Log, team: Team, roster: Roster, robots: IntArray, place: int) -> tuple[IntArray, str]:
    """Observer and target of each row, and what the log is called if nobody says."""
    unary = MODELS[log.model].unary
    observers = roster.robots(csv, "observer") if csv.has("observer") else robots
    if csv.has("landmark", "other"):
        raise InputError(
            "a file holds sightings of landmarks or of robots, found both columns 'landmark' and 'other'; "
            "split it into two files",
            path=csv.path, line=1,
        )  # fmt: skip
    if csv.has("landmark"):
        target, source = _landmarks(csv, roster, robots, place, unary), "fixes" if unary else "landmarks"
    elif csv.has("other"):
        stamp = "other_stamp" if csv.has("other_stamp") else "stamp"
        target, source = pose_key(roster.robots(csv, "other"), ticks_of(csv, stamp, team.tick_s)), "robots"
    elif unary:
        target, source = pose_key(observers, ticks_of(csv, "stamp", team.tick_s)), "fixes"
    elif csv.has("from_stamp") or csv.has("to_stamp"):
        target, source = pose_key(observers, ticks_of(csv, "to_stamp", team.tick_s)), "odometry"
    else:
        raise InputError(
            f"a {log.model} needs to say of what: a column 'landmark', 'other' (a robot), or from_stamp and to_stamp; "
            f"found {', '.join(csv.columns)}",
            path=csv.path, line=1,
        )  # fmt: skip
    source = log.source or source
    if unary:
        return target[:, None], source
    stamp = "from_stamp" if csv.has("from_stamp") else "stamp"
    observer = pose_key(observers, ticks_of(csv, stamp, team.tick_s))
    itself = np.flatnonzero(observer == target)
    if len(itself):
        raise csv.fail(int(itself[0]), "a pose cannot be measured from itself; check robot and stamps")
    return np.stack([observer, target], -1), source


def _landmarks(csv: Csv, roster: Roster, robots: IntArray, place: int, unary: bool) -> IntArray:
    """The landmarks that rows are of; a sighting with an empty cell there is of one that nobody called by name."""
    target = roster.landmarks(csv)
    bare = np.flatnonzero(target < 0)
    if len(bare) and unary:
        raise csv.fail(int(bare[0]), "empty; a landmark that is surveyed needs a name", "landmark")
    for robot in np.unique(robots[bare]).tolist():
        rows = bare[robots[bare] == robot]
        target[rows] = unnamed_key(robot, (place << ROWS_OF_A_FILE) + rows)
    return target


def _check_order(csv: Csv, keys: IntArray, values: Array, tick_s: float) -> None:
    """InputError where an increment goes back in time or overlaps one before it."""
    start, stop = keys.T
    back = np.flatnonzero(stop <= start)
    if len(back):
        said = "to_stamp is not after from_stamp; an increment leads forward in time"
        raise csv.fail(int(back[0]), f"{said}{_by_an_hour((start - stop)[back[0]] * tick_s)}", "to_stamp")
    order = np.lexsort((start, robot_of(start)))
    whole = np.concatenate([keys, np.ascontiguousarray(values, dtype=float).view(np.int64)], -1)
    same = np.all(whole[order[1:]] == whole[order[:-1]], -1)  # repeated rows are counted later
    late = np.flatnonzero(
        (start[order[1:]] < stop[order[:-1]]) & (robot_of(start[order[1:]]) == robot_of(stop[order[:-1]])) & ~same
    )
    if len(late):
        row, earlier = int(order[late[0] + 1]), int(order[late[0]])
        _check_starts(csv, start)
        raise csv.fail(
            row,
            f"overlaps the increment on line {int(csv.lines[earlier])}; each moment belongs to one row",
            "from_stamp",
        )


def _by_an_hour(back_s: float) -> str:
    """What a leap back of nearly whole hours looks like; nothing for others."""
    hours = round(back_s / 3600.0)
    if not hours or abs(back_s - 3600.0 * hours) > 60.0:
        return ""
    return (
        f". It leads back by {back_s:.6g} s, about {'an hour' if hours == 1 else f'{hours} hours'}: a clock that was "
        "set back, as at the end of summer time; add it to all stamps from here on, in all files alike"
    )


def _check_starts(csv: Csv, start: IntArray) -> None:
    """InputError where the stamps of a robot begin anew in the order of the file: its recorder was started again."""
    for robot in np.unique(robot_of(start)).tolist():
        mine = np.flatnonzero(robot_of(start) == robot)
        again = np.flatnonzero(np.diff(start[mine]) < 0)
        if len(again) and start[mine[again[0] + 1]] <= start[mine[0]]:
            raise csv.fail(
                int(mine[again[0] + 1]),
                f"the stamps of this robot begin anew after line {int(csv.lines[mine[again[0]]])}, as where a recorder "
                f"was started again; let them count on, in all files alike, or give each start a robot of its own",
                "from_stamp",
            )


def _ids(csv: Csv, given: Array, rows: IntArray) -> IntArray:
    found = given[rows]
    bad = np.flatnonzero((found < 0) | (found != np.round(found)) | (found >= 2.0**53))
    if len(bad):
        raise csv.fail(int(rows[bad[0]]), f"expected a whole number of 0 or more, found {found[bad[0]]:g}", "id")
    _, first = np.unique(found, return_index=True)
    again = np.setdiff1d(np.arange(len(found)), first)
    if len(again):
        raise csv.fail(int(rows[again[0]]), f"the id {found[again[0]]:g} stands twice; ids are unique", "id")
    return found.astype(np.int64)


def _has_own_noise(csv: Csv, names: tuple[str, ...]) -> bool:
    families = (sigma_columns(names), covariance_columns(names), information_columns(names))
    return any(csv.has(*family) for family in families)


# --- sensors ------------------------------------------------------------------------------------------------------


def _sensor(csv: Csv, log: Log, roster: Roster, robot: int, dim: int, keys: IntArray) -> Pose | None:
    """The sensor's pose in the robot's body; of one that measures in the plane, its shadow there."""
    entry, file = roster.entries[robot], csv.path.parent / FILE
    if log.sensor is None:
        return None
    given, place = log.sensor, f"{log.file}: sensor"
    if isinstance(given, str):
        if given not in entry.sensors:
            raise InputError(
                f"robot {entry.name} has no sensor '{given}'; it has {', '.join(entry.sensors) or 'none'}",
                path=file, field=place,
            )  # fmt: skip
        given, place = entry.sensors[given], f"{entry.name}: sensors.{given}"
    if MODELS[log.model].unary and is_landmark(keys).any():
        raise InputError("landmarks carry no sensor; expected none where they are surveyed", path=file, field=place)
    pose = _sensor_pose(given, file, place)
    if pose.dim == dim or dim == 3:
        return pose
    if np.abs(pose.rotation[2, :2]).max() > 1e-9:
        raise InputError(
            "a tilted sensor does not measure in the plane; give its heading alone (theta), or measurements in space",
            path=file, field=place,
        )  # fmt: skip
    return Pose.from_xytheta(pose.xytheta())


def _sensor_pose(given: Mapping[str, float], path: Path, place: str) -> Pose:
    """x, y, theta in the plane; with z or a quaternion, in space. What is not said is 0."""
    unknown = [name for name in given if name not in SENSOR_KEYS]
    if unknown:
        raise InputError(f"unknown key '{unknown[0]}'; known are {', '.join(SENSOR_KEYS)}", path=path, field=place)
    if not all(np.isfinite(value) for value in given.values()):
        raise InputError("expected finite numbers", path=path, field=place)
    x, y, z, theta = (given.get(name, 0.0) for name in ("x", "y", "z", "theta"))
    quaternion = np.array([given.get(name, 0.0) for name in ("qw", "qx", "qy", "qz")])
    turned = any(name in given for name in ("qw", "qx", "qy", "qz"))
    if not turned and "z" not in given:
        return Pose.from_xytheta(np.array([x, y, theta]))
    if turned and "theta" in given:
        raise InputError("give theta or a quaternion, not both", path=path, field=place)
    if turned and abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-3:
        raise InputError("a unit quaternion (qw, qx, qy, qz) has length 1", path=path, field=place)
    if not turned:
        quaternion = np.array([np.cos(0.5 * theta), 0.0, 0.0, np.sin(0.5 * theta)])
    return Pose.from_quaternion(np.array([x, y, z]), quaternion)
