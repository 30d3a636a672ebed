"""`teamslam join`: submap files in, one map out (Algorithm 2); bad submaps are refused and the rest is joined."""

from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from teamslam.joining import Joined
    from teamslam.model import Submap, Table, Values
    from teamslam.pipeline import Clock, Progress
    from teamslam.results.record import Record
    from teamslam.scale import Workers
    from teamslam.team import Admission


def join(
    *maps: Path,
    out: Path,
    truth: Path | None = None,
    pieces: Path | None = None,
    without: Annotated[list[str] | None, Parameter(negative="")] = None,
    workers: int | None = None,
    cluster: str | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    figures: bool = True,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Join submaps into one map, and write a folder as `teamslam run` does.

    Submaps that are damaged, contradict the others or would count a measurement twice are refused with the reason,
    and listed in report.json; the rest is joined. Of several versions of a submap the newest counts.

    ```
    teamslam join submaps --out map
    teamslam join robot-1 robot-2 other/3_robot_3.submap --out map
    teamslam join submaps --out map --truth MRCLAM_Dataset6
    teamslam join submaps --out map --pieces pieces
    teamslam join submaps --out map --without 3
    teamslam join submaps --out map --workers 8
    teamslam join VicPark_200_local_maps --out map
    ```

    Exit codes: 0 done; 1 some submaps were refused, not converged, or parts could not be joined; 2 bad input or
    usage.

    Parameters
    ----------
    maps
        Submap files, folders of them, or local maps of I-SLSJF (.mat) or Linear SLAM (text).
    out
        The folder to write. It appears when everything in it is written, never half.
    truth
        A log that holds the truth, to score the map against.
    pieces
        The pieces of log that the submaps were built of (`teamslam split`): a folder of them, or a file. With them the
        report says how far the map is from the full least squares on the same measurements.
    without
        A robot's name, whose submaps are all left out, or the id of one submap. May be given several times. The map is
        as if they had never been there.
    workers
        Join in so many processes, by a tree. What they make lies beside the output, in OUT.parts, until all is done:
        run the same command again after an interruption, and it goes on from there.
    cluster
        Do so on the workers of the dask scheduler at this address (tcp://host:8786) instead; they need to see the
        output folder under the same path. Needs `pip install teamslam[cluster]`.
    force
        Replace an earlier run in the output folder.
    figures
        Draw figures.
    quiet
        Print nothing but errors.
    """
    from teamslam.cli.console import complain, pairs, progress_bar, say
    from teamslam.cli.options import workers_for
    from teamslam.cli.words import outcome
    from teamslam.config import Config
    from teamslam.errors import InputError
    from teamslam.results.folder import refuse_to_overwrite, whole_folder, write_record
    from teamslam.team import admit
    from teamslam.wire.pieces import piece_files

    refuse_to_overwrite(out, replace=force)
    if not maps:
        raise InputError("name the submap files to join, or folders of them")
    if piece_files(maps):
        raise InputError(
            "these are pieces of a log, not built yet; make submaps of them: `teamslam build`", path=maps[0]
        )
    admitted = admit(maps, without=without or ())
    for refusal in admitted.refused:
        complain(f"refused: {refusal.name}: {refusal.reason}")
    if not admitted.good:
        raise InputError("none of these can be joined; see the reasons above")
    crew, parts = workers_for(workers, cluster), out.with_name(f"{out.name}.parts")
    origin = ", ".join(map(str, maps))
    with progress_bar(quiet) as progress:
        record = _joined(admitted, truth, pieces, crew, parts, origin, progress)
        progress("writing", 0, 0)
        with whole_folder(out) as draft:
            write_record(record, Config(), draft, figures=figures)
    if crew is not None:
        rmtree(parts)
    if not quiet:
        left = f", {len(admitted.left_out)} left out" if admitted.left_out else ""
        pairs(f"{len(admitted.good)} submaps joined, {len(admitted.refused)} refused{left}", outcome(record.report))
        say(f"written: {out}")
    whole = record.report["converged"] and record.report["components"] == 1 and not admitted.refused
    return 0 if whole else 1


def _joined(
    admitted: "Admission",
    truth: Path | None,
    pieces: Path | None,
    workers: "Workers | None",
    parts: Path,
    origin: str,
    progress: "Progress",
) -> "Record":
    """The run that joining these submaps is: what went in is what they hold."""
    from dataclasses import replace

    from teamslam.cli.console import complain
    from teamslam.cli.pieces import pieces_in
    from teamslam.cli.sources import truth_in
    from teamslam.config import Config
    from teamslam.joining import join as join_submaps
    from teamslam.joining import with_exactness
    from teamslam.metrics import score
    from teamslam.model import Dataset, robot_of
    from teamslam.pipeline import Clock, Result, pairs
    from teamslam.results.record import Record
    from teamslam.solver import Covariances

    clock = Clock(progress)
    if workers is None:
        clock.start("joining submaps")
        joined = join_submaps(admitted.good)
    else:
        joined = _on_workers(admitted.good, workers, parts, clock)
    if pieces is not None:
        clock.start("exactness")
        logs, damaged = pieces_in([pieces], None, None)
        for reason in damaged:
            complain(f"no exactness: {reason}")
        joined = with_exactness(joined, pairs(logs, admitted.good))
    clock.start("covariances")
    covariances = tuple(Covariances.of_map(component.map) for component in joined.components)
    poses = {int(key): kind for c in joined.components for key, kind in _pose_kinds(c.map.all_values)}
    robots = {int(robot_of(key)): 2 + kind for key, kind in poses.items()}
    raw = tuple(_of_robots(table, robots) for submap in admitted.good for table in submap.raw)
    known = None if truth is None else truth_in(truth)
    team = Dataset(robots, raw, joined.map.names, known, origin=origin)
    clock.start("score")
    report = None if known is None else score(joined.map, known, covariances=covariances[0])
    record = Record.of(Result(Config(), team, admitted.good, joined, covariances, report, clock.stop()))
    marks = {int(key) for c in joined.components for key in c.map.landmark_keys}
    held = {
        "poses": len(poses),
        "landmarks": len(marks),
        "refused": [{"name": r.name, "reason": r.reason} for r in admitted.refused],
        "left_out": list(admitted.left_out),
    }
    return replace(record, report={**record.report, **held})


def _of_robots(table: "Table", robots: "Mapping[int, int]") -> "Table":
    """The sightings of robots that are there; of others a submap may speak too."""
    import numpy as np

    from teamslam.model import robot_of

    return table.select(np.asarray(np.isin(robot_of(table.keys), [0, *robots]).all(1)))


def _on_workers(submaps: "Sequence[Submap]", workers: "Workers", parts: Path, clock: "Clock") -> "Joined":
    """The submaps joined by a tree whose files lie in `parts`, and from its estimate on at once."""
    from teamslam.io.submaps.arrays import write_submap
    from teamslam.scale import gather, join_in_tree

    files = [parts / "maps" / f"{number}.submap" for number in range(len(submaps))]
    for submap, file in zip(submaps, files, strict=True):
        write_submap(submap, file)
    tree = join_in_tree(files, parts, workers=workers, progress=clock.hear)
    clock.start("joining submaps")
    return gather(tree)


def _pose_kinds(values: "Values") -> "zip[tuple[int, int]]":
    from teamslam.model import is_pose

    poses = is_pose(values.layout.keys)
    return zip(values.layout.keys[poses].tolist(), values.layout.kinds[poses].tolist(), strict=True)
