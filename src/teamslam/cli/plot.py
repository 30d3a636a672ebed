"""`teamslam plot`: the figures of a run, drawn again."""

from pathlib import Path

from teamslam.cli.numbers import MaybeWhole


def plot(run: Path, /, *, out: Path | None = None, type: str = "png", dpi: MaybeWhole = None) -> int:
    """Draw the figures and the page of a run: map with ellipses and truth, convergence, errors, consistency, residuals.

    ```
    teamslam plot first-map                          # into first-map/figures, and first-map/report.html
    teamslam plot first-map --out paper --type pdf   # for print
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    run
        A folder that `teamslam run` wrote.
    out
        Where to draw; by default the run's own folder of figures, with the page report.html beside it.
    type
        png, pdf or svg.
    dpi
        Dots per inch of png files, 160 without it.
    """
    from teamslam.cli.console import answer, say
    from teamslam.config import read_config
    from teamslam.errors import InputError
    from teamslam.results import draw_record, read_run, with_residuals
    from teamslam.results.page import PAGE, write_page

    if type not in ("png", "pdf", "svg"):
        raise InputError(f"unknown type of figure '{type}'; choose png, pdf or svg")
    if dpi is not None and type != "png":
        raise InputError(f"--dpi is for png; a figure in {type} has no dots")
    if dpi is not None and not 20 <= dpi <= 1200:
        raise InputError(f"--dpi is a number from 20 to 1200, found {dpi}")
    record = with_residuals(read_run(run), run)
    written = []
    if out is None:
        write_page(record, read_config(run / "config.toml"), run / PAGE)
        written.append(run / PAGE)
        say(f"written: {run / PAGE}")
    for file in draw_record(record, out or run / "figures", type=type, dpi=dpi):
        written.append(file)
        say(f"written: {file}")
    answer({"written": [str(file) for file in written]})
    return 0
