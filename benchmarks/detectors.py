"""Detectors of tags on images of which the truth is known, and what the front end adds: docs/benchmarks/detectors.md.

    python benchmarks/detectors.py --out docs/benchmarks/detectors.md

Each image is one tag (36h11) in the virtual lab's room, somewhere near the middle of a Kinect's image, with the noise,
the lens and the exposure of a film: of an edge of so many pixels seen from the front, turned away by an angle, or
moving across the image while it is exposed. Every detector sees the same images, each in a process of its own, as two
packages that bring the AprilTag library break each other in one. Those that are not installed are left out, and told.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose
from teamslam.sim.film.boards import facing, tag_board
from teamslam.sim.film.develop import Sensor, develop
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.shutter import FINE, Shutter
from teamslam.sim.film.stage import CAMERA, experiment
from teamslam.sim.film.takes import KINECT

EACH = 10  # images of a kind
KINDS = [*(("size", px, 0.0, 0.0) for px in (150, 80, 40, 25, 18, 14)),
         *(("angle", 60, angle, 0.0) for angle in (30, 50, 65, 75)),
         *(("blur", 60, 10.0, blur) for blur in (1, 2, 4, 8))]  # fmt: skip
WORDS = {"size": "edge of {0} px", "angle": "{0} px, turned by {1:g} degrees", "blur": "{0} px, moved by {2:g} px"}
WHAT = """RMS error of a corner, a coordinate [pixels], in the median over {each} images; in brackets how many were
missed. OpenCV counts from the centre of the first pixel; half a pixel is taken off what the AprilTag library says.
teamslam looks with apriltag-python: of those that miss least and err least the one whose library is the newest,
and takes out of its corners what is known to move them: aslant corners, cells beside an edge, the lens."""
ADDED = """The front end looks through {0:.1f} of these images a second, the library alone through {1:.1f}: it adds
{2:.1f} % (the least of five runs of each image, turn about, in one process; it also measures how wide edges are)."""
FOUND = 3.0  # pixels: what is farther off is another thing
AHEAD_M = 1.5


def pictures() -> tuple[np.ndarray, np.ndarray]:
    """Images (n, h, w), and the true corners (n, 4, 2)."""
    rng = np.random.default_rng(0)
    renderer = Renderer(experiment(rng), KINECT, Shutter(0.006, 0.0))
    lines = KINECT.size[1]
    still = Pose(np.broadcast_to(np.eye(3), (FINE, lines, 3, 3)), np.zeros((FINE, lines, 3)))
    eye = Pose(
        np.broadcast_to(CAMERA.rotation, still.rotation.shape), np.broadcast_to(CAMERA.translation, (FINE, lines, 3))
    )
    within = ((np.arange(FINE) - 1.0) / FINE)[:, None, None] * np.array([0.0, 1.0, 0.0])
    images, truth = [], []
    for _, px, angle, blur in KINDS:
        for _ in range(EACH):
            size = px * AHEAD_M / KINECT.focal[0]
            roll, side, up = rng.uniform(-0.4, 0.4), *rng.uniform(-0.2, 0.2, 2)
            upright = facing(np.pi + np.radians(angle), CAMERA.translation + np.array([AHEAD_M, side, up]))
            pose = upright @ Pose.from_tangent(np.array([0.0, 0.0, 0.0, 0.0, 0.0, roll]), 3)
            moving = Pose(still.rotation, still.translation + blur * AHEAD_M / KINECT.focal[0] * within)
            light = renderer.scene(eye, [(tag_board(7, size, pose), moving)])
            images.append(develop(light, Sensor(), float(rng.uniform(0, 7)), rng))
            truth.append(KINECT.project(CAMERA.unact(pose.act(size * SQUARE))))
    return np.array(images), np.array(truth)


# --- detectors: an image to the corners of its tags; the AprilTag library counts from the corner of the first pixel --


def apriltag_python() -> Callable:
    """What teamslam uses."""
    import apriltag

    library = apriltag.apriltag("tag36h11", threads=1, maxhamming=1, decimate=1.0)
    return lambda image: [tag["lb-rb-rt-lt"] - 0.5 for tag in library.detect(image)]


def teamslam() -> Callable:
    """The same, less what aslant corners, small cells and the lens do to its lines."""
    from teamslam.frontend.tags.bent import unbent
    from teamslam.frontend.tags.detect import Detector, Looking

    detector = Detector(Looking())
    return lambda image: unbent(detector(image).corners, KINECT)


def pyapriltags() -> Callable:
    """Its Python bindings by others."""
    import pyapriltags

    library = pyapriltags.Detector(families="tag36h11", nthreads=1, quad_decimate=1.0)
    return lambda image: [tag.corners - 0.5 for tag in library.detect(image)]


def pupil() -> Callable:
    """The same, of an older library."""
    import pupil_apriltags

    library = pupil_apriltags.Detector(families="tag36h11", nthreads=1, quad_decimate=1.0)
    return lambda image: [tag.corners - 0.5 for tag in library.detect(image)]


def opencv(refinement: str) -> Callable:
    """OpenCV's own."""
    import cv2

    cv2.setNumThreads(1)
    look = cv2.aruco.DetectorParameters()
    look.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{refinement}")
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    library = cv2.aruco.ArucoDetector(book, look)
    return lambda image: [found[0] for found in library.detectMarkers(image)[0]]


DETECTORS: dict[str, Callable[[], Callable]] = {
    "teamslam": teamslam,
    "apriltag-python": apriltag_python,
    "pyapriltags": pyapriltags,
    "pupil-apriltags": pupil,
    "OpenCV, subpixels": lambda: opencv("SUBPIX"),
    "OpenCV, AprilTag": lambda: opencv("APRILTAG"),
    "OpenCV, as found": lambda: opencv("NONE"),
}


def looked(name: str, folder: Path) -> None:
    """One detector over all images: errors (n,) of the corners, NaN where the tag was missed; seconds a frame."""
    try:
        detector = DETECTORS[name]()
    except ImportError:
        return
    images, truth = np.load(folder / "images.npy"), np.load(folder / "truth.npy")
    errors, seconds = np.full(len(images), np.nan), []
    for k, (image, true) in enumerate(zip(images, truth, strict=True)):
        begin = time.process_time()
        found = detector(image)
        seconds.append(time.process_time() - begin)
        orders = [np.roll(np.asarray(c, float)[::way], s, 0) for c in found for way in (1, -1) for s in range(4)]
        off = [np.sqrt(np.mean((c - true) ** 2)) for c in orders]
        if off and min(off) < FOUND:
            errors[k] = min(off)
    np.save(folder / f"{name}.npy", np.append(errors, np.median(seconds)))


def added(images: np.ndarray) -> tuple[float, float]:
    """Seconds a frame of the library alone, and of the front end: turn about, the least of five of each image."""
    from teamslam.frontend.tags.detect import Detector, Looking

    alone, ours = apriltag_python(), Detector(Looking())
    took = np.full((2, len(images), 5), np.inf)
    for k, image in enumerate(images):
        for again in range(5):
            for which, detector in enumerate((alone, ours)):
                begin = time.process_time()
                detector(image)
                took[which, k, again] = time.process_time() - begin
    bare, whole = took.min(-1).mean(-1).tolist()
    return bare, whole


def page(folder: Path) -> str:
    """The tables."""
    told = [name for name in DETECTORS if (folder / f"{name}.npy").exists()]
    found = {name: np.load(folder / f"{name}.npy") for name in told}
    out = ["# Detectors of tags", "", "Written by `python benchmarks/detectors.py`.", "", "```text"]
    out += [(__doc__ or "").strip().split("\n\n")[2], "```", ""]
    out += [WHAT.format(each=EACH), "", "| | " + " | ".join(told) + " |", "|---|" + "---|" * len(told)]
    for n, (what, px, angle, blur) in enumerate(KINDS):
        cells = [_cell(found[name][n * EACH : (n + 1) * EACH]) for name in told]
        out.append(f"| {WORDS[what].format(px, angle, blur)} | " + " | ".join(cells) + " |")
    out.append("| ms a frame (640 x 480, one thread) | " + " | ".join(f"{1e3 * found[n][-1]:.1f}" for n in told) + " |")
    bare, whole = added(np.load(folder / "images.npy")[::4])
    out += ["", ADDED.format(1 / whole, 1 / bare, 100 * (whole / bare - 1))]
    if lost_ones := [name for name in DETECTORS if name not in told]:
        out += ["", f"Not installed here: {', '.join(lost_ones)}."]
    return "\n".join(out) + "\n"


def _cell(errors: np.ndarray) -> str:
    """The median, and how many were missed."""
    lost = int(np.isnan(errors).sum())
    return ("-" if lost == EACH else f"{np.nanmedian(errors):.3f}") + (f" ({lost})" if lost else "")


def main() -> None:
    """Draw, look, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", nargs=2, metavar=("DETECTOR", "FOLDER"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.only:
        looked(asked.only[0], Path(asked.only[1]))
        return
    with TemporaryDirectory() as place:
        folder = Path(place)
        for name, array in zip(("images", "truth"), pictures(), strict=True):
            np.save(folder / f"{name}.npy", array)
        for name in DETECTORS:
            subprocess.run([sys.executable, __file__, "--only", name, str(folder)], check=True)
        text = page(folder)
    print(text)
    if asked.out:
        asked.out.write_text(text)


if __name__ == "__main__":
    main()
