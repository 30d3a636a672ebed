"""A team's log from recordings: the format `recordings`, whose path is a team file.

What becomes of messages: a keyframe pose at every image that is used and wherever a robot was seen by another;
odometry between keyframes (`frontend.way`); every tag in these images as a row of the model `corners`, of a landmark or
of the robot that carries it. Of the images of a robot those are used that show most tags, one every `image_every_s`,
and as many more as tags need that are seen seldom.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.stamps import merge
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.identities import places_of_tags
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.io.bags.looked import Progress
from teamslam.io.bags.recorded import seen_by
from teamslam.io.bags.seen import MERGE_S, Book, Seen
from teamslam.io.bags.sighting_rows import sightings_of
from teamslam.io.bags.team_file import TeamFile, is_team_file, read_team_file
from teamslam.io.bags.way_rows import way_of
from teamslam.io.files.options import options_of
from teamslam.model import (
    Dataset,
    Kind,
    Names,
    Table,
    Values,
    index_of,
    landmark_key,
    landmark_number,
    pose_kind,
)

TRUTH_GAP_S = 0.2  # between two true poses, beyond which there is no truth


@dataclass(frozen=True)
class Options:
    """`recordings`: paths that stand for those in the team file, in the order in which it first names them."""

    recordings: list[str] = field(default_factory=list)


def sniff(path: Path) -> bool:
    """True for a team file."""
    return is_team_file(path)


def read(path: Path, options: Mapping[str, object] | None = None, progress: Progress | None = None) -> Dataset:
    """The log of the team in a team file; `progress` hears how far the search for tags in images is. InputError names
    file and field of what cannot be read."""
    others = options_of(Options, options, reader="recordings").recordings
    team = read_team_file(path).with_recordings(others, path)
    seen = [seen_by(robot, path.parent, team, progress) for robot in team.robot]
    book = Book()
    for robot in seen:
        book.dropped += robot.dropped
        book.notes += robot.notes
    told = [robot.with_tags(team, book) for robot in seen]
    numbers = {robot.name: k + 1 for k, robot in enumerate(team.robot)}
    keyframes = _keyframes(told, numbers)
    tables: list[Table] = []
    called: dict[int, str] = {}
    for robot in told:
        number = numbers[robot.entry.name]
        places = places_of_tags(sightings_of(robot, told, keyframes, team))
        robot = robot.with_places(places, called, book)
        tables += way_of(robot, number, keyframes[number], book)
        tables += sightings_of(robot, told, keyframes, team)
    if not any(table.source != "odometry" for table in tables):
        raise InputError("no tag was seen in any image; check topics and calibrations", path=path)
    landmarks = called | {landmark_number(entry.name): entry.name for entry in team.landmark}
    names = Names({number: name for name, number in numbers.items() if name != str(number)}, landmarks)
    log = Dataset(
        {numbers[robot.name]: robot.dim for robot in team.robot},
        tuple(tables),
        names,
        dropped=tuple(book.dropped),
        notes=tuple(book.notes),
        origin=str(path),
    )
    return replace(log, truth=_truth(told, team, log))


def _keyframes(team: Sequence[Seen], numbers: Mapping[str, int]) -> dict[int, IntArray]:
    """Where each robot needs a pose: in its images, and when it was seen."""
    wanted: dict[int, list[IntArray]] = {number: [] for number in numbers.values()}
    for robot in team:
        for view in robot.used().views:
            wanted[numbers[robot.entry.name]].append(view.ticks)
            for tag in {tag.carrier for tag in view.tags if tag.is_robot}:
                rows = np.array([t.is_robot and t.carrier == tag for t in view.tags])
                wanted[numbers[tag]].append(view.ticks[rows])
    merged = round(MERGE_S * TICKS_PER_S)
    return {n: merge(np.concatenate([np.zeros(0, np.int64), *ticks]), merged) for n, ticks in wanted.items()}


def _truth(team: Sequence[Seen], file: TeamFile, log: Dataset) -> Values | None:
    """Where robots and tags truly are, of those that are known."""
    found: dict[Kind, list[tuple[IntArray, Pose]]] = {}
    places: list[tuple[int, tuple[float, float, float]]] = []  # of tags of which nobody says how they are turned
    for number, robot in enumerate(team, 1):
        if robot.truth is None or not len(robot.truth):
            continue
        ticks, first = np.unique(robot.truth.ticks, return_index=True)
        keys = log.pose_keys[number]
        poses, known = interpolate(ticks, robot.truth.poses[first], index_of(keys), round(TRUTH_GAP_S * TICKS_PER_S))
        if robot.entry.dim == 2:
            poses = Pose.from_xytheta(poses.xytheta())
        found.setdefault(pose_kind(robot.entry.dim), []).append((keys[known], poses[np.flatnonzero(known)]))
    for tag in file.truth:
        key = np.array([landmark_key(landmark_number(str(tag.number)))])
        if not np.isin(key, log.landmark_keys).all():
            continue
        if tag.quaternion_wxyz is None and tag.rotation_vector is None:
            places.append((int(key[0]), tag.xyz_m))
        else:
            found.setdefault(Kind.POSE3, []).append((key, tag.pose[None]))
    if not found and not places:
        return None
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {
        kind: (np.concatenate([k for k, _ in f]), concatenate([p for _, p in f])) for kind, f in found.items()
    }
    if places:
        parts[Kind.POINT3] = (np.array([key for key, _ in places]), np.array([place for _, place in places]))
    return Values.of(parts)
