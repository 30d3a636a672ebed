"""How figures look: colours that colour-blind readers can tell apart, quiet axes, one font.

Figures are made on matplotlib's `Figure` itself, not through pyplot: nothing is shown, nothing is kept open, and no
display is needed. The caller saves what a function returns.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any, BinaryIO, ParamSpec, TypeVar

import numpy as np

from teamslam.cards import ROBOT_COLOURS
from teamslam.errors import in_words
from teamslam.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")
T = TypeVar("T")

ROBOT_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "h")
LANDMARK_COLOUR = "#7A1F5C"
TRUTH_COLOUR = "#3A3A3A"
WEAK_COLOUR = "#B8860B"
QUIET = "#9A9A9A"
INK = "#333333"
METHOD_COLOURS = {"join": "#D55E00", "full": "#0072B2"}
METHOD_NAMES = {"join": "submap joining", "full": "full least squares"}

COLUMNS = 1000  # no figure has more dots side by side in one panel
NARROW = 500  # and none of several panels side by side
PACKED = 3  # of 9: from there on an image takes longer to write than to draw, and is hardly smaller

RC: Any = {
    "figure.dpi": 160,
    "savefig.dpi": 160,
    "font.family": ["DejaVu Sans"],  # each family named is looked for at each word
    "font.size": 9.0,
    "figure.titlesize": 11.0,
    "figure.titleweight": "bold",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else it is sought, above whatever may stand there
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.labelspacing": 0.55,
    "lines.linewidth": 1.2,
    "axes.formatter.limits": (-3, 5),
}


def robot_colour(order: int) -> str:
    """The colour of the robot at a place in the team's order; colours repeat after eight."""
    return ROBOT_COLOURS[order % len(ROBOT_COLOURS)]


def robot_marker(order: int) -> str:
    """The marker that goes with the colour, for readers without colours."""
    return ROBOT_MARKERS[order % len(ROBOT_MARKERS)]


def ready() -> None:
    """Import what figures are drawn with, and let it find its fonts: as much work as to draw a few of them. For a
    process whose figures are written, and which nobody asks what could be set of a line."""
    with _undescribed():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    figure = Figure()
    figure.add_subplot().plot([0, 1], label="any")
    figure.legend()
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]


@contextmanager
def _undescribed() -> Iterator[None]:
    """Classes that are made meanwhile list nowhere what may be set of them. matplotlib writes such a list for each of
    its own, out of the texts of all their methods, which is half of its import."""
    from matplotlib.artist import Artist

    described = vars(Artist).get("_update_set_signature_and_docstring")
    if described is None:  # this matplotlib has another way
        yield
        return
    setattr(Artist, described.__name__, lambda: None)
    try:
        yield
    finally:
        setattr(Artist, described.__name__, described)


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Draw with this style, and leave matplotlib's settings as they were."""

    @wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with style(), boxes():
            return function(*args, **kwargs)

    return inside


def style() -> AbstractContextManager[None]:
    """The style as a context."""
    import matplotlib

    return matplotlib.rc_context(RC)


@contextmanager
def boxes() -> Iterator[None]:
    """A letter that the font lacks is drawn as a box, without a word."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from", category=UserWarning)
        yield


def saved(figure: "Figure", file: BinaryIO, *, type: str = "png", dpi: float | None = None) -> None:
    """Write a figure into an open file: png, pdf or svg, with `dpi` dots per inch or as many as the style has."""
    dots = RC["savefig.dpi"] if dpi is None else dpi
    with style(), boxes():
        if type != "png":
            figure.savefig(file, format=type, dpi=dots)
            return
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from PIL import Image

        # savefig goes through all of the figure twice, and packs a fourth channel that is full everywhere.
        figure.set_dpi(dots)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]
        image.save(file, "png", dpi=(dots, dots), compress_level=PACKED)


def seen(x: Array, y: Array, columns: int = COLUMNS) -> tuple[Array, Array]:
    """Of a curve over rising `x` (n,) as many points as an eye can tell apart: of each of so many stretches of x the
    lowest and the highest, in their order; all where they are not many more."""
    if len(x) <= 4 * columns or not x[-1] > x[0]:
        return x, y
    column = np.minimum((x - x[0]) * (columns / (x[-1] - x[0])), columns - 1).astype(int)
    begins = np.flatnonzero(np.diff(column, prepend=-1))
    order = np.lexsort((np.nan_to_num(y, nan=-np.inf), column))
    ends = np.append(begins[1:], len(x)) - 1
    kept = np.unique(np.concatenate([order[begins], order[ends]]))
    return x[kept], y[kept]


def plain(text: str, most: int = 120) -> str:
    """Words as matplotlib writes them: a dollar is a dollar and no formula, what cannot be printed shows its code, and
    what is too long loses its middle. Line breaks stay."""
    shown = "\n".join(map(in_words, text.split("\n")))
    if len(shown) > most:
        shown = f"{shown[: most // 2]}...{shown[-(most // 2) :]}"
    return shown.replace("$", r"\$")


def name(text: str, most: int = 30) -> str:
    """What people call a robot or a landmark, in one line of a label."""
    return plain(in_words(text), most)
