"""The images in which a map fits worst and best, with the corners as they were seen and as the map has them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.geometry import AnyArray
from teamslam.io.bags.pictures import Unusable, opencv
from teamslam.io.bags.recorded import images_of
from teamslam.io.bags.team_file import TeamFile
from teamslam.io.files.whole import whole_file
from teamslam.results.reprojection import Reprojected

EACH = 3  # of the worst, and of the best, of all cameras together
NEAR_S = 0.006  # an image and its keyframe
FAR = 1 << 24  # from an image: where a map that does not fit may have a corner
SEEN, MAPPED = (0, 94, 213), (178, 114, 0)  # in blue, green, red: orange as seen, blue by the map


def write_frames(found: Sequence[Reprojected], team: TeamFile, folder: Path, out: Path) -> int:
    """Draw them as PNG files into a folder, which is made; how many. Images alone count, not topics of detections."""
    images = []  # how far off, how many tags, which camera, when
    for number, one in enumerate(found):
        if one.entry.images:
            ticks, of = np.unique(one.ticks, return_inverse=True)
            off = np.sqrt(np.bincount(of, (one.off**2).mean(-1)) / np.bincount(of))
            images += list(
                zip(off.tolist(), np.bincount(of).tolist(), [number] * len(off), ticks.tolist(), strict=True)
            )
    worst = sorted(images, reverse=True)[:EACH]
    most = max((count for _, count, _, _ in images), default=0)
    best = sorted(image for image in images if image[1] >= min(2, most) and image not in worst)[:EACH]
    named = {
        (n, t): f"{kind}_{k}"
        for kind, some in (("worst", worst), ("best", best))
        for k, (_, _, n, t) in enumerate(some, 1)
    }
    done = 0
    for number, tick, image in pictures_at(found, set(named), team, folder):
        one = found[number]
        _write(image, one.select(one.ticks == tick), out / f"{named[number, tick]}.png")
        done += 1
    return done


def pictures_at(
    found: Sequence[Reprojected], wanted: set[tuple[int, int]], team: TeamFile, folder: Path
) -> Iterator[tuple[int, int, AnyArray]]:
    """The grey values of some images, each by the number of its camera among `found` and its keyframe's tick, camera by
    camera; those that cannot be read are left out."""
    for number in sorted({n for n, _ in wanted}):
        one = found[number]
        left = {t for n, t in wanted if n == number}
        entry = next(robot for robot in team.robot if robot.name == one.robot)
        late = round(one.entry.delay_s * TICKS_PER_S)
        with images_of(entry, one.entry, folder) as pictures:
            for picture in pictures.each():
                tick = next((t for t in left if abs(picture.tick - late - t) <= NEAR_S * TICKS_PER_S), None)
                if tick is None:
                    continue
                try:
                    image = picture.grey()
                except Unusable:
                    continue
                yield number, tick, image
                left.remove(tick)
                if not left:
                    break


def _write(image: AnyArray, sightings: Reprojected, path: Path) -> None:
    cv2 = opencv()
    drawn = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2BGR)
    larger = max(1, round(1280 / max(drawn.shape[1], 1)))
    drawn = cv2.resize(drawn, None, fx=larger, fy=larger, interpolation=cv2.INTER_NEAREST)
    for tag, seen, mapped, off in zip(
        sightings.tags.tolist(), sightings.seen, sightings.mapped, sightings.off, strict=True
    ):
        for corners, colour in ((mapped, MAPPED), (seen, SEEN)):
            at = np.round(((corners + 0.5) * larger - 0.5) * 16)  # to a sixteenth of a pixel
            at = np.clip(at, -FAR, FAR).astype(np.int32)
            cv2.polylines(drawn, [at.reshape(-1, 1, 2)], True, colour, 1, cv2.LINE_AA, 4)
        place = np.round((seen[:, 0].min() * larger, seen[:, 1].min() * larger - 6)).astype(int).tolist()
        words = f"{tag}: {np.sqrt(np.mean(off**2)):.2f} px"
        cv2.putText(drawn, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, SEEN, 1, cv2.LINE_AA)
    good, data = cv2.imencode(".png", drawn)
    if good:
        with whole_file(path) as file:
            file.write(data.tobytes())
