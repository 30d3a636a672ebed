"""`teamslam run`: a log in, a map with its errors and figures out."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import MaybeWhole


def run(
    *inputs: Path,
    out: Path,
    method: str | None = None,
    exact: Annotated[bool, Parameter(negative="")] = False,
    gap: float | None = None,
    loss: str | None = None,
    loss_scale: float | None = None,
    calibrate: bool | None = None,
    reject: Annotated[bool, Parameter(negative="")] = False,
    wrong: float | None = None,
    repair: Annotated[bool, Parameter(negative="")] = False,
    config: Path | None = None,
    format: str | None = None,
    workers: MaybeWhole = None,
    cluster: str | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    figures: bool = True,
) -> int:
    """Map a team's log, and write a folder with the map, its covariances, errors and figures.

    The robots' start poses need not be known. Where the log holds truth, the result is scored against it.

    ```
    teamslam run MRCLAM_Dataset6 --out joined
    teamslam run MRCLAM_Dataset6 --out exact --exact
    teamslam run MRCLAM_Dataset6 --out near --exact --gap 1e-6
    teamslam run MRCLAM_Dataset6 --out full --method full
    teamslam run my-team --out my-map --loss huber --loss-scale 2
    teamslam run my-team --out as-stated --no-calibrate
    teamslam run my-team --out my-map --reject --repair
    teamslam run my-team --out again --config my-map/config.toml
    teamslam run many-robots --out large --workers 8
    teamslam run one.bag two.bag --config team.toml --out map
    ```

    Exit codes: 0 done; 1 not converged, in several parts, or something left out; 2 bad input or usage; 3 the
    measurements contradict the map; 4 no map at all.

    Parameters
    ----------
    inputs
        A log: a folder or file in any format that `teamslam convert --help` lists. Or recordings, where --config names
        a team file: they stand for those in it, in their order.
    out
        The folder to write. It appears when everything in it is written, never half.
    method
        join: submaps, then their join (the default). full: one least squares problem over all measurements.
    exact
        Join in rounds until the map is that of the full least squares, and report how far from it.
    gap
        With --exact: how much of the cost may still be to be gained. Without it 1e-20, which rounding seldom allows:
        rounds then go on until nothing more is to be seen.
    loss
        Loss of all sightings: squared, huber, cauchy or geman_mcclure. Without it, as the reader sets it.
    loss_scale
        Scale of the loss, in sigmas.
    calibrate
        Where the data show that their noise is not as stated (systematic errors, wrong standard deviations, errors that
        hang together in time), put it right and map once more (the default). --no-calibrate takes the noise as stated.
    reject
        Find the sightings that are wrong and leave them out; report.json lists them.
    wrong
        With --reject: the probability that a sighting is wrong. Without it, as the data have it.
    repair
        Put right names of landmarks that lie (exchanged, or one that was moved), and leave out robots that contradict
        the others. Without it they are only named.
    config
        Options in TOML; those on the command line win. Or a team file, of which [options] holds them.
    format
        The format of the input, where it cannot be told from its looks.
    workers
        Build and join the submaps in so many processes, by a tree, with the noise as it is stated. What they make lies
        beside the output, in OUT.parts, until all is done: run the same command again after an interruption, and it
        goes on from there.
    cluster
        Do so on the workers of the dask scheduler at this address (tcp://host:8786) instead; they need to see the
        output folder under the same path. Needs `pip install teamslam[cluster]`.
    force
        Replace an earlier run in the output folder.
    figures
        Draw figures, and the page report.html.
    """
    from contextlib import ExitStack

    from teamslam.cli.codes import DONE, PARTLY, code_of
    from teamslam.cli.console import answer, detail, pairs, progress_bar, say, table
    from teamslam.cli.figures import coming, drawn
    from teamslam.cli.options import asked_of, config_for
    from teamslam.cli.parts import parts_beside, workers_for
    from teamslam.cli.recorded import recorded_besides
    from teamslam.io import read_log
    from teamslam.pipeline import refuse_workers
    from teamslam.pipeline import run as run_pipeline
    from teamslam.results import Record, drawing, refuse_to_overwrite, write_record
    from teamslam.results.estimated import estimated_table, many
    from teamslam.results.folder import OURS
    from teamslam.results.words import outcome
    from teamslam.viz.style import METHOD_NAMES

    input, base = asked_of(inputs, config)
    refuse_to_overwrite(out, replace=force, ours=OURS, inputs=[input, *inputs])
    options = config_for(
        base,
        method=method,
        exact=exact,
        gap=gap,
        loss=loss,
        loss_scale=loss_scale,
        calibrate=calibrate,
        reject=reject,
        wrong=wrong,
        repair=repair,
    )
    crew = workers_for(workers, cluster)
    if crew is not None:
        refuse_workers(options, calibrate=bool(calibrate))
    with progress_bar() as progress, ExitStack() as meanwhile:
        progress("reading", 0, 0)
        dataset = read_log(input, options.read, format=format, progress=progress)
        progress("reading", 1, 1)
        detail(f"read: {dataset!r}")
        with parts_beside(out, crew) as parts:
            with coming(figures, processes=crew is not None):
                result = run_pipeline(dataset, options, progress, workers=crew, work=parts)
            progress("writing", 0, 0)
            record = Record.of(result)
            drawings = meanwhile.enter_context(drawing(record, options)) if figures else None
            refuse_to_overwrite(out, replace=force, ours=OURS)
            write_record(record, options, out)
            progress("writing", 1, 1)
            left_out = recorded_besides(input, result, record, out, progress, figures=figures)
        pictured = drawings is None or drawn(drawings, out, progress)
    pairs(f"{input}: {METHOD_NAMES[options.method]}", outcome(record.report))
    if many(record.report):
        every = estimated_table(record.report)
        table(every.title, every.columns, every.rows, left=2)
    answer({**record.report, "written": str(out)})
    for what in left_out:
        say(f"left out: {what}")
    say(f"written: {out}" + (f"; look at {out / 'report.html'} first" if figures and pictured else ""))
    return max(code_of(record.report), DONE if pictured else PARTLY)
