"""Figures drawn by a second process while this one writes: neither needs the other.

The second process is a fork of this one, so that the record need not travel. Where there are no safe forks, and should
the fork come to nothing (killed, out of memory), figures are drawn here when they are asked for.
"""

import gc
import io
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from teamslam.io.files.whole import whole_file
from teamslam.results.figures import figures_of, save
from teamslam.results.record import Record
from teamslam.results.whole import made_folder
from teamslam.viz import saved

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORKS = sys.platform == "linux"  # elsewhere libraries that a fork inherits may have threads that it lacks


def draw_record(record: Record, folder: Path, *, type: str = "png", dpi: float | None = None) -> list[Path]:
    """The figures of a run, into its folder of figures or another; returns the files."""
    files, folder = [], made_folder(folder)
    for name, figure in figures_of(record).items():
        files.append(folder / f"{name}.{type}")
        save(figure, files[-1], dpi=dpi)
    return files


@contextmanager
def drawing(record: Record) -> Iterator[Callable[[Path], list[Path]]]:
    """Draws the figures of a run beside what is done meanwhile. It gives a function that puts them into a folder, once
    they are drawn, and returns the files, as `draw_record` does; what goes wrong with them is raised by that function.
    """
    if not FORKS:
        yield lambda folder: draw_record(record, folder)
        return
    from multiprocessing import get_context

    answer, theirs = get_context("fork").Pipe(duplex=False)
    child = get_context("fork").Process(target=_draw, args=(record.with_covariances(), theirs), daemon=True)
    child.start()
    theirs.close()

    def into(folder: Path) -> list[Path]:
        try:
            drawn = answer.recv()
        except EOFError:
            return draw_record(record, folder)
        if isinstance(drawn, Exception):
            raise drawn
        return _written(drawn, folder)

    try:
        yield into
    finally:
        answer.close()
        child.kill()
        child.join()


def _draw(record: Record, answer: Connection) -> None:
    """What the second process does. It says nothing itself, and an interruption is its parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()  # what it inherits is not its to look through
    try:
        answer.send({name: _png(figure) for name, figure in figures_of(record).items()})
    except BrokenPipeError:
        return
    except Exception as error:
        try:
            answer.send(error)
        except Exception:
            answer.send(RuntimeError(f"{type(error).__name__}: {error}"))


def _png(figure: "Figure") -> bytes:
    file = io.BytesIO()
    saved(figure, file)
    return file.getvalue()


def _written(drawn: dict[str, bytes], folder: Path) -> list[Path]:
    files, folder = [], made_folder(folder)
    for name, image in drawn.items():
        files.append(folder / f"{name}.png")
        with whole_file(files[-1]) as file:
            file.write(image)
    return files
