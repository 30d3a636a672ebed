"""`teamslam convert`: logs, finished maps and submaps from one format to another."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teamslam.geometry import Anchor
    from teamslam.io import MapEstimate
    from teamslam.model import Dropped, Submap


def convert(
    input: Path, output: Path, /, *, to: str | None = None, format: str | None = None, anchor: str | None = None
) -> int:
    """Read a log, a finished map or submaps in one format and write them in another.

    ```
    teamslam convert MRCLAM_Dataset6 my-team --to plain
    teamslam convert robots.g2o team.jrl
    teamslam convert RUN map.csv                 # a run's map: poses and landmarks with their covariances
    teamslam convert RUN map.g2o                 # vertices, and an edge from the frame to each
    teamslam convert RUN map.jrl                 # the same as a JSON robot log; map.jrr for GTSAM's values alone
    teamslam convert RUN way.tum                 # a file a robot
    teamslam convert RUN landmarks.yaml          # landmarks by name; map.ply for viewers of points and meshes
    teamslam convert RUN recording --to ros      # paths and markers for ROS 2
    teamslam convert RUN map.kml --anchor 52.0116,4.3571   # on the Earth; or map.geojson
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
    recordings  of ROS: a team file that names them           (read only)
    ```

    Of maps (of a run, or of a file that holds one): csv, truth (read only), g2o, jrl, jrr, tum; and to write
    only: geojson, kml, ply, yaml, ros, wpilib, rrd, foxglove. Of submaps: teamslam, linear and islsjf (read only).

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
    anchor
        For kml and geojson: LATITUDE,LONGITUDE of the map's origin [degrees, WGS 84]; after them, if you like, its
        height above the ellipsoid [m], and by how much its x axis is turned anticlockwise from east [degrees].
    """
    from teamslam.cli.console import answer, say
    from teamslam.errors import InputError

    if output.exists():
        raise InputError("the output is there already; choose another name", path=output)
    kind = _kind(input, format)
    target = Target(output, to, None if anchor is None else _anchor(anchor))
    left_out = CONVERT[kind](input, format, target)
    for dropped in left_out:
        say(f"not as it was in the output: {dropped.count}: {dropped.reason}")
    answer({"written": str(output), "kind": kind, "changed": [vars(dropped) for dropped in left_out]})
    return 0


@dataclass(frozen=True)
class Target:
    """What to write: where, in which format (None: told by its ending), and where on the Earth a map is."""

    output: Path
    to: str | None
    anchor: "Anchor | None"

    @property
    def is_of_submaps(self) -> bool:
        """Whether it is for submaps, and not for a map."""
        from teamslam.io import SUBMAP_FORMATS

        suffixes = SUBMAP_FORMATS["teamslam"].suffixes
        return self.to in SUBMAP_FORMATS if self.to is not None else self.output.suffix in suffixes


def _anchor(text: str) -> "Anchor":
    from teamslam.errors import InputError
    from teamslam.geometry import Anchor

    try:
        numbers = [float(word) for word in text.split(",")]
        if not 2 <= len(numbers) <= 4:
            raise ValueError
    except ValueError:
        raise InputError(
            f"--anchor is LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,HEIGHT,TURN, such as 52.0116,4.3571; found '{text}'"
        ) from None
    return Anchor(*numbers)


def _kind(input: Path, format: str | None) -> str:
    """What is to be converted: 'run', 'log', 'submaps' or 'map'."""
    from teamslam.io.formats import KINDS, formats_of
    from teamslam.results import is_run

    if is_run(input):
        return "run"
    if format is not None:
        return next((kind for kind, rows in KINDS.items() if format in rows), "log")
    return next((kind for kind, _ in formats_of(input)), "log")


def _log(input: Path, format: str | None, target: Target) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.errors import InputError
    from teamslam.io import read, write
    from teamslam.results.words import counted

    dataset = read(input, format=format)
    if target.anchor is not None:
        raise InputError("an anchor goes with a map; this is a log, which has none yet")
    left_out = write(dataset, target.output, target.to)
    rows = sum(len(t) for t in dataset.tables)
    say(f"written: {target.output}: {counted(len(dataset.robots), 'robot', rows, 'measurement')}")
    for note in dataset.notes:
        say(f"read: {note}")
    for dropped in dataset.dropped:
        say(f"dropped in reading: {dropped.count}: {dropped.reason}")
    return left_out


def _run(input: Path, _: str | None, target: Target) -> "tuple[Dropped, ...]":
    """The maps of a run."""
    from teamslam.io import MapEstimate
    from teamslam.results import read_run

    record = read_run(input)
    if target.is_of_submaps:
        return _write_submaps(record.maps, target)
    pairs = zip(record.maps, record.covariances, strict=True)
    return _write_maps([MapEstimate.of(submap, covariances.all) for submap, covariances in pairs], target)


def _submaps(input: Path, format: str | None, target: Target) -> "tuple[Dropped, ...]":
    """Submaps as submaps; one alone, which is a map, as a map too."""
    from teamslam.errors import InputError
    from teamslam.io import MapEstimate, read_submaps
    from teamslam.solver import Covariances

    submaps = read_submaps(input, format)
    if target.is_of_submaps:
        return _write_submaps(submaps, target)
    if len(submaps) > 1:
        raise InputError(
            f"these are {len(submaps)} submaps, each in a frame of its own; join them first (teamslam join), or write "
            f"them as submaps: --to teamslam or --to linear",
            path=input,
        )
    return _write_maps([MapEstimate.of(submap, Covariances.of_map(submap).all) for submap in submaps], target)


def _map(input: Path, format: str | None, target: Target) -> "tuple[Dropped, ...]":
    """A map from a file that holds the estimate alone."""
    from teamslam.io import read_maps

    return _write_maps(read_maps(input, format), target)


def _write_submaps(submaps: "Sequence[Submap]", target: Target) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.io import write_submaps
    from teamslam.results.words import counted

    left_out = write_submaps(submaps, target.output, target.to or "teamslam")
    say(f"written: {target.output}: {counted(len(submaps), 'submap')}")
    return left_out


def _write_maps(maps: "Sequence[MapEstimate]", target: Target) -> "tuple[Dropped, ...]":
    from teamslam.cli.console import say
    from teamslam.io import write_maps
    from teamslam.model import is_pose
    from teamslam.results.words import counted

    left_out = write_maps(maps, target.output, target.to, anchor=target.anchor)
    for number, found in enumerate(maps, 1):
        poses = int(is_pose(found.values.layout.keys).sum())
        part = f", part {number} of {len(maps)}" if len(maps) > 1 else ""
        say(f"written: {target.output}{part}: {counted(poses, 'pose', len(found.values) - poses, 'landmark')}")
    return left_out


CONVERT = {"run": _run, "log": _log, "submaps": _submaps, "map": _map}
