"""Figures and the page come last: by then the map is written, and nothing that happens to them can lose it."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.pipeline import Progress


def coming(figures: bool, processes: bool) -> AbstractContextManager[object]:
    """While the block solves, another thread makes ready what figures are drawn with; not where others begin
    `processes` meanwhile, which would be born with an import half done."""
    from teamslam.solver import meanwhile
    from teamslam.viz.style import ready

    return meanwhile(ready) if figures and not processes else nullcontext()


def drawn(figures: Callable[[Path], object], folder: Path, progress: "Progress") -> bool:
    """Put the page and the figures of a run (see `drawing`) into the `folder` it is written in; False, and a
    complaint, where that fails."""
    from teamslam.cli.console import complain

    later = f"the map is whole in {folder}; `teamslam plot {folder}` draws its page and its figures"
    progress("drawing", 0, 0)
    try:
        figures(folder)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted while drawing; {later}") from None
    except Exception as error:
        complain(f"the page and the figures could not be drawn ({_said(error)}); {later}")
        return False
    progress("drawing", 1, 1)
    return True


def _said(error: Exception) -> str:
    """What an error says of itself, in one line."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return f"{type(error).__name__}: {error}"
