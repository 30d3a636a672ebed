"""`teamslam paper`: the paper's simulation again, its Tables 1 and 2 and its Figures 2, 3 and 4."""

from pathlib import Path

from teamslam.cli.numbers import Whole, Wholes


def paper(
    *,
    runs: Whole = 50,
    poses: Wholes = (4, 12),
    seed: Whole = 0,
    out: Path = Path("paper"),
) -> int:
    """Run the paper's simulation many times; print Tables 1 and 2 beside its figures, and draw Figures 2, 3 and 4.

    Median and quartiles of the RMSE over all runs, by full least squares and by submap joining, the Cramer-Rao bound,
    and what the paper printed, with the reasons why its absolute figures cannot be compared.

    ```
    teamslam paper
    teamslam paper --runs 5 --poses 4 --out quick
    ```

    Exit codes: 0 done; 1 some run gave no joined, converged map; 2 bad input or usage.

    Parameters
    ----------
    runs
        How often each cell of the tables is run.
    poses
        Poses of each robot; the paper does not say how many. Repeat it for several.
    seed
        Of the first run; each further run adds one.
    out
        The folder to write: figures, tables.txt and tables.json. An earlier one is replaced file by file.
    """
    import json

    from teamslam.cli.console import answer, progress_bar, say
    from teamslam.io.files.text import write_text
    from teamslam.paper.figures import figures_of_paper
    from teamslam.paper.reproduction import reproduce
    from teamslam.results import made_folder
    from teamslam.results.figures import save

    fresh = not out.exists()
    made_folder(out)  # before all the work: what cannot be written is known now
    try:
        with progress_bar() as progress:
            found = reproduce(runs, poses, seed, progress)
    except BaseException:
        if fresh:
            out.rmdir()
        raise
    write_text(out / "tables.txt", f"{found}\n")
    write_text(out / "tables.json", json.dumps(found.to_dict(), indent=2) + "\n")
    figures = figures_of_paper(found)
    for name, figure in figures.items():
        save(figure, out / f"{name}.png")
    say(str(found))
    say(f"\nwritten: {out}: {', '.join(f'{name}.png' for name in figures)}, tables.txt, tables.json")
    answer({**found.to_dict(), "written": str(out)})
    return 1 if found.missing or any(cell.failed for cell in found.cells) else 0
