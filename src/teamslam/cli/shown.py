"""A calibration board filmed in the virtual lab: what `teamslam film --preset board` writes."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from teamslam.geometry import AnyArray

PRESETS = {"board": "tour", "board-one-angle": "one-angle"}
SECONDS, IMAGES_HZ = 60.0, 2.0


def film_board(out: Path, preset: str, seed: int, seconds: float | None, images_hz: float | None) -> int:
    """A video of a ChArUco board, the board as TOML, and the camera that filmed it as `truth.yaml`. All lines
    are exposed at once: with a rolling shutter a board that moves bends in the image, and a calibration with it."""
    from shlex import quote

    from teamslam.cli.console import answer, progress_bar, say
    from teamslam.frontend.boards import Charuco
    from teamslam.io.bags.board_file import write_board
    from teamslam.io.bags.calibration_written import write_camera
    from teamslam.io.bags.videos import write_video
    from teamslam.results import made_folder
    from teamslam.sim.film import PRESETS as CAMERAS
    from teamslam.sim.film.shown import Shown
    from teamslam.sim.film.shutter import Shutter

    options = replace(
        CAMERAS["experiment"], seconds=SECONDS if seconds is None else seconds,
        images_hz=IMAGES_HZ if images_hz is None else images_hz, shutter=Shutter(line_s=0.0),
    )  # fmt: skip
    shown = Shown(Charuco(8, 6, 0.04, 0.03), options, PRESETS[preset], seed=seed)
    count = len(shown.stamps_s)
    made_folder(out)
    with progress_bar() as progress:

        def images() -> "Iterator[AnyArray]":
            for k, image in enumerate(shown.images(), 1):
                progress("filming the board", k, count)
                yield image

        write_video(out / "board.avi", images(), options.images_hz)
    write_board(shown.board, out / "board.toml")
    write_camera(options.camera, out / "truth.yaml")
    where = quote(str(out))
    say(f"filmed: {count} images of a {shown.board}")
    say(f"written: {out}")
    say(f"next: teamslam calibrate {where}/board.avi --board {where}/board.toml --out {where}/camera.yaml")
    answer({"written": str(out), "images": count})
    return 0
