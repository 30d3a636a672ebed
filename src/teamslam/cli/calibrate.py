"""`teamslam calibrate`: a camera by images of a board, and what they leave open."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from teamslam.frontend.boards import Board, Calibration, Views
    from teamslam.io.bags.pictures import Pictures
    from teamslam.pipeline import Progress

from teamslam.cli.numbers import Whole


def calibrate(
    images: Path,
    /,
    *more: Path,
    out: Path,
    board: Path | None = None,
    charuco: str | None = None,
    aprilgrid: str | None = None,
    square_m: float | None = None,
    marker_m: float | None = None,
    dictionary: str = "4X4_50",
    tag_m: float | None = None,
    spacing: float = 0.3,
    family: str = "tag36h11",
    model: str | None = None,
    topic: str | None = None,
    most: Whole = 120,
    name: str = "camera",
    figure: Path | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Calibrate a camera by a ChArUco board or an AprilGrid in a video, a folder of images, or a recording.

    The focal length is told with three spreads: its sigma by the noise of corners, that between halves of the views,
    and that between lenses (and a board that is a little stretched or bent) which fit as well. Where these are large,
    the views do not determine it, and it is said so: no sigma of least squares shows that. Needs `pip install
    teamslam[tags]`.

    ```
    teamslam calibrate board.mp4 --charuco 8x6 --square-m 0.04 --marker-m 0.03 --out camera.yaml
    teamslam calibrate images/ --aprilgrid 6x6 --tag-m 0.088 --spacing 0.3 --out camchain.yaml
    teamslam calibrate drive.bag --topic /camera/image_raw --board board.toml --out camera.json
    ```

    The name of the output says what is written: `camera.yaml` ROS (camera_info), `camchain*.yaml` Kalibr, `*.xml` and
    `*opencv*.yaml` OpenCV, `*.json` WPILib, `*photonvision*.json` PhotonVision. All of them do as `calibration` in a
    team file.

    Exit codes: 0 done; 1 written, and not determined by these views; 2 bad input or usage.

    Parameters
    ----------
    images
        A video, a folder of images, image files, or a recording of ROS.
    more
        More image files.
    out
        The file to write.
    board
        The board in TOML, or Kalibr's target in YAML, instead of the options below.
    charuco
        A ChArUco board: columns and rows of its squares, as 8x6.
    aprilgrid
        An AprilGrid: columns and rows of its tags, as 6x6.
    square_m
        Edge of a ChArUco square [m].
    marker_m
        Edge of the marker in it [m].
    dictionary
        Of its markers, as OpenCV calls it.
    tag_m
        Edge of a tag of the grid [m].
    spacing
        Gap between two tags of the grid, in edges.
    family
        Of the grid's tags.
    model
        radtan4, radtan5, radtan8 or equidistant; without it the simplest that fits as well as the best.
    topic
        The images of a recording, where it has several.
    most
        Images that are looked at, evenly taken.
    name
        What the camera is called in the file.
    figure
        Where to draw what is left of the corners; without it beside the output, as .png.
    force
        Replace the output.
    """
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, pairs, progress_bar, say, table
    from teamslam.errors import InputError
    from teamslam.frontend.boards import calibrate as solved
    from teamslam.io.bags.calibration_written import lenses_of, write_camera
    from teamslam.io.bags.sources import images_from
    from teamslam.io.files.whole import whole_file
    from teamslam.results.words import counted
    from teamslam.viz import saved
    from teamslam.viz.reprojection import draw_reprojection

    picture = figure or out.with_suffix(".png")
    for path in (out, picture):
        if path.exists() and not force:
            raise InputError("there is something already; choose another name, or use --force", path=path)
    lenses = lenses_of(out, model)
    known = _board(board, charuco, aprilgrid, square_m, marker_m, dictionary, tag_m, spacing, family)
    with progress_bar() as progress:
        with images_from([images, *more], topic) as pictures:
            views, looked, lost = _seen(pictures, known, most, progress)
        progress("calibrating", 0, 0)
        found = solved(views, known, lenses)
        progress("calibrating", 1, 1)
    camera, best = found.chosen.fit.camera, found.chosen.fit
    written = write_camera(camera, out, name)
    drawn = draw_reprojection(
        best.views.pixels, best.residuals, views.size, _lenses(found), title=f"Calibration of {name}",
        caption=f"{counted(len(best.views), 'view', len(best.views.view), 'corner')}, {best.rms:.3f} px RMS",
    )  # fmt: skip
    with whole_file(picture) as file:
        saved(drawn, file)
    pairs(str(images), _told(found, looked, lost))
    rows = [
        [c.name, f"{c.fit.focal:.2f}", f"{c.fit.formal_sigma:.3f}", f"{c.fit.sigma_by_views:.3f}",
         *(f"{half.focal:.2f}" for half in c.halves), f"{_rms(c.unseen):.4f}", "yes" if c in found.alike else "no"]
        for c in (found.chosen, *(c for c in found.candidates if c is not found.chosen))
    ]  # fmt: skip
    table(
        "Focal lengths [pixels]",
        ["lens", "all views", "formal sigma", "by views", "one half", "the other", "unseen RMS [px]", "fits alike"],
        rows,
    )
    for sentence in verdict(found):
        say(sentence)
    say(f"written: {out} ({written}), {picture}")
    answer(_document(found, out, looked, lost))
    return DONE if found.is_determined else PARTLY


def verdict(found: "Calibration") -> list[str]:
    """What these views say of the focal length, and what would help, in sentences."""
    from numpy import degrees, percentile

    best = found.chosen
    low, high = found.between_models
    f, noise = best.fit.focal, max(best.fit.formal_sigma, best.fit.sigma_by_views)
    spread = (
        f"lenses that fit alike have {low:.1f} to {high:.1f} pixels ({100 * (high - low) / f:.2g} %), halves of the "
        f"views {best.halves[0].focal:.1f} and {best.halves[1].focal:.1f} ({100 * best.between_halves / f:.2g} %)"
    )
    if found.is_determined:
        return [f"The focal length is {f:.2f} +- {found.sigma:.2f} pixels: {spread}."]
    worst = max(high - low, best.between_halves, noise)
    times = worst / max(best.fit.formal_sigma, 1e-12)
    angles, distances = degrees(percentile(found.tilts, (5, 95))), percentile(found.distances, (5, 95))
    said = [
        f"! The focal length is not determined by these views: {spread}. Its formal sigma, {best.fit.formal_sigma:.2g} "
        f"pixels, is {times:.0f} times too small; believe {f:.0f} +- {found.sigma:.0f}."
        if times > 1.5
        else f"! The focal length is not determined by these views: its sigma is {noise:.2g} of {f:.0f} pixels; "
        f"{spread}."
    ]
    said.append(
        f"  The board is leaned by {angles[0]:.0f} to {angles[1]:.0f} degrees, {distances[0]:.2f} to "
        f"{distances[1]:.2f} m away. Lean it by 30 to 45 degrees to all four sides, come near and go away, and fill "
        f"the corners of the image."
    )
    return said


def _told(found: "Calibration", looked: int, lost: dict[str, int]) -> list[tuple[str, str]]:
    from numpy import degrees, sqrt

    fit = found.chosen.fit
    camera, sigmas = fit.camera, fit.sigmas

    def numbers(values: tuple[float, ...], first: int) -> str:
        return ", ".join(f"{x:.5g} +- {s:.2g}" for x, s in zip(values, sigmas[first:], strict=False))

    rows = [
        ("board", str(found.board)),
        ("images", f"{looked} looked at, {len(fit.views)} used; {len(fit.views.view):,} corners"),
        *(("dropped", f"{count}: {reason}") for reason, count in lost.items()),
        *([("dropped", f"{found.left_out}: corners that are none, by what the others say")] if found.left_out else []),
        ("lens", found.chosen.name),
        ("focal lengths", numbers(camera.focal, 0)),
        ("centre", numbers(camera.centre, 2)),
        ("distortion", numbers(camera.distortion, 4)),
        ("left of a corner", f"{fit.rms:.3f} px RMS; {sqrt(found.chosen.unseen.mean()):.3f} px in views not fitted to"),
        ("leaned", f"{degrees(found.tilts.min()):.0f} to {degrees(found.tilts.max()):.0f} degrees"),
        ("distance", f"{found.distances.min():.2f} to {found.distances.max():.2f} m"),
        ("image covered", f"{100 * found.covered:.0f} %"),
    ]
    if found.chosen.loose:
        rows.append(
            ("board", f"not as stated: {100 * fit.stretch:+.3f} % longer upwards, bent by {_bent(found):.2g} mm")
        )
    return rows


def _bent(found: "Calibration") -> float:
    from numpy import ptp

    x, y = found.board.points[:, 0], found.board.points[:, 1]
    a, b, c = found.chosen.fit.bend
    return float(1e3 * ptp(a * x * x + b * x * y + c * y * y))


def _seen(pictures: "Pictures", board: "Board", most: int, progress: "Progress") -> "tuple[Views, int, dict[str, int]]":
    """The board in at most so many of the images, how many were looked at, and how many could not be used, by reason.
    InputError where it is in none."""
    from collections import Counter

    from teamslam.errors import InputError
    from teamslam.frontend.boards import Finder, Views
    from teamslam.io.bags.pictures import Unusable

    find, every = Finder(board), max(1, -(-pictures.count // max(most, 1)))
    found, frames, sizes = [], [], []
    lost: Counter[str] = Counter()
    looked = 0
    for number, picture in enumerate(pictures.each()):
        if number % every:
            continue
        looked += 1
        progress("looking for the board", looked, -(-pictures.count // every))
        try:
            image = picture.grey()
        except Unusable as error:
            lost[f"images {error}"] += 1
            continue
        seen = find(image)
        if seen is None:
            lost["images without the board, or with fewer than 8 of its corners"] += 1
            continue
        found.append(seen)
        frames.append(number)
        sizes.append((image.shape[1], image.shape[0]))
    if not looked:
        raise InputError("no image in it that can be read")
    if not found:
        raise InputError(
            f"the {board} was seen in none of {looked} images; are its kind, dictionary and size as stated?"
        )
    usual = max(set(sizes), key=sizes.count)
    kept = [k for k, size in enumerate(sizes) if size == usual]
    if len(kept) < len(sizes):
        lost[f"images of another size than {usual[0]} x {usual[1]}, as most are"] = len(sizes) - len(kept)
    return Views.of(usual, [frames[k] for k in kept], [found[k] for k in kept]), looked, dict(lost)


def _board(
    file: Path | None, charuco: str | None, aprilgrid: str | None, square_m: float | None, marker_m: float | None,
    dictionary: str, tag_m: float | None, spacing: float, family: str,
) -> "Board":  # fmt: skip
    from teamslam.errors import InputError
    from teamslam.frontend.boards import AprilGrid, Charuco
    from teamslam.io.bags.board_file import read_board

    if sum(given is not None for given in (file, charuco, aprilgrid)) != 1:
        raise InputError("say which board: one of --board FILE, --charuco 8x6 or --aprilgrid 6x6")
    if file is not None:
        return read_board(file)
    columns, rows = _counts(charuco or aprilgrid or "")
    if charuco is not None:
        if square_m is None or marker_m is None:
            raise InputError("a ChArUco board needs --square-m and --marker-m")
        return Charuco(columns, rows, square_m, marker_m, dictionary)
    if tag_m is None:
        raise InputError("an AprilGrid needs --tag-m")
    return AprilGrid(columns, rows, tag_m, spacing, family)


def _counts(text: str) -> tuple[int, int]:
    from re import fullmatch

    from teamslam.errors import InputError

    found = fullmatch(r"\s*(\d{1,4})\s*[xX]\s*(\d{1,4})\s*", text)
    if found is None:
        raise InputError(f"columns and rows are written as 8x6, found '{text}'")
    return int(found[1]), int(found[2])


def _lenses(found: "Calibration"):  # type: ignore[no-untyped-def]
    from teamslam.viz.reprojection import FocalLengths

    order = (found.chosen, *(c for c in found.candidates if c is not found.chosen))
    return [
        FocalLengths(c.name, c.fit.focal, max(c.fit.formal_sigma, c.fit.sigma_by_views),
                     (c.halves[0].focal, c.halves[1].focal), c in found.alike)
        for c in order
    ]  # fmt: skip


def _rms(squares) -> float:  # type: ignore[no-untyped-def]
    return float(squares.mean() ** 0.5)


def _document(found: "Calibration", out: Path, looked: int, lost: dict[str, int]) -> dict[str, object]:
    fit, camera = found.chosen.fit, found.chosen.fit.camera
    low, high = found.between_models
    return {
        "written": str(out),
        "images": looked,
        "dropped": [{"count": count, "reason": reason} for reason, count in lost.items()],
        "views": len(fit.views),
        "corners": len(fit.views.view),
        "lens": found.chosen.name,
        "focal": list(camera.focal),
        "centre": list(camera.centre),
        "distortion": list(camera.distortion),
        "rms_px": fit.rms,
        "unseen_rms_px": _rms(found.chosen.unseen),
        "focal_sigma": {
            "stated": found.sigma,
            "formal": fit.formal_sigma,
            "by_views": fit.sigma_by_views,
            "between_halves": found.chosen.between_halves,
            "between_models": high - low,
        },
        "determined": found.is_determined,
    }
