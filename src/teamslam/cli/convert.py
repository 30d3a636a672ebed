"""`teamslam convert`: logs, finished maps and submaps from one format to another."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teamslam.io import MapEstimate
    from teamslam.model import Dropped, Submap


def convert(input: Path, output: Path, /, *, to: str | None = None, format: str | None = None) -> int:
    """Read a log, a finished map or submaps in one format and write them in another.

    ```
    teamslam convert MRCLAM_Dataset6 my-team --to plain
    teamslam convert robots.g2o team.jrl
    teamslam convert RUN map.csv                 # a run's map: poses and landmarks with their covariances
    teamslam convert RUN map.g2o                 # vertices, and an edge from the frame to each
    teamslam convert RUN map.jrr                 # GTSAM's values as JSON robot results
    teamslam convert RUN way.tum                 # a file a robot
    teamslam convert RUN map.rrd                 # a scene for rerun; map.mcap for Foxglove
    teamslam convert local-maps more --to linear
    ```

    Formats of logs:

    ```
    plain    teamslam's own: a folder with team.toml and CSV files
    g2o      a graph (.g2o), or a folder with one for each robot
    jrl      JSON robot log (.jrl)
    pyfg     PyFG factor graph (.pyfg)
    toro     TORO and iSAM graphs (.graph, .txt)              (read only)
    mrclam   UTIAS MRCLAM data sets                           (read only)
    islsjf   Victoria Park's clean log, runs of I-SLSJF       (read only)
    ```

    Of maps (of a run, or of a file that holds one): csv, g2o, jrr, tum, rrd, foxglove. Of submaps: teamslam, linear
    and islsjf (read only).

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    input
        A log, a run folder, or submaps: a file or folder.
    output
        The file or folder to write; it must not exist.
    to
        The format to write. Without it, told by the ending of the output's name; a log under a name without one: plain.
    format
        The format of the input, where it cannot be told from its looks.
    """
    from teamslam.cli.console import answer, say
    from teamslam.errors import InputError

    if output.exists():
        raise InputError("the output is there already; choose another name", path=output)
    kind = _kind(input, format)
    left_out = CONVERT[kind](input, output, to, format)
    for dropped in left_out:
        say(f"not as it was in the output: {dropped.count}: {dropped.reason}")
    answer({"written": str(output), "kind": kind, "changed": [vars(dropped) for dropped in left_out]})
    return 0


def _kind(input: Path, format: str | None) -> str:
    """What is to be converted: 'run', 'log', 'submaps' or 'map'."""
    from teamslam.io.formats import KINDS, formats_of
    from teamslam.results import is_run

    if is_run(input):
        return "run"
    if format is not None:
        return next((kind for kind, rows in KINDS.items() if format in rows), "log")
    return next((kind for kind, _ in formats_of(input)), "log")


def _log(input: Path, output: Path, to: str | None, format: str | None) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.io import read, write
    from teamslam.results.words import counted

    dataset = read(input, format=format)
    left_out = write(dataset, output, to)
    rows = sum(len(t) for t in dataset.tables)
    say(f"written: {output}: {counted(len(dataset.robots), 'robot', rows, 'measurement')}")
    for note in dataset.notes:
        say(f"read: {note}")
    for dropped in dataset.dropped:
        say(f"dropped in reading: {dropped.count}: {dropped.reason}")
    return left_out


def _run(input: Path, output: Path, to: str | None, _: str | None) -> "tuple[Dropped, ...]":
    """The maps of a run."""
    from teamslam.io import MapEstimate
    from teamslam.results import read_run

    record = read_run(input)
    if _is_of_submaps(output, to):
        return _write_submaps(record.maps, output, to)
    pairs = zip(record.maps, record.covariances, strict=True)
    return _write_maps([MapEstimate.of(submap, covariances.all) for submap, covariances in pairs], output, to)


def _submaps(input: Path, output: Path, to: str | None, format: str | None) -> "tuple[Dropped, ...]":
    """Submaps as submaps; one alone, which is a map, as a map too."""
    from teamslam.errors import InputError
    from teamslam.io import MapEstimate, read_submaps
    from teamslam.solver import Covariances

    submaps = read_submaps(input, format)
    if _is_of_submaps(output, to):
        return _write_submaps(submaps, output, to)
    if len(submaps) > 1:
        raise InputError(
            f"these are {len(submaps)} submaps, each in a frame of its own; join them first (teamslam join), or write "
            f"them as submaps: --to teamslam or --to linear",
            path=input,
        )
    return _write_maps([MapEstimate.of(submap, Covariances.of_map(submap).all) for submap in submaps], output, to)


def _map(input: Path, output: Path, to: str | None, format: str | None) -> "tuple[Dropped, ...]":
    """A map from a file that holds the estimate alone."""
    from teamslam.io import read_maps

    return _write_maps(read_maps(input, format), output, to)


def _is_of_submaps(output: Path, to: str | None) -> bool:
    from teamslam.io import SUBMAP_FORMATS

    return to in SUBMAP_FORMATS if to is not None else output.suffix in SUBMAP_FORMATS["teamslam"].suffixes


def _write_submaps(submaps: "Sequence[Submap]", output: Path, to: str | None) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.io import write_submaps
    from teamslam.results.words import counted

    left_out = write_submaps(submaps, output, to or "teamslam")
    say(f"written: {output}: {counted(len(submaps), 'submap')}")
    return left_out


def _write_maps(maps: "Sequence[MapEstimate]", output: Path, to: str | None) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.io import write_maps
    from teamslam.model import is_pose
    from teamslam.results.words import counted

    left_out = write_maps(maps, output, to)
    for number, found in enumerate(maps, 1):
        poses = int(is_pose(found.values.layout.keys).sum())
        part = f", part {number} of {len(maps)}" if len(maps) > 1 else ""
        say(f"written: {output}{part}: {counted(poses, 'pose', len(found.values) - poses, 'landmark')}")
    return left_out


CONVERT = {"run": _run, "log": _log, "submaps": _submaps, "map": _map}
