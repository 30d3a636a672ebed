"""Figures and the page drawn by two other processes while this one writes: none needs the others.

They are forks of this one, so that the record need not travel. Where there are no safe forks, and should one come to
nothing (killed, out of memory), figures are drawn here when they are asked for.
"""

import gc
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from teamslam.config import Config
from teamslam.io.files.whole import whole_file
from teamslam.results.figures import PARTS, figures_of, png_of, save
from teamslam.results.page import PAGE, page_bytes, write_page
from teamslam.results.record import Record
from teamslam.results.whole import made_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARES = (0, 4), (1, 2, 3, 5)
"""What each process draws, as much work in both: places among PARTS, the page after them."""
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
    record = record.with_covariances()
    with ExitStack() as working:
        answers = [working.enter_context(_process(record, config, share)) for share in SHARES]

        def into(folder: Path) -> list[Path]:
            drawn: dict[int, dict[str, bytes]] = {}
            for answer in answers:
                try:
                    found = answer.recv()
                except EOFError:
                    return draw_all(record, config, folder)
                if isinstance(found, Exception):
                    raise found
                drawn |= found
            return _written({name: drawn[part][name] for part in sorted(drawn) for name in drawn[part]}, folder)

        yield into


@contextmanager
def _process(record: Record, config: Config, share: Sequence[int]) -> Iterator[Connection]:
    """What a process that draws a share of it all answers through; it is gone when the block ends."""
    from multiprocessing import get_context

    answer, theirs = get_context("fork").Pipe(duplex=False)
    child = get_context("fork").Process(target=_draw, args=(record, config, share, theirs), daemon=True)
    child.start()
    theirs.close()
    try:
        yield answer
    finally:
        answer.close()
        child.kill()
        child.join()


def _draw(record: Record, config: Config, share: Sequence[int], answer: Connection) -> None:
    """What such a process does. It says nothing itself, and an interruption is its parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # what it inherits is not its to look through, and it ends when it is done
    try:
        answer.send({part: _drawn(record, config, part) for part in share})
    except BrokenPipeError:
        return
    except Exception as error:
        try:
            answer.send(error)
        except Exception:
            answer.send(RuntimeError(f"{type(error).__name__}: {error}"))


def _drawn(record: Record, config: Config, part: int) -> dict[str, bytes]:
    """The files of one part, by their names in the run's folder."""
    if part == len(PARTS):
        return {PAGE: page_bytes(record, config)}
    return {f"figures/{name}.png": png_of(figure) for name, figure in PARTS[part](record).items()}


def _written(drawn: dict[str, bytes], folder: Path) -> list[Path]:
    made_folder(folder / "figures")
    for name, content in drawn.items():
        with whole_file(folder / name) as file:
            file.write(content)
    return [folder / name for name in drawn]
