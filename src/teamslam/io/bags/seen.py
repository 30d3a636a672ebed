"""What one robot saw: its recording as streams, and which of its detections count."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.clock import Clock
from teamslam.frontend.stamps import keyframe_of, merge
from teamslam.frontend.streams import TICKS_PER_S, TagCorners, Track
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.depth import TagDepths
from teamslam.frontend.tags.identities import Place
from teamslam.frontend.tags.rows import Tag
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray
from teamslam.io.bags.team_file import CameraEntry, RobotEntry, TeamFile
from teamslam.model import Dropped, landmark_number

MERGE_S = 0.005  # images nearer in time than this are one keyframe: cameras that are triggered together
SPANS = 3  # in which a tag was seen at a place, that are told
SELDOM = 6  # images of a tag that are used at least, where there are as many


class Book:
    """What was left out, and what was understood how."""

    def __init__(self) -> None:
        self.dropped: list[Dropped] = []
        self.notes: list[str] = []

    def drop(self, mask: BoolArray, reason: str) -> None:
        """As many as are True were left out."""
        if count := int(np.count_nonzero(mask)):
            self.dropped.append(Dropped(count, reason))


@dataclass(frozen=True, eq=False)
class View:
    """What one camera of a robot saw: detections that are used, the tag of each, and how deep its face was, where the
    camera has images of depth."""

    entry: CameraEntry
    camera: Camera
    corners: TagCorners
    tags: tuple[Tag, ...] = ()
    depths: TagDepths | None = None

    def select(self, index: AnyArray) -> "View":
        """The detections at a mask or index."""
        rows = np.arange(len(self.corners))[index]
        tags = tuple(self.tags[row] for row in rows.tolist()) if self.tags else ()
        depths = None if self.depths is None else self.depths.select(rows)
        return replace(self, corners=self.corners.select(rows), tags=tags, depths=depths)

    @property
    def ticks(self) -> IntArray:
        """When the images were taken in which each tag was seen."""
        return self.corners.ticks - round(self.entry.delay_s * TICKS_PER_S)

    def late_s(self, pixels: Array) -> Array:
        """How much later than its image's middle line each of some pixels (..., 2) was read [s]. InputError where the
        shutter rolls over images of a size that nobody told."""
        if self.entry.line_s == 0.0:
            return np.zeros(pixels.shape[:-1])
        if not self.camera.size[1]:
            raise InputError(
                f"camera {self.entry.name} has a rolling shutter (line_s), so its calibration needs the size of its "
                f"images",
                field="robot.camera.line_s",
            )
        return np.asarray((pixels[..., 1] - 0.5 * (self.camera.size[1] - 1)) * self.entry.line_s)

    @property
    def line_late_s(self) -> Array:
        """That of each corner (m, 4)."""
        return self.late_s(self.corners.corners)


@dataclass(frozen=True, eq=False)
class Seen:
    """What is in a robot's recording."""

    entry: RobotEntry
    track: Track | None
    truth: Track | None
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...]
    notes: tuple[str, ...] = ()

    @property
    def clock(self) -> Clock:
        """Its clock beside the team's."""
        streams = [np.zeros(0, np.int64) if self.track is None else self.track.ticks]
        streams += [view.corners.frames for view in self.views]
        ticks = next((ticks for ticks in streams if len(ticks)), np.zeros(1, np.int64))
        stated = self.entry.clock
        return Clock(int((ticks.min() + ticks.max()) // 2), stated.offset_s, stated.drift)

    def with_tags(self, team: TeamFile, book: Book) -> "Seen":
        """The detections that count, with their tags; the others are counted."""
        who, carried = self.entry.name, team.carried()
        views = []
        own = [number for number, tag in carried.items() if tag.is_robot and tag.carrier == who]
        for view in self.views:
            ids, where = view.corners.ids, f"robot {who}, camera {view.entry.name}: sightings of tags"
            ignored = np.isin(ids, team.tags.ignore)
            book.drop(ignored, f"{where} that the team file ignores")
            itself = ~ignored & np.isin(ids, own)
            book.drop(itself, f"{where} that it carries itself")
            ignored = ignored | itself
            mended = ~ignored & (view.corners.hamming > team.tags.most_mended)
            book.drop(mended, f"{where} of which more than {team.tags.most_mended} bits were wrong")
            twice = ~ignored & ~mended & _twice(view)
            if twice.any():
                numbers = ", ".join(map(str, np.unique(ids[twice]).tolist()))
                book.drop(twice, f"{where} whose number is twice in one image, which is which nobody knows: {numbers}")
                ignored = ignored | twice
            outside = ~ignored & ~mended & ~view.camera.rays(view.corners.corners)[1].all(-1)
            book.drop(outside, f"{where} beyond what the calibration covers")
            early = ~ignored & ~mended & ~outside & (view.ticks < 0)
            book.drop(early, f"{where} in images that were exposed before 0 s, since they are stamped late (delay_s)")
            views.append(view.select(~ignored & ~mended & ~outside & ~early))
            images = view.corners.frames
            if again := len(images) - len(np.unique(images)):
                camera = f"robot {who}, camera {view.entry.name}"
                book.notes.append(f"{camera}: {again} of {len(images)} images have the stamp of another")
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
        told = [tuple(carried.get(n) or Tag(n, team.size_of(n), str(n)) for n in v.corners.ids.tolist()) for v in views]
        return replace(self, views=tuple(replace(v, tags=t) for v, t in zip(views, told, strict=True)))

    def with_places(self, places: Sequence[Place], called: dict[int, str], book: Book) -> "Seen":
        """Each place of a tag that stands at several as a landmark of its own, which nobody else can mean; `called`
        gets their names. A landmark of several tags keeps its name."""
        names: dict[int, list[tuple[str, Place]]] = {}
        merged = round(MERGE_S * TICKS_PER_S)  # an image may be so long after its keyframe
        for place in places:
            name = f"{place.tag} at place {place.number} of {self.entry.name}"
            called[landmark_number(name)] = name
            names.setdefault(place.tag, []).append((name, place))
        for tag, found in names.items():
            spans = "; ".join(_when(place) for _, place in found)
            book.notes.append(
                f"robot {self.entry.name}: tag {tag} stands at {len(found)} places ({spans}): it was moved, or its "
                f"number stands twice; each place is a landmark of its own"
            )

        def at(tag: Tag, tick: int) -> Tag:
            for name, place in () if tag.is_robot else names.get(landmark_number(tag.carrier), ()):
                about = merged + place.beside_ticks
                if any(start - about <= tick <= stop + about for start, stop in place.visits):
                    return replace(tag, carrier=name)
            return tag

        views = [
            replace(view, tags=tuple(map(at, view.tags, image_of(view.ticks, view.ticks).tolist())))
            for view in self.views
        ]
        return replace(self, views=tuple(views)) if places else self

    def used(self) -> "Seen":
        """Only what was seen in the images that are used."""
        ticks = np.concatenate([np.zeros(0, np.int64), *(v.ticks for v in self.views)])
        ids = np.concatenate([np.zeros(0, np.int64), *(v.corners.ids for v in self.views)])
        chosen = chosen_images(ticks, ids, self.entry.image_every_s)
        return replace(self, views=tuple(v.select(np.isin(image_of(ticks, v.ticks), chosen)) for v in self.views))


def _twice(view: View) -> BoolArray:
    """Which sightings (m,) are of a number that is in the same image once more."""
    pairs = np.stack([view.corners.frame, view.corners.ids], -1)
    _, of, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[of.ravel()] > 1)


def _when(place: Place) -> str:
    """When a tag was seen at a place."""
    spans = [f"{start / TICKS_PER_S:.1f} s to {stop / TICKS_PER_S:.1f} s" for start, stop in place.visits]
    return ", ".join(spans[:SPANS]) + (f" and {len(spans) - SPANS} times more" if len(spans) > SPANS else "")


def chosen_images(ticks: IntArray, ids: IntArray, every_s: float) -> IntArray:
    """The images [ticks] to use of sightings (m,) of tags `ids` at `ticks`: of each stretch of `every_s` the image with
    most tags (the first of several), and of tags seen seldom as many images as SELDOM, evenly taken."""
    if not len(ticks):
        return np.zeros(0, np.int64)
    images, of = np.unique(image_of(ticks, ticks), return_inverse=True)
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


def image_of(all_ticks: IntArray, ticks: IntArray) -> IntArray:
    """The image that each sighting is in: those of cameras that are triggered together are one."""
    return keyframe_of(merge(all_ticks, round(MERGE_S * TICKS_PER_S)), ticks) if len(ticks) else ticks
