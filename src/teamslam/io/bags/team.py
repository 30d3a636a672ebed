"""A team's log from recordings: the format `recordings`, whose path is a team file.

What becomes of messages: a keyframe pose at every image that is used and wherever a robot was seen by another;
odometry between keyframes (`frontend.way`); every tag in these images as a row of the model `corners`, of a landmark or
of the robot that carries it. Of the images of a robot those are used that show most tags, one every `image_every_s`,
and as many more as tags need that are seen seldom.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import on_a_smooth_way
from teamslam.frontend.stamps import merge
from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.identities import Place, places_of_tags
from teamslam.frontend.tags.reckoned import places_by_way
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.io.bags.first_guess import first_guess, looks_of
from teamslam.io.bags.leaning import leaning
from teamslam.io.bags.looked import Progress
from teamslam.io.bags.recorded import seen_by
from teamslam.io.bags.seen import MERGE_S, Book, Seen
from teamslam.io.bags.sighting_rows import Part, parts_of, renamed, sightings_of, ticks_by
from teamslam.io.bags.team_file import TeamFile, is_team_file, read_team_file
from teamslam.io.bags.unknowns import Stated, file_with, stated_in, team_with
from teamslam.io.bags.way_rows import way_of
from teamslam.io.files.options import options_of
from teamslam.model import (
    Dataset,
    Dropped,
    Kind,
    Loss,
    Names,
    Stamps,
    Standing,
    Table,
    Unknown,
    Values,
    index_of,
    landmark_key,
    landmark_number,
    pose_kind,
)

REASONS = 6  # why there is no sighting, that are told
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
    told = tuple(robot.with_tags(team, book) for robot in seen)
    looked = looks_of(told)
    book.notes += leaning(told, looked)
    book.notes += _unseen(told, team)
    recordings = Recordings(team, path, told, stated_in(team, told), tuple(book.dropped), tuple(book.notes))
    return recordings.log(first_guess(told, recordings.stated, looked))


@dataclass(frozen=True, eq=False)
class Recordings:
    """What all robots of a team saw, every detection that counts, and what in the team file is `stated` only."""

    file: TeamFile
    path: Path
    told: tuple[Seen, ...]
    stated: tuple[Stated, ...]
    dropped: tuple[Dropped, ...]
    notes: tuple[str, ...]

    def log(self, values: Array, visits: Mapping[int, list[Place]] | None = None) -> Dataset:
        """The log, were what is stated `values`. `visits`: the places of each robot's tags that their visits told when
        it was read before; visits are told by maps of their own, and what is stated changes nothing of which is which.
        """
        book = Book()
        file = file_with(self.file, self.stated, values)
        team = [robot.used() for robot in team_with(self.told, file)]
        numbers = {robot.name: k + 1 for k, robot in enumerate(file.robot)}
        keyframes = _keyframes(team, numbers)
        tables: list[Table] = []
        called: dict[int, str] = {}
        named: list[Seen] = []
        by_visits: dict[int, list[Place]] = {}
        for robot in team:
            number = numbers[robot.entry.name]
            way = [] if robot.track is None else way_of(robot, number, keyframes[number], book)
            seen = sightings_of(robot, team, keyframes, file)
            by_way = places_by_way(seen, way)
            by_visits[number] = _by_visits(seen, by_way) if visits is None else visits[number]
            places = _together(by_way, by_visits[number])
            robot = robot.with_places(places, called, book)
            named.append(robot)
            tables += way if robot.track is not None else way_of(robot, number, keyframes[number], book)
            tables += renamed(seen, robot, team, keyframes) if places else seen
        if not any(table.source != "odometry" for table in tables):
            raise InputError(self._without_sightings, path=self.path)
        landmarks = called | {landmark_number(entry.name): entry.name for entry in file.landmark}
        names = Names({number: name for name, number in numbers.items() if name != str(number)}, landmarks)
        log = Dataset(
            {numbers[robot.name]: robot.dim for robot in file.robot},
            tuple(tables),
            names,
            dropped=(*self.dropped, *book.dropped),
            notes=(*self.notes, *book.notes),
            origin=str(self.path),
            unknowns=Reading(self, values, tuple(tables), file, tuple(team), tuple(named), keyframes, by_visits),
        )
        return replace(log, truth=_truth(team, file, log, {}))

    @property
    def _without_sightings(self) -> str:
        """Why no sighting is there: what was left out, most first, and what was looked for."""
        families = ", ".join(self.file.tags.families)
        looked = any(camera.images for robot in self.file.robot for camera in robot.camera)
        sought = f" (families: {families})" if looked else ""
        if not self.dropped:
            return f"no tag was seen in any image{sought}; check topics{', families' * looked} and calibrations"
        most = sorted(self.dropped, key=lambda d: -d.count)
        told = "; ".join(f"{d.count}: {d.reason}" for d in most[:REASONS])
        more = f"; and {len(most) - REASONS} reasons more" if len(most) > REASONS else ""
        return f"no sighting of a tag is left{sought}. Left out were {told}{more}"


@dataclass(frozen=True, eq=False)
class Reading:
    """The unknowns of a log of recordings (`teamslam.model.Unknowns`), whose `tables` were made by the `file` that
    states `values`: those sightings that are `used`, with tags `named` as they are in the log, by the places that
    `visits` told."""

    recordings: Recordings
    values: Array
    tables: tuple[Table, ...]
    file: TeamFile
    used: tuple[Seen, ...]
    named: tuple[Seen, ...]
    keyframes: Mapping[int, IntArray]
    visits: Mapping[int, list[Place]]

    @property
    def each(self) -> tuple[Unknown, ...]:
        """What is unknown."""
        return tuple(stated.unknown for stated in self.recordings.stated)

    def again(self, values: Array) -> Dataset:
        """The log, were they others."""
        return self.recordings.log(values, self.visits)

    @property
    def truths(self) -> dict[int, tuple[IntArray, Array]]:
        """Where robots truly were, of those whose truth is not stated to be in time."""
        found = {}
        for number, robot in enumerate(self.used, 1):
            if robot.truth is not None and len(robot.truth) > 1 and not robot.entry.truth_in_time:
                ticks, first = np.unique(robot.truth.ticks, return_index=True)
                found[number] = ticks, robot.truth.poses.translation[first]
        return found

    def truth_with(self, stamps: Mapping[int, Stamps]) -> Values | None:
        """The truth of the log, were that of some robots stamped so."""
        log = Dataset({k + 1: robot.entry.dim for k, robot in enumerate(self.used)}, self.tables)
        return _truth(self.used, self.file, log, stamps)

    def varied(self, values: Array, standing: Standing | None = None) -> tuple[Table, ...]:
        """Those sightings of this log that would be others, were the unknowns; `standing` as a map has it."""
        now = team_with(self.used, file_with(self.recordings.file, self.recordings.stated, values))
        tables: list[Table] = []
        for n, part in enumerate(self._parts):
            if not part.differs(self.used, now):
                continue
            if n not in self._made:
                bases = part.tables(self.used, self._loss)
                self._made[n] = bases, part.standing(bases[0])
            bases, alone = self._made[n]
            if part.differs_in_place(self.used, now):
                tables += [part.moved(base, now) for base in bases]
            else:
                there = part.standing_by(standing or {}, alone)
                tables += part.tables(now, self._loss, there, part.expected(self.used, there))
        return tuple(tables)

    @cached_property
    def _parts(self) -> list[Part]:
        """The parts of all robots."""
        return [part for robot in self.named for part in parts_of(robot, self.used, self.keyframes)]

    @cached_property
    def _made(self) -> dict[int, tuple[list[Table], Pose]]:
        """Of those parts that were asked for, the rows, and how what they saw stood to them."""
        return {}

    @property
    def _loss(self) -> Loss:
        return Loss(self.file.tags.loss, self.file.tags.loss_scale)


def _unseen(team: Sequence[Seen], file: TeamFile) -> list[str]:
    """A sentence on each landmark of several tags of which nobody saw one: its numbers may be others."""
    seen = {tag.carrier for robot in team for view in robot.views for tag in view.tags}
    return [
        f"landmark {entry.name}: nobody saw a tag of it ({', '.join(str(tag.number) for tag in entry.tag)})"
        for entry in file.landmark
        if entry.name not in seen
    ]


def _by_visits(sightings: Sequence[Table], by_way: Sequence[Place]) -> list[Place]:
    """The places of a robot's tags that stand at several by their visits, of those that its way does not tell."""
    told = [place.tag for place in by_way]
    return places_of_tags([table.select(~np.isin(table.keys[:, 1], told)) for table in sightings])


def _together(by_way: list[Place], by_visits: Sequence[Place]) -> list[Place]:
    """The places of all tags: of those that the way that was driven tells, as it has them."""
    told = {place.tag for place in by_way}
    return by_way + [place for place in by_visits if place.tag not in told]


def _keyframes(team: Sequence[Seen], numbers: Mapping[str, int]) -> dict[int, IntArray]:
    """Where each robot needs a pose, by its own clock: in its images, and when it was seen."""
    wanted: dict[int, list[IntArray]] = {number: [] for number in numbers.values()}
    for robot in team:
        for view in robot.views:
            wanted[numbers[robot.entry.name]].append(view.ticks)
            for tag in {tag.carrier for tag in view.tags if tag.is_robot}:
                rows = np.array([t.is_robot and t.carrier == tag for t in view.tags])
                seen = ticks_by(team, numbers[robot.entry.name], numbers[tag], view.ticks[rows])
                wanted[numbers[tag]].append(seen)
    merged = round(MERGE_S * TICKS_PER_S)
    return {n: merge(np.concatenate([np.zeros(0, np.int64), *ticks]), merged) for n, ticks in wanted.items()}


def _truth(team: Sequence[Seen], file: TeamFile, log: Dataset, stamps: Mapping[int, Stamps]) -> Values | None:
    """Where robots and tags truly are, of those that are known; the truth of some robots has stamps of its own."""
    found: dict[Kind, list[tuple[IntArray, Pose]]] = {}
    places: list[tuple[int, tuple[float, float, float]]] = []  # of tags of which nobody says how they are turned
    for number, robot in enumerate(team, 1):
        if robot.truth is None or not len(robot.truth):
            continue
        ticks, first = np.unique(robot.truth.ticks, return_index=True)
        keys = log.pose_keys[number]
        at = stamps[number](index_of(keys)) if number in stamps else index_of(keys)
        poses, known = on_a_smooth_way(ticks, robot.truth.poses[first], at, round(TRUTH_GAP_S * TICKS_PER_S))
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
