"""`teamslam plot`: the figures of a run, drawn again."""

from pathlib import Path


def plot(run: Path, /, *, out: Path | None = None, type: str = "png", dpi: int = 160) -> int:
    """Draw the figures of a run: map with ellipses and truth, convergence, errors over time, consistency.

    ```
    teamslam plot first-map                          # into first-map/figures
    teamslam plot first-map --out paper --type pdf   # for print
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    run
        A folder that `teamslam run` wrote.
    out
        Where to draw; by default the run's own folder of figures.
    type
        png, pdf or svg.
    dpi
        Dots per inch of png files.
    """
    from teamslam.cli.console import say
    from teamslam.errors import InputError
    from teamslam.results import figures_of, read_run

    if type not in ("png", "pdf", "svg"):
        raise InputError(f"unknown type of figure '{type}'; choose png, pdf or svg")
    folder = out or run / "figures"
    drawn = figures_of(read_run(run))
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in drawn.items():
        figure.savefig(folder / f"{name}.{type}", dpi=dpi)
        say(f"written: {folder / name}.{type}")
    return 0
