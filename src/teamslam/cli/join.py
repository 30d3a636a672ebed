"""`teamslam join`: submap files in, one map out (Algorithm 2); bad submaps are refused and the rest is joined."""

from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import MaybeWhole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from teamslam.cli.sources import Truth
    from teamslam.joining import Component, Cost, Joined
    from teamslam.model import Dataset, Submap, Table, Values
    from teamslam.pipeline import Clock, Progress
    from teamslam.results.record import Record
    from teamslam.scale import Workers
    from teamslam.team import Admission
    from teamslam.trust import Verdict

    Pairs = list[tuple[Dataset, Submap]]


def join(
    *maps: Path,
    out: Path,
    truth: Path | None = None,
    pieces: Path | None = None,
    without: Annotated[list[str] | None, Parameter(negative="")] = None,
    workers: MaybeWhole = None,
    cluster: str | None = None,
    force: Annotated[bool, Parameter(negative="")] = False,
    figures: bool = True,
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

    Exit codes: 0 done; 1 some submaps were refused, not converged, or in several parts; 2 bad input or usage; 3 the
    measurements contradict the map; 4 no map at all.

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
        report says what the map costs, and how far it is from the full least squares on the same measurements.
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
        Draw figures, and the page report.html.
    """
    from contextlib import ExitStack

    from teamslam.cli.codes import DONE, PARTLY, code_of
    from teamslam.cli.console import answer, complain, pairs, progress_bar, say
    from teamslam.cli.figures import coming, drawn
    from teamslam.cli.parts import parts_beside, workers_for
    from teamslam.cli.sources import truth_in
    from teamslam.config import Config
    from teamslam.errors import InputError
    from teamslam.results import drawing, refuse_to_overwrite, write_record
    from teamslam.results.folder import OURS
    from teamslam.results.words import counted, outcome
    from teamslam.team import admit
    from teamslam.wire.pieces import piece_files

    refuse_to_overwrite(out, replace=force, ours=OURS, inputs=[*maps, *(p for p in (truth, pieces) if p)])
    if not maps:
        raise InputError("name the submap files to join, or folders of them")
    if found := piece_files(maps):
        raise InputError("this is a piece of a log, not built yet; make submaps first: `teamslam build`", path=found[0])
    admitted = admit(maps, without=without or ())
    for refusal in admitted.refused:
        complain(f"refused: {refusal.name}: {refusal.reason}")
    if not admitted.good:
        raise InputError("none of these can be joined; see the reasons above")
    known = truth_in(truth) if truth is not None else None
    if known is not None and len(known.parts) > 1:
        raise InputError(f"this run holds {len(known.parts)} maps in frames of their own; give one truth", path=truth)
    beside = _pieces_of(admitted.good, pieces)
    crew = workers_for(workers, cluster)
    with progress_bar() as progress, ExitStack() as meanwhile:
        with parts_beside(out, crew) as parts:
            with coming(figures, processes=crew is not None):
                record = _joined(admitted, known, beside, crew, parts, maps, progress)
            progress("writing", 0, 0)
            drawings = meanwhile.enter_context(drawing(record, Config())) if figures else None
            write_record(record, Config(), out)
            progress("writing", 1, 1)
        pictured = drawings is None or drawn(drawings, out, progress)
    left = f", {len(admitted.left_out)} left out by --without" if admitted.left_out else ""
    title = f"{counted(len(admitted.good), 'submap')} joined, {len(admitted.refused)} refused{left}"
    pairs(title, outcome(record.report))
    answer({**record.report, "written": str(out)})
    say(f"written: {out}" + (f"; look at {out / 'report.html'} first" if figures and pictured else ""))
    return max(code_of(record.report), DONE if pictured else PARTLY)


def _pieces_of(submaps: "Sequence[Submap]", pieces: Path | None) -> "Pairs | None":
    """Each submap with the piece of log it was built of, as far as they are there; None where none were named."""
    from teamslam.cli.console import complain
    from teamslam.cli.pieces import pieces_in
    from teamslam.pipeline import pairs

    if pieces is None:
        return None
    logs, damaged = pieces_in([pieces], None, None)
    for reason in damaged:
        complain(f"refused: {reason}")
    return pairs(logs, submaps)


def _joined(
    admitted: "Admission",
    truth: "Truth | None",
    pieces: "Pairs | None",
    workers: "Workers | None",
    parts: Path | None,
    maps: "Sequence[Path]",
    progress: "Progress",
) -> "Record":
    """The run that joining these submaps is: what went in is what they hold."""
    from dataclasses import replace

    from teamslam.config import Config
    from teamslam.joining import accounted_raw, with_exactness
    from teamslam.joining import join as join_submaps
    from teamslam.model import Dataset, robot_of
    from teamslam.pipeline import Clock, Result, scores_of
    from teamslam.results.record import Record
    from teamslam.solver import Covariances
    from teamslam.trust import Assessment, unknown

    clock = Clock(progress)
    if workers is None or parts is None:
        clock.start("joining submaps")
        joined = join_submaps(admitted.good)
    else:
        joined = _on_workers(admitted.good, workers, parts, clock)
    joined = accounted_raw(admitted.good, joined)
    if pieces:
        clock.start("exactness")
        joined = with_exactness(joined, pieces)
    clock.start("verdict on the fit")
    costs = tuple(_cost(component, pieces or []) for component in joined.components)
    judged = _verdict(joined, pieces) if None not in costs else unknown(_lacking(pieces, len(admitted.good)))
    clock.start("covariances")
    covariances = tuple(Covariances.of_map(component.map) for component in joined.components)
    poses = {int(key): kind for c in joined.components for key, kind in _pose_kinds(c.map.all_values)}
    robots = {int(robot_of(key)): 2 + kind for key, kind in poses.items()}
    raw = tuple(_of_robots(table, robots) for submap in admitted.good for table in submap.raw)
    known = None if truth is None else _truth_of(joined, truth)
    team = Dataset(robots, raw, joined.map.names, known, origin=", ".join(map(str, maps)))
    clock.start("score")
    scores = scores_of(joined, covariances, known)
    trust = Assessment(judged, None, ())
    record = Record.of(Result(Config(), team, admitted.good, joined, covariances, costs, trust, scores, clock.stop()))
    marks = {int(key) for c in joined.components for key in c.map.landmark_keys}
    held = {
        "inputs": [str(path) for path in maps],
        "poses": len(poses),
        "landmarks": len(marks),
        "numbers_measured": None if None in costs else sum(piece.dof for piece, _ in pieces or []),
        "refused": [{"name": r.name, "reason": r.reason} for r in admitted.refused],
        "without": list(admitted.left_out),
    }
    if record.report["exactness"] is None and None in costs:
        held["exactness_unknown"] = f"unknown: {_lacking(pieces, len(admitted.good))}"
    return replace(record, report={**record.report, **held})


def _truth_of(joined: "Joined", truth: "Truth") -> "Values":
    """What the truth knows of all components, under their keys."""
    from teamslam.model import Values

    return reduce(lambda known, part: known.update(truth.of(part.map)), joined.components, Values.of({}))


def _cost(component: "Component", pieces: "Pairs") -> "Cost | None":
    """What a component's map costs, None where some of its pieces are missing."""
    from teamslam.joining import cost_of
    from teamslam.model import Sources

    sources = component.map.sources
    here = [(piece, submap) for piece, submap in pieces if sources.overlap(submap.sources)]
    if not here or Sources().merge(*(submap.sources for _, submap in here)) != sources:
        return None
    return cost_of(component.map, [table for piece, _ in here for table in piece.tables])


def _verdict(joined: "Joined", pieces: "Pairs | None") -> "Verdict":
    """How well the map fits the pieces of log that its submaps were built of."""
    from teamslam.model import Dataset
    from teamslam.trust import verdict

    logs = [piece for piece, _ in pieces or []]
    robots = {robot: dim for log in logs for robot, dim in log.robots.items()}
    return verdict(Dataset(robots, tuple(table for log in logs for table in log.tables), joined.map.names), joined)


def _lacking(pieces: "Pairs | None", submaps: int) -> str:
    """Why nobody knows how exact the join is."""
    if pieces is None:
        return "the measurements are not at hand; --pieces brings them"
    return f"among --pieces are those of {len(pieces)} of the {submaps} submaps only"


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
