"""What commands print: results on stdout, progress and complaints on stderr, so that pipes stay clean."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from teamslam.pipeline import Progress


def stdout() -> "Console":
    """The console of results; as wide as it needs where nobody watches, so that piped tables are not cut."""
    from rich.console import Console

    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=max(console.width, 160), soft_wrap=True)


def stderr() -> "Console":
    """The console of progress and complaints."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def say(text: str) -> None:
    """One line of result."""
    stdout().print(text, markup=False)


def complain(text: str) -> None:
    """One clear message on stderr."""
    console = stderr()
    console.print("teamslam:", style="bold red", end=" ")
    console.print(text, markup=False, soft_wrap=True)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table of results; the first column is text, the others are numbers."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    grid = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for place, column in enumerate(columns):
        grid.add_column(Text(column), justify="left" if place == 0 else "right")
    for row in rows:
        grid.add_row(*map(Text, row))
    stdout().print(grid)


def pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """A list of names and what they are."""
    from rich.table import Table
    from rich.text import Text

    console, grid = stdout(), Table.grid(padding=(0, 2))
    console.print(title, style="bold", markup=False)
    for name, value in rows:
        grid.add_row(Text(f"  {name}", style="dim"), Text(value))
    console.print(grid)


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator["Progress"]:
    """A progress bar on stderr as the callback that `pipeline.run` takes; nothing is drawn where nobody watches."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = stderr()
    columns = (
        SpinnerColumn(), TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        tasks: dict[str, int] = {}

        def tell(stage: str, done: int, of: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=of or None)
            bar.update(bar.task_ids[list(tasks).index(stage)], completed=done, total=of or None)

        yield tell
