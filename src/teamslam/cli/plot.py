"""`teamslam plot`: the figures of a run, drawn again; and several runs, compared."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teamslam.cli.numbers import MaybeWhole


def plot(
    *runs: Path, out: Path | None = None, type: str = "png", dpi: MaybeWhole = None, side: str | None = None
) -> int:
    """Draw the figures of a run, its maps coloured by error and by residual, and its page; or compare several runs.

    Of one run: map with ellipses and truth, maps coloured by the distance from the truth and by residuals, convergence,
    errors over time, consistency, residuals. Of several: a table of their errors, printed and as comparison.csv, and a
    figure with the share of poses below each error and the errors of each robot.

    ```
    teamslam plot first-map                          # into first-map/figures, and first-map/report.html
    teamslam plot first-map --out paper --type pdf   # for print
    teamslam plot first-map --side front             # in space, from a side; or --side 30,20
    teamslam plot joined full --out compared         # two runs of one log
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    runs
        Folders that `teamslam run` wrote.
    out
        Where to draw. Of one run, by default its own folder of figures, with the page report.html beside it.
    type
        png, pdf or svg.
    dpi
        Dots per inch of png files, 160 without it.
    side
        From where maps in space are seen: top, front, back, left, right, corner, or azimuth and elevation in degrees
        (30,20). A map of the plane is then drawn in space, too.
    """
    from teamslam.errors import InputError
    from teamslam.viz import side_of

    if not runs:
        raise InputError("name a run to draw, or several to compare: folders that `teamslam run` wrote")
    if type not in ("png", "pdf", "svg"):
        raise InputError(f"unknown type of figure '{type}'; choose png, pdf or svg")
    if dpi is not None and type != "png":
        raise InputError(f"--dpi is for png; a figure in {type} has no dots")
    if dpi is not None and not 20 <= dpi <= 1200:
        raise InputError(f"--dpi is a number from 20 to 1200, found {dpi}")
    look = {"type": type, "dpi": dpi}
    if len(runs) == 1:
        return _one(runs[0], out, look, None if side is None else side_of(side))
    if side is not None:
        raise InputError("--side is for the maps of one run; several runs are compared by their errors")
    if out is None:
        raise InputError("say where to put the comparison: --out DIR")
    return _several(runs, out, look)


def _one(run: Path, out: Path | None, look: dict[str, Any], side: Any) -> int:
    from teamslam.config import read_config
    from teamslam.results import draw_record, read_run, with_residuals
    from teamslam.results.coloured import coloured_maps
    from teamslam.results.drawing import draw_figures
    from teamslam.results.page import PAGE, write_page

    record = with_residuals(read_run(run), run)
    folder = out or run / "figures"
    pages = [run / PAGE] if out is None else []
    for page in pages:
        write_page(record, read_config(run / "config.toml"), page)
    figures = draw_record(record, folder, **look)
    return _said([*pages, *figures, *draw_figures(coloured_maps(record, side), folder, **look)], {})


def _several(runs: Sequence[Path], out: Path, look: dict[str, Any]) -> int:
    from teamslam.cli.console import table
    from teamslam.results import read_run
    from teamslam.results.compared import COLUMNS, compared, write_comparison
    from teamslam.results.drawing import draw_figures
    from teamslam.results.whole import made_folder
    from teamslam.viz import draw_comparison

    found = compared({str(run): read_run(run) for run in runs})
    table(f"{len(runs)} runs: {found.basis}", COLUMNS, found.rows)
    figure = draw_comparison(found.clouds, caption=found.basis)
    write_comparison(found, made_folder(out) / "comparison.csv")
    figures = draw_figures({"comparison": figure}, out, **look)
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in found.rows]
    return _said([out / "comparison.csv", *figures], {"basis": found.basis, "runs": rows})


def _said(files: Sequence[Path], document: dict[str, Any]) -> int:
    from teamslam.cli.console import answer, say

    for file in files:
        say(f"written: {file}")
    answer({**document, "written": [str(file) for file in files]})
    return 0
