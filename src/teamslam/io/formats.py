"""FORMATS: logs that teamslam reads and writes, by name. SUBMAP_FORMATS: the same for files of submaps.

Adding a format is adding a row: a module with `sniff(path) -> bool`, `read(path, options) -> Dataset` and, where it
writes, `write(dataset, path) -> tuple[Dropped, ...]`, which returns what the format has no place for, and
`lacks(dataset) -> str | None`, which says what cannot be left out and cannot be written. Modules are imported when they
are used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.geometry import Anchor
from teamslam.io.looks import described
from teamslam.io.maps.estimate import MapEstimate
from teamslam.model import A_LOG, A_PATH, Dataset, Dropped, Submap, expect

MISSING = "there is no such file or folder; check the path"

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Format:
    """One row: where its functions are, what it is in words, the endings of its files, what it can do."""

    module: str
    description: str
    suffixes: tuple[str, ...] = ()
    writes: bool = True
    reads: bool = True
    reports: bool = False  # reading takes its time: `read` takes a callback that hears how far it is
    anchored: bool = False  # takes places on the Earth: an anchor says where the map is

    def function(self, name: str) -> Any:
        """A function of the format's module, imported now."""
        return getattr(import_module(self.module), name)


FORMATS: dict[str, Format] = {
    "plain": Format("teamslam.io.plain", "teamslam's own: a folder with team.toml and CSV files"),
    "recordings": Format(
        "teamslam.io.bags.team",
        "recordings of ROS: a team file (.toml) that names bags, cameras and tags",
        writes=False,
        reports=True,
    ),
    "mrclam": Format("teamslam.io.logs.mrclam", "UTIAS MRCLAM: a folder with Barcodes.dat, RobotN_*.dat", writes=False),
    "islsjf": Format(
        "teamslam.io.logs.islsjf", "Victoria Park's clean log and simulated runs of I-SLSJF", writes=False
    ),
    "pyfg": Format("teamslam.io.graphs.pyfg", "PyFG factor graph (.pyfg)", (".pyfg",)),
    "g2o": Format("teamslam.io.graphs.g2o", "g2o graph (.g2o), or a folder with one for each robot", (".g2o",)),
    "toro": Format("teamslam.io.graphs.toro", "TORO and iSAM graphs (.graph, .txt)", (".graph",), writes=False),
    "jrl": Format("teamslam.io.graphs.jrl", "JSON robot log (.jrl)", (".jrl",)),
}

SUBMAP_FORMATS: dict[str, Format] = {
    "teamslam": Format("teamslam.io.submaps.arrays", "teamslam's submap file, or a folder of them", (".submap",)),
    "islsjf": Format("teamslam.io.submaps.localmaps_mat", "I-SLSJF: a folder with localmap_1.mat, ...", writes=False),
    "linear": Format("teamslam.io.submaps.localmaps_text", "Linear SLAM: a folder with localmap_1.txt, ..."),
}


MAP_FORMATS: dict[str, Format] = {
    "g2o": Format(
        "teamslam.io.maps.star", "g2o graph: vertices, and an edge from the frame to each", (".g2o",), reads=False
    ),
    "jrl": Format(
        "teamslam.io.maps.jrl_star", "JSON robot log: a factor from the frame to each variable", (".jrl",), reads=False
    ),
    "jrr": Format("teamslam.io.maps.jrr", "GTSAM's values as JSON robot results", (".jrr",)),
    "tum": Format("teamslam.io.maps.tum", "TUM trajectories, a file a robot", (".tum",)),
    "geojson": Format(
        "teamslam.io.maps.geojson", "GeoJSON, with an anchor on the Earth", (".geojson",), reads=False, anchored=True
    ),
    "kml": Format("teamslam.io.maps.kml", "KML, with an anchor on the Earth", (".kml",), reads=False, anchored=True),
    "ply": Format("teamslam.io.maps.ply", "PLY: points, ways, and ellipsoids as meshes", (".ply",), reads=False),
    "yaml": Format("teamslam.io.maps.yaml", "landmarks by name", (".yaml", ".yml"), reads=False),
    "ros": Format("teamslam.io.maps.ros_mcap", "a recording for ROS 2 (MCAP): paths and markers", reads=False),
    "rrd": Format("teamslam.io.maps.rerun_rrd", "a scene for rerun (.rrd)", (".rrd",), reads=False),
    "foxglove": Format("teamslam.io.maps.foxglove_mcap", "a scene for Foxglove (.mcap)", (".mcap",), reads=False),
    "wpilib": Format("teamslam.io.maps.wpilib", "tags as a field layout of WPILib (.json)", (".json",), reads=False),
    "csv": Format("teamslam.io.maps.table", "one table of poses and landmarks with covariances", (".csv",)),
    "truth": Format(
        "teamslam.io.maps.truth_csv",
        "a CSV file of true poses (robot, stamp, ...) or places (landmark, ...)",
        writes=False,
    ),
}

KINDS = {"log": FORMATS, "submaps": SUBMAP_FORMATS, "map": MAP_FORMATS}
ONWARD = {  # what comes of a path of a kind, for who gave it where another one is asked for
    "log": "That is a log: `teamslam run {path} --out DIR` maps it, `teamslam build {path} --out DIR` makes submaps of "
    "it",
    "submaps": "Those are submaps: `teamslam join {path} --out DIR` makes a map of them",
    "map": "That is a finished map, which holds no measurements",
}
MADE = {  # what a format of a kind is for, for who asked for it of another one
    "log": "of logs, whose measurements are in no map and no submap",
    "submaps": "of submaps: `teamslam build LOG --out DIR` makes them of a log",
    "map": "of finished maps: `teamslam run LOG --out DIR` makes one of a log, `teamslam join SUBMAPS --out DIR` of "
    "submaps; then convert DIR",
}


def read(path: str | Path, format: str | None = None, **options: object) -> Dataset:
    """The measurements in a file or folder, of the format named or told by its looks; `options` are the reader's.

    Raises InputError, naming file, line, field and cure, for whatever cannot be read.
    """
    return read_log(path, options, format=format)


def read_log(
    path: str | Path,
    options: Mapping[str, object] | None = None,
    *,
    format: str | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """As `read`; `progress` hears how far it is (a stage in words, parts done, of all) where reading takes its time."""
    path = _path(path)
    row = _row(FORMATS, path, format)
    heard = {"progress": progress} if row.reports else {}
    found: Dataset = row.function("read")(path, options, **heard)
    return found


def write(dataset: Dataset, path: str | Path, format: str | None = None) -> tuple[Dropped, ...]:
    """Writes the measurements in the format named or told by the path's ending (a path without one: plain).

    Returns what the format has no place for, and what was said in other words. Raises InputError where it cannot hold
    a measurement, and names the formats that hold them all.
    """
    path = _path(path)
    expect(dataset, Dataset, A_LOG)
    row = _row_to_write(FORMATS, path, format, "plain")
    problem: str | None = row.function("lacks")(dataset)
    if problem is not None:
        able = [name for name, other in FORMATS.items() if other.writes and other.function("lacks")(dataset) is None]
        raise InputError(
            f"{problem}; of the formats that teamslam writes, {' and '.join(able)} can hold all of this log"
        )
    losses: tuple[Dropped, ...] = row.function("write")(dataset, path) or ()
    return losses


def read_submaps(path: str | Path, format: str | None = None) -> list[Submap]:
    """The submaps in a file or folder, of the format named or told by its looks. InputError says what is wrong."""
    path = _path(path)
    found: list[Submap] = _row(SUBMAP_FORMATS, path, format).function("read")(path)
    return found


def write_submaps(submaps: Sequence[Submap], path: str | Path, format: str = "teamslam") -> tuple[Dropped, ...]:
    """Writes submaps into a folder, one file each. Returns what the format has no place for."""
    expect(submaps, Sequence, "submaps (of ts.build or ts.join), in a list")
    for submap in submaps:
        expect(submap, Submap, "submaps (of ts.build or ts.join)")
    losses: tuple[Dropped, ...] = _row_to_write(SUBMAP_FORMATS, _path(path), format, "teamslam").function("write")(
        submaps, Path(path)
    )
    return losses


def write_maps(
    maps: Sequence[MapEstimate], path: str | Path, format: str | None = None, *, anchor: Anchor | None = None
) -> tuple[Dropped, ...]:
    """Writes finished maps in the format named or told by the path's ending; several into files of their own where a
    file holds one. Returns what the format has no place for.

    Formats of places on the Earth take an `anchor`, and no others do (InputError).
    """
    path = _path(path)
    row = _row_to_write(MAP_FORMATS, path, format, None)
    if row.anchored and anchor is None:
        raise InputError(
            "places on the Earth need an anchor, which says where the map's origin is: --anchor LATITUDE,LONGITUDE on "
            "the command line, anchor=teamslam.geometry.Anchor(latitude, longitude) in a script"
        )
    if anchor is not None and not row.anchored:
        able = " and ".join(name for name, other in MAP_FORMATS.items() if other.anchored)
        raise InputError(f"an anchor goes with places on the Earth ({able}); this format holds the map's own")
    on_earth = {"anchor": anchor} if row.anchored else {}
    losses: tuple[Dropped, ...] = row.function("write")(maps, path, **on_earth)
    return losses


def read_maps(path: str | Path, format: str | None = None) -> list[MapEstimate]:
    """The finished maps in a file, of the format named or told by its looks. InputError says what is wrong."""
    path = _path(path)
    found: list[MapEstimate] = _row(MAP_FORMATS, path, format).function("read")(path)
    return found


def formats_of(path: str | Path) -> list[tuple[str, str]]:
    """What a path looks like: the kinds ('log', 'submaps', 'map') and formats that its beginning or its files fit."""
    path = _path(path)
    if not path.exists():
        raise InputError(MISSING, path=path)
    return [(kind, name) for kind, rows in KINDS.items() for name in _fitting(rows, path)]


def _path(given: object) -> Path:
    expect(given, str | Path, A_PATH)
    return Path(given)  # type: ignore[arg-type]


def _fitting(rows: dict[str, Format], path: Path) -> list[str]:
    try:
        return [name for name, row in rows.items() if row.reads and row.function("sniff")(path)]
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path=path) from None


def _row(rows: dict[str, Format], path: Path, format: str | None) -> Format:
    """The row to read a path with."""
    if format is not None:
        return _named(rows, format)
    fitting = [name for kind, name in formats_of(path) if KINDS[kind] is rows]
    if fitting:
        return rows[fitting[0]]
    looks = described(path, lambda other: [name for kind, name in formats_of(other)])
    for kind, name in formats_of(path)[:1]:
        looks = f"this is {KINDS[kind][name].description}. {ONWARD[kind].format(path=path)}"
    raise InputError(f"{looks}. It is none of the formats that teamslam reads here:\n{_listing(rows)}", path=path)


def _row_to_write(rows: dict[str, Format], path: Path, format: str | None, default: str | None) -> Format:
    name = format or _told_by_ending(rows, path)
    if name not in rows:
        for kind, others in KINDS.items():
            if other := format if format in others else None if format else _told_by_ending(others, path):
                raise InputError(f"{other} is a format {MADE[kind]}", path=path)
    name = name or default
    if name is None:
        raise InputError(
            f"the ending of this name says no format; say which one to write:\n{_listing(rows)}", path=path
        )
    row = _named(rows, name)
    if not row.writes:
        writable = {name: row for name, row in rows.items() if row.writes}
        raise InputError(f"teamslam reads this format but does not write it; it writes:\n{_listing(writable)}")
    return row


def _told_by_ending(rows: dict[str, Format], path: Path) -> str | None:
    return next((name for name, row in rows.items() if path.suffix and path.suffix in row.suffixes), None)


def _named(rows: dict[str, Format], name: str) -> Format:
    if name not in rows:
        raise InputError(f"unknown format '{name}'; choose one of:\n{_listing(rows)}")
    return rows[name]


def _listing(rows: dict[str, Format]) -> str:
    return "\n".join(f"  {name}: {row.description}" for name, row in rows.items())
