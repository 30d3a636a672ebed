"""A team's log from recordings: the format `recordings`, whose path is a team file.

What becomes of messages: a keyframe pose at every image that is used and wherever a robot was seen by another;
odometry between keyframes (`frontend.way`); every tag in these images as a row of the model `corners`, of a landmark or
of the robot that carries it. Of the images of a robot those are used that show most tags, one every `image_every_s`,
and as many more as tags need that are seen seldom.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from teamslam.errors import InputError
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.stamps import keyframe_of, merge
from teamslam.frontend.streams import TICKS_PER_S, TagCorners, Track
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.detect import Looking, of_one_family
from teamslam.frontend.tags.identities import Place, places_of_tags
from teamslam.frontend.tags.rows import LOOKING, Tag, corner_rows
from teamslam.frontend.way import Steps, WayNoise, diagonal, standing, steps_between
from teamslam.geometry import AnyArray, BoolArray, IntArray, Pose, concatenate
from teamslam.io.bags.calibration import camera_in, read_camera
from teamslam.io.bags.looked import Progress, refuse_other_size, tags_in
from teamslam.io.bags.opened import is_recording, opened
from teamslam.io.bags.pictures import Pictures, pictures_of_folder, pictures_of_topic
from teamslam.io.bags.streams import read_corners, read_track
from teamslam.io.bags.team_file import CameraEntry, RobotEntry, TeamFile, is_team_file, read_team_file
from teamslam.io.files.options import options_of
from teamslam.model import (
    Dataset,
    Dropped,
    Kind,
    Loss,
    Names,
    Table,
    Values,
    index_of,
    landmark_key,
    landmark_number,
    pack,
    pose_key,
    pose_kind,
    whitening,
)

MERGE_S = 0.005  # images nearer in time than this are one keyframe: cameras that are triggered together
TRUTH_GAP_S = 0.2  # between two true poses, beyond which there is no truth
SELDOM = 6  # images of a tag that are used at least, where there are as many


@dataclass(frozen=True)
class Options:
    """The reader of recordings has none: all is in the team file."""


def sniff(path: Path) -> bool:
    """True for a team file."""
    return is_team_file(path)


def read(path: Path, options: Mapping[str, object] | None = None, progress: Progress | None = None) -> Dataset:
    """The log of the team in a team file; `progress` hears how far the search for tags in images is. InputError names
    file and field of what cannot be read."""
    options_of(Options, options, reader="recordings")
    team = read_team_file(path)
    seen = [_seen(robot, path.parent, team.tags.looking(), progress) for robot in team.robot]
    book = _Book()
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
        places = places_of_tags(_sightings(robot, number, numbers, keyframes, team))
        robot = robot.with_places(places, called, book)
        tables += _odometry(robot, number, keyframes[number], book)
        tables += _sightings(robot, number, numbers, keyframes, team)
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


class _Book:
    """What was left out, and what was understood how."""

    def __init__(self) -> None:
        self.dropped: list[Dropped] = []
        self.notes: list[str] = []

    def drop(self, mask: BoolArray, reason: str) -> None:
        if count := int(np.count_nonzero(mask)):
            self.dropped.append(Dropped(count, reason))


@dataclass(frozen=True, eq=False)
class _View:
    """What one camera of a robot saw: detections that are used, and the tag of each."""

    entry: CameraEntry
    camera: Camera
    corners: TagCorners
    tags: tuple[Tag, ...] = ()

    def select(self, index: AnyArray) -> "_View":
        rows = np.arange(len(self.corners))[index]
        tags = tuple(self.tags[row] for row in rows.tolist()) if self.tags else ()
        return replace(self, corners=self.corners.select(rows), tags=tags)

    @property
    def ticks(self) -> IntArray:
        """When the images were taken in which each tag was seen."""
        return self.corners.ticks - round(self.entry.delay_s * TICKS_PER_S)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is in a robot's recording."""

    entry: RobotEntry
    track: Track | None
    truth: Track | None
    views: tuple[_View, ...]
    dropped: tuple[Dropped, ...]
    notes: tuple[str, ...] = ()

    def with_tags(self, team: TeamFile, book: _Book) -> "_Seen":
        """The detections that count, with their tags; the others are counted."""
        who, carried = self.entry.name, team.carried()
        views = []
        for view in self.views:
            ids, where = view.corners.ids, f"robot {who}, camera {view.entry.name}: sightings of tags"
            ignored = np.isin(ids, team.tags.ignore)
            book.drop(ignored, f"{where} that the team file ignores")
            mended = ~ignored & (view.corners.hamming > team.tags.most_mended)
            book.drop(mended, f"{where} of which more than {team.tags.most_mended} bits were wrong")
            outside = ~ignored & ~mended & ~view.camera.rays(view.corners.corners)[1].all(-1)
            book.drop(outside, f"{where} beyond what the calibration covers")
            views.append(view.select(~ignored & ~mended & ~outside))
        ids = np.concatenate([np.zeros(0, np.int64), *(v.corners.ids for v in views)])
        bodies = Counter(carried[n].carrier if n in carried else str(n) for n in ids.tolist())
        few = np.array(
            [
                n
                for n in np.unique(ids).tolist()
                if bodies[carried[n].carrier if n in carried else str(n)] < team.tags.fewest
            ],
            np.int64,
        )
        for number in few.tolist():
            rare = int(sum(np.count_nonzero(v.corners.ids == number) for v in views))
            why = f"seen in fewer than {team.tags.fewest} images: a misread, or too little to map it"
            book.dropped.append(Dropped(rare, f"robot {who}: sightings of tag {int(number)}, {why}"))
        views = [v.select(~np.isin(v.corners.ids, few)) for v in views]
        own = {number for number, tag in carried.items() if tag.is_robot and tag.carrier == who}
        views = [v.select(~np.isin(v.corners.ids, list(own))) for v in views]
        told = [tuple(carried.get(n) or Tag(n, team.size_of(n), str(n)) for n in v.corners.ids.tolist()) for v in views]
        return replace(self, views=tuple(replace(v, tags=t) for v, t in zip(views, told, strict=True)))

    def with_places(self, places: Sequence[Place], called: dict[int, str], book: _Book) -> "_Seen":
        """Each place of a tag that stands at several as a landmark of its own, which nobody else can mean; `called`
        gets their names. A landmark of several tags keeps its name."""
        names: dict[int, list[tuple[str, Place]]] = {}
        for place in places:
            name = f"{place.tag} at place {place.number} of {self.entry.name}"
            called[landmark_number(name)] = name
            names.setdefault(place.tag, []).append((name, place))
        for tag, found in names.items():
            spans = "; ".join(
                ", ".join(f"{a / TICKS_PER_S:.1f} s to {b / TICKS_PER_S:.1f} s" for a, b in place.visits)
                for _, place in found
            )
            book.notes.append(
                f"robot {self.entry.name}: tag {tag} stands at {len(found)} places ({spans}): it was moved, or its "
                f"number stands twice; each place is a landmark of its own"
            )

        def at(tag: Tag, tick: int) -> Tag:
            for name, place in () if tag.is_robot else names.get(landmark_number(tag.carrier), ()):
                if any(start <= tick <= stop for start, stop in place.visits):
                    return replace(tag, carrier=name)
            return tag

        views = [
            replace(view, tags=tuple(map(at, view.tags, _image_of(view.ticks, view.ticks).tolist())))
            for view in self.views
        ]
        return replace(self, views=tuple(views)) if places else self

    def used(self) -> "_Seen":
        """Only what was seen in the images that are used."""
        ticks = np.concatenate([np.zeros(0, np.int64), *(v.ticks for v in self.views)])
        ids = np.concatenate([np.zeros(0, np.int64), *(v.corners.ids for v in self.views)])
        chosen = chosen_images(ticks, ids, self.entry.image_every_s)
        return replace(self, views=tuple(v.select(np.isin(_image_of(ticks, v.ticks), chosen)) for v in self.views))


def chosen_images(ticks: IntArray, ids: IntArray, every_s: float) -> IntArray:
    """The images [ticks] to use of sightings (m,) of tags `ids` at `ticks`: of each stretch of `every_s` the image with
    most tags (the first of several), and of tags seen seldom as many images as SELDOM, evenly taken."""
    if not len(ticks):
        return np.zeros(0, np.int64)
    images, of = np.unique(_image_of(ticks, ticks), return_inverse=True)
    counts = np.bincount(of)
    stretch = (images - images[0]) // max(round(every_s * TICKS_PER_S), 1)
    order = np.lexsort([images, -counts, stretch])
    used = np.zeros(len(images), bool)
    used[order[np.append(True, np.diff(stretch[order]) > 0)]] = True
    for number in np.unique(ids).tolist():
        own = np.unique(of[ids == number])
        if used[own].sum() < SELDOM:
            used[own[np.unique(np.linspace(0, len(own) - 1, min(SELDOM, len(own))).astype(int))]] = True
    return images[used]


def _image_of(all_ticks: IntArray, ticks: IntArray) -> IntArray:
    """The image that each sighting is in: those of cameras that are triggered together are one."""
    return keyframe_of(merge(all_ticks, round(MERGE_S * TICKS_PER_S)), ticks) if len(ticks) else ticks


def _seen(entry: RobotEntry, folder: Path, looking: Looking, progress: Progress | None) -> _Seen:
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
                views.append(_View(camera, known, read_corners(recording, camera.tags)))
                continue
            look = _look(entry, camera, known, pictures_of_topic(recording, camera.images), looking, progress)
            views.append(look.view)
            dropped += look.dropped
            notes.append(look.note)
        dropped += [Dropped(d.count, f"robot {entry.name}: {d.reason}") for d in recording.dropped]
        return _Seen(entry, track, truth, tuple(views), tuple(dropped), tuple(notes))


def _seen_in_files(entry: RobotEntry, folder: Path, looking: Looking, progress: Progress | None) -> _Seen:
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
    return _Seen(
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

    view: _View
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
    return _Look(_View(camera, known, corners), dropped, note)


# --- the tables ---------------------------------------------------------------------------------------------------


def _keyframes(team: Sequence[_Seen], numbers: Mapping[str, int]) -> dict[int, IntArray]:
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


def _truth(team: Sequence[_Seen], file: TeamFile, log: Dataset) -> Values | None:
    """Where robots and tags truly are, of those that are known."""
    found: dict[Kind, list[tuple[IntArray, Pose]]] = {}
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
        if np.isin(key, log.landmark_keys).all():
            found.setdefault(Kind.POSE3, []).append((key, tag.pose[None]))
    if not found:
        return None
    parts = {kind: (np.concatenate([k for k, _ in f]), concatenate([p for _, p in f])) for kind, f in found.items()}
    return Values.of(parts)  # type: ignore[arg-type]


def _odometry(robot: _Seen, number: int, ticks: IntArray, book: _Book) -> list[Table]:
    noise, dim = robot.entry.motion, robot.entry.dim
    if robot.track is not None:
        pairs = np.stack([ticks[:-1], ticks[1:]], -1)
        steps = steps_between(robot.track, ticks, noise)
        poses, covariances = steps.poses, steps.covariances
        book.notes += _told(robot, steps, ticks, noise)
    else:
        pairs = _ties(robot, ticks)
        poses, variances = standing((pairs[:, 1] - pairs[:, 0]) / TICKS_PER_S, noise)
        covariances = diagonal(variances)
        book.notes.append(
            f"robot {robot.entry.name} has no odometry: {_model(noise)} those of its frames that tags tie to each "
            f"other, in {len(ticks) - len(pairs)} parts"
        )
    if not len(pairs):
        return []
    if dim == 2:
        poses = Pose.from_xytheta(poses.xytheta())
        covariances = covariances[:, [[0], [1], [5]], [0, 1, 5]]
    pairs = pose_key(number, pairs)
    return [
        Table(
            number, "odometry", "relative_pose", dim, pairs, pack(poses), whitening(covariances), np.arange(len(pairs))
        )
    ]


def _ties(robot: _Seen, ticks: IntArray) -> IntArray:
    """Pairs (n, 2) of keyframes of a robot without odometry: each with the next of those that share tags with it, or
    with others that do, and so on. Between such parts nothing is known, not even that the camera hardly moved."""
    views = robot.used().views
    frame = np.concatenate(
        [np.zeros(0, np.int64), *(np.searchsorted(ticks, keyframe_of(ticks, v.ticks)) for v in views)]
    )
    names, mark = np.unique([tag.carrier for v in views for tag in v.tags], return_inverse=True)
    n = len(ticks)
    graph = sp.coo_array((np.ones(len(frame)), (frame, n + mark)), shape=(n + len(names),) * 2)
    part = np.asarray(connected_components(graph, directed=False)[1], np.int64)[:n]
    order = np.lexsort([ticks, part])
    same = np.diff(part[order]) == 0
    pairs = np.stack([ticks[order[:-1]][same], ticks[order[1:]][same]], -1)
    return np.asarray(pairs[np.argsort(pairs[:, 0], kind="stable")])


def _model(noise: WayNoise) -> str:
    return f"the motion model ({noise.speed_m_s:g} m/s, {noise.turn_rad_s:g} rad/s) ties"


def _told(robot: _Seen, steps: Steps, ticks: IntArray, noise: WayNoise) -> list[str]:
    """What is to be said of a robot's way."""
    assert robot.track is not None
    who, model = f"robot {robot.entry.name}", f"{_model(noise)} its frames"
    notes = []
    if len(steps.jumps):
        at = ", ".join(f"{(tick - robot.track.ticks.min()) / TICKS_PER_S:.2f} s" for tick in steps.jumps[:8].tolist())
        more = f" and {len(steps.jumps) - 8} more" if len(steps.jumps) > 8 else ""
        notes.append(f"{who}: odometry jumped {len(steps.jumps)} times, at {at}{more} after its start; {model} there")
    if steps.missing:
        notes.append(f"{who}: odometry is missing in {steps.missing} of {len(ticks) - 1} steps; {model} there")
    return notes


def _sightings(
    robot: _Seen, number: int, numbers: Mapping[str, int], keyframes: Mapping[int, IntArray], team: TeamFile
) -> list[Table]:
    """A robot's tags in its images, of landmarks and of other robots, a table for each camera and kind."""
    tables: list[Table] = []
    first = {"landmarks": 0, "robots": 0}
    loss = Loss(team.tags.loss, team.tags.loss_scale)
    for view in robot.used().views:
        for source in first:
            rows = np.array([tag.is_robot == (source == "robots") for tag in view.tags], bool)
            part = view.select(rows)
            if not len(part.corners):
                continue
            values, white, good = corner_rows(
                part.corners, part.camera, list(part.tags), part.entry.floor_px, part.entry.edge_px
            )
            observers = pose_key(number, keyframe_of(keyframes[number], part.ticks))
            targets = np.array([_target(tag, tick, numbers, keyframes)
                                for tag, tick in zip(part.tags, part.ticks.tolist(), strict=True)])  # fmt: skip
            ids = first[source] + np.arange(len(values))
            first[source] += len(values)
            keys = np.stack([observers, targets], -1)
            sensor = part.entry.pose @ LOOKING
            tables.append(
                Table(number, source, "corners", 3, keys[good], values[good], white[good], ids[good], sensor, loss)
            )
    return tables


def _target(tag: Tag, tick: int, numbers: Mapping[str, int], keyframes: Mapping[int, IntArray]) -> int:
    if tag.is_robot:
        other = numbers[tag.carrier]
        return int(pose_key(other, keyframe_of(keyframes[other], np.array([tick]))[0]))
    return int(landmark_key(landmark_number(tag.carrier)))
