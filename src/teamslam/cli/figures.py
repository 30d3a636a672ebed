"""Figures come last: by then the map is written, and nothing that happens to them can lose it."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.pipeline import Progress
    from teamslam.results import Record


def drawn(record: "Record", folder: Path, progress: "Progress") -> bool:
    """Draw the figures of a run that is written in `folder`; False, and a complaint, where that fails."""
    from teamslam.cli.console import complain
    from teamslam.results import draw_record

    later = f"the map is whole in {folder}; `teamslam plot {folder}` draws its figures"
    progress("drawing", 0, 0)
    try:
        draw_record(record, folder / "figures")
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted while drawing; {later}") from None
    except Exception as error:
        complain(f"the figures could not be drawn ({_said(error)}); {later}")
        return False
    progress("drawing", 1, 1)
    return True


def _said(error: Exception) -> str:
    """What an error says of itself, in one line."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return f"{type(error).__name__}: {error}"
