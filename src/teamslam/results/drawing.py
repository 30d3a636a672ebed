"""Figures and the page drawn by a second process while this one writes: neither needs the other.

The second process is a fork of this one, so that the record need not travel. Where there are no safe forks, and should
the fork come to nothing (killed, out of memory), figures are drawn here when they are asked for.
"""

import gc
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from teamslam.config import Config
from teamslam.io.files.whole import whole_file
from teamslam.results.figures import figures_of, png_of, save
from teamslam.results.page import PAGE, page_bytes, write_page
from teamslam.results.record import Record
from teamslam.results.whole import made_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORKS = sys.platform == "linux"  # elsewhere libraries that a fork inherits may have threads that it lacks


def draw_record(record: Record, folder: Path, *, type: str = "png", dpi: float | None = None) -> list[Path]:
    """The figures of a run, into its folder of figures or another; returns the files."""
    return draw_figures(figures_of(record), folder, type=type, dpi=dpi)


def draw_figures(
    figures: "Mapping[str, Figure]", folder: Path, *, type: str = "png", dpi: float | None = None
) -> list[Path]:
    """Figures by name, into a folder; returns the files."""
    files, folder = [], made_folder(folder)
    for name, figure in figures.items():
        files.append(folder / f"{name}.{type}")
        save(figure, files[-1], dpi=dpi)
    return files


def draw_all(record: Record, config: Config, folder: Path) -> list[Path]:
    """The figures and the page of a run, into its folder; returns the files."""
    files = draw_record(record, folder / "figures")
    write_page(record, config, folder / PAGE)
    return [*files, folder / PAGE]


@contextmanager
def drawing(record: Record, config: Config) -> Iterator[Callable[[Path], list[Path]]]:
    """Draws the page and the figures of a run beside what is done meanwhile. It gives a function that puts them into
    the run's folder, once they are drawn, and returns the files, as `draw_all` does; what goes wrong with them is
    raised by that function.
    """
    if not FORKS:
        yield lambda folder: draw_all(record, config, folder)
        return
    from multiprocessing import get_context

    answer, theirs = get_context("fork").Pipe(duplex=False)
    child = get_context("fork").Process(target=_draw, args=(record.with_covariances(), config, theirs), daemon=True)
    child.start()
    theirs.close()

    def into(folder: Path) -> list[Path]:
        try:
            drawn = answer.recv()
        except EOFError:
            return draw_all(record, config, folder)
        if isinstance(drawn, Exception):
            raise drawn
        return _written(drawn, folder)

    try:
        yield into
    finally:
        answer.close()
        child.kill()
        child.join()


def _draw(record: Record, config: Config, answer: Connection) -> None:
    """What the second process does. It says nothing itself, and an interruption is its parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # what it inherits is not its to look through, and it ends when it is done
    try:
        figures = {f"figures/{name}.png": png_of(figure) for name, figure in figures_of(record).items()}
        answer.send(figures | {PAGE: page_bytes(record, config)})
    except BrokenPipeError:
        return
    except Exception as error:
        try:
            answer.send(error)
        except Exception:
            answer.send(RuntimeError(f"{type(error).__name__}: {error}"))


def _written(drawn: dict[str, bytes], folder: Path) -> list[Path]:
    made_folder(folder / "figures")
    for name, content in drawn.items():
        with whole_file(folder / name) as file:
            file.write(content)
    return [folder / name for name in drawn]
