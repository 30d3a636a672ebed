"""What commands print: results on stdout, progress and complaints on stderr, so that pipes stay clean."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from teamslam.cli.voice import voice
from teamslam.errors import in_words

if TYPE_CHECKING:
    from rich.console import Console

    from teamslam.pipeline import Progress


MANY = 50  # parts of a stage, of which it is worth saying how many come a second


def screen() -> "Console":
    """The console of help, as wide as the terminal, or 80 letters."""
    return _console()


def stdout() -> "Console":
    """The console of results; as wide as it needs where nobody watches, so that piped tables are not cut."""
    console = _console()
    return console if console.is_terminal else _console(width=10_000, soft_wrap=True)


def stderr() -> "Console":
    """The console of progress and complaints."""
    return _console(stderr=True)


def _console(**options: Any) -> "Console":
    """A console that prints words as they are: no markup, no emoji, no colours for numbers."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False, **options)
    console.on_broken_pipe = _raise  # type: ignore[method-assign]
    return console


def _raise() -> None:
    """Rich would end the process by itself where nobody reads any more; the command does that, with its own code."""
    raise


def printable(text: str) -> str:
    """Words for a terminal: what would move its cursor or colour it shows its code; line breaks stay."""
    return "\n".join(map(in_words, text.split("\n")))


def say(text: str) -> None:
    """One line of result, where results are wanted in words."""
    if in_prose():
        stdout().print(printable(text))


def answer(document: Any) -> None:
    """The results as data, where they are wanted so: one JSON document a command; what is not finite is null."""
    if voice().json:
        import json

        from teamslam.results.folder import known

        print(json.dumps(known(document), indent=2, allow_nan=False, default=str))


def detail(text: str) -> None:
    """One line about what is going on, on stderr, where that is wanted."""
    if voice().verbose:
        stderr().print(printable(text), style="dim", soft_wrap=True)


def in_prose() -> bool:
    """Whether results are printed in words and tables."""
    return not (voice().quiet or voice().json)


def complain(text: str) -> None:
    """One clear message on stderr. Where that is a file on a full disk nobody can be told, which ends nothing."""
    console = stderr()
    try:
        console.print("teamslam:", style="bold red", end=" ")
        console.print(printable(text), soft_wrap=True)
    except BrokenPipeError:
        raise
    except OSError:
        return


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> None:
    """A table of results; `left` columns are text, the others are numbers."""
    if not in_prose():
        return
    from rich import box
    from rich.table import Table
    from rich.text import Text

    grid = Table(
        title=Text(printable(title)), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False
    )
    for place, column in enumerate(columns):
        grid.add_column(Text(column), justify="left" if place < left else "right")
    for row in rows:
        grid.add_row(*(Text(in_words(cell)) for cell in row))
    stdout().print(grid)


def pairs(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """A list of names and what they are; what is long goes on under itself where somebody watches."""
    if not in_prose():
        return
    from textwrap import wrap

    from rich.text import Text

    console = stdout()
    console.print(printable(title), style="bold")
    column = max((len(name) for name, _ in rows), default=0) + 4
    room = max(console.width - column, 20) if console.is_terminal else 10_000
    for name, value in rows:
        first, *more = wrap(in_words(value), room) or [""]
        console.print(Text(f"  {name}".ljust(column), style="dim") + Text(first), soft_wrap=True)
        for line in more:
            console.print(" " * column + line, soft_wrap=True)


@contextmanager
def progress_bar() -> Iterator["Progress"]:
    """A progress bar on stderr as the callback that `pipeline.run` takes; nothing is drawn where nobody watches. A
    verbose command says each stage in a line instead, with the seconds that it took."""
    if voice().verbose:
        yield _stages()
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.text import Text

    class Speed(ProgressColumn):
        """How many parts a second, where there are many."""

        def render(self, task: Task) -> Text:
            many = task.total is not None and task.total >= MANY
            return Text(f"{task.speed:,.0f}/s" if many and task.speed else "")

    console = stderr()
    spinner = SpinnerColumn("dots" if console.encoding.startswith("utf") else "line")
    columns = (
        spinner, TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), Speed(),
        TimeElapsedColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not in_prose() or not console.is_terminal) as bar:
        tasks: dict[str, int] = {}

        def tell(stage: str, done: int, of: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=of or None)
            bar.update(bar.task_ids[list(tasks).index(stage)], completed=done, total=of or None)

        yield tell


def _stages() -> "Progress":
    """A line when a stage begins, and one when it is done."""
    from time import perf_counter

    began: dict[str, float] = {}

    def tell(stage: str, done: int, of: int) -> None:
        if stage not in began:
            began[stage] = perf_counter()
            detail(f"{stage} ...")
        elif of and done >= of and began[stage] > 0.0:
            took = perf_counter() - began[stage]
            parts = f", {of:,} parts, {of / max(took, 1e-9):,.0f} a second" if of > 1 else ""
            detail(f"{stage}: {took:.2f} s{parts}")
            began[stage] = 0.0

    return tell
