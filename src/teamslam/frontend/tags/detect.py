"""Tags in an image, by the AprilTag library (the package `apriltag-python`), as `TagCorners` has them.

The library puts the centre of the first pixel at (0.5, 0.5), and names corners as the tag is printed by its makers;
OpenCV's pictures of the same tags stand on their heads. It lets other threads run while it looks. Two packages that
bring this library break each other in one process: no other may be loaded beside it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.acute import unturned
from teamslam.frontend.tags.beside import undrawn
from teamslam.frontend.tags.edges import CUT, edge_widths
from teamslam.frontend.tags.inside import beside_their_cells
from teamslam.geometry import AnyArray, Array, IntArray

SIDES = {
    "tag36h11": 8, "tag36h10": 8, "tag25h9": 7, "tag16h5": 6, "tagCircle21h7": 5, "tagCircle49h12": 5,
    "tagStandard41h12": 5, "tagStandard52h13": 6, "tagCustom48h12": 6,
}  # fmt: skip
"""The families that the library has, and how many cells there are between the corners of their tags."""
FAMILIES = tuple(SIDES)
HALF_PIXEL = 0.5
MENDED = 1  # bits that the library may mend: with 2, families of many tags take gigabytes, and misreads abound


@dataclass(frozen=True)
class Looking:
    """How tags are looked for: `families` of FAMILIES, and by how much the image is made smaller (`decimate`) for the
    search: 2 is some three times as fast, and misses small tags. InputError for what can be no such thing."""

    families: tuple[str, ...] = ("tag36h11",)
    decimate: float = 1.0

    def __post_init__(self) -> None:
        if not self.families or len(set(self.families)) < len(self.families):
            raise InputError("name at least one family of tags, and none twice", field="families")
        for name in self.families:
            if name not in FAMILIES:
                raise InputError(f"unknown family '{name}'; choose of {', '.join(FAMILIES)}", field="families")
        if not 1.0 <= self.decimate <= 8.0:
            raise InputError(f"decimate is 1 (the whole image) to 8, found {self.decimate:g}", field="decimate")


@dataclass(frozen=True, eq=False)
class Found:
    """The tags of one image: `ids` (m,), `corners` (m, 4, 2) [pixels], `hamming` (m,), `families` (m,), and how wide
    their edges are (m, 4) [pixels], as `edge_widths` says; `size` is (width, height) of the image."""

    ids: IntArray
    corners: Array
    hamming: IntArray
    families: tuple[str, ...]
    widths: Array
    size: tuple[int, int]


class Detector:
    """Looks for tags in images; one for each thread. MissingExtraError without the library."""

    def __init__(self, looking: Looking) -> None:
        library = library_of_tags()
        self._reach = float(int(looking.decimate) + 1)  # as the library has it
        self._of = {
            name: library.apriltag(name, threads=1, maxhamming=MENDED, decimate=looking.decimate)
            for name in looking.families
        }

    def __call__(self, image: AnyArray) -> Found:
        """The tags in an image (h, w) of bytes, ordered by family, number and place."""
        image = np.ascontiguousarray(image)
        tags = [(name, tag) for name, detector in self._of.items() for tag in detector.detect(image)]
        tags.sort(key=lambda found: (found[0], found[1]["id"], *found[1]["center"].tolist()))
        corners = np.array([tag["lb-rb-rt-lt"] for _, tag in tags], float).reshape(-1, 4, 2) - HALF_PIXEL
        widths = edge_widths(image, corners)
        sides = np.array([SIDES[name] for name, _ in tags], np.int64)
        corners = undrawn(image, unturned(corners, widths, self._reach), widths, sides, self._reach)
        widths = np.where(beside_their_cells(image, corners, widths, sides), CUT, widths)
        return Found(
            np.array([tag["id"] for _, tag in tags], np.int64),
            corners,
            np.array([tag["hamming"] for _, tag in tags], np.int64),
            tuple(name for name, _ in tags),
            widths,
            (image.shape[1], image.shape[0]),
        )


def of_one_family(seen: TagCorners) -> tuple[TagCorners, dict[str, int]]:
    """Numbers tell tags apart, and several families may have one: each number stays with the family in which it was
    seen most often. Also returns how many sightings that leaves out, by reason."""
    wrong = np.zeros(len(seen), bool)
    families, left_out = np.array(seen.families, np.str_), {}
    for number in np.unique(seen.ids).tolist() if len(set(seen.families)) > 1 else ():
        names, counts = np.unique(families[seen.ids == number], return_counts=True)
        kept = names[np.argmax(counts)]
        for name, count in zip(names.tolist(), counts.tolist(), strict=True):
            if name != kept:
                wrong |= (seen.ids == number) & (families == name)
                left_out[f"{name} with number {number}, which is that of a tag of {kept}"] = count
    return (seen.select(~wrong) if wrong.any() else seen), left_out


def library_of_tags() -> Any:
    """The AprilTag library. MissingExtraError where it is not installed."""
    try:
        import apriltag
    except ImportError:
        raise MissingExtraError(
            "looking for tags in images needs the AprilTag library; install it with `pip install teamslam[tags]`"
        ) from None
    return apriltag
