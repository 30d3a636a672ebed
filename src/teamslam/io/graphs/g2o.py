"""g2o graphs (.g2o): vertices with estimates and edges with information matrices, for one robot or a team.

What is read: VERTEX_SE2, VERTEX_SE3:QUAT, VERTEX_XY, VERTEX_TRACKXYZ; the edges of `EDGES`; PARAMS_SE2OFFSET and
PARAMS_SE3OFFSET, which become `Table.sensor`; TORO's and iSAM's words too, where a file mixes them (see `toro`).
Vertices are estimates and become `Dataset.initial`; of those that stand twice the first counts. Tags that teamslam does
not know and vertices without an edge are left out and counted. A folder holds one file for each robot; an edge that
stands in the files of both its robots is one measurement, and its first vertex is the observer.

A vertex that a FIX line holds only chooses the frame: teamslam does that itself, and counts it. Two of a file, or one
beside measurements in the world, would be held for good, which teamslam does not do: they are refused.

Whose a vertex is, is told by its id: a letter, a block of ids, or the file it stands in (see `owners`).

Noise: information may be zero in some directions, which then say nothing; negative, it is refused. g2o's error of a
relative pose is [zR'(hT - zT) ; vec of the quaternion of zR' hR], whose rotation part is half the angle. It is
converted to teamslam's mixed chart to first order at the measurement (`charts`; exact in the plane and for
translations), and back on writing. Files that GTSAM wrote state information in GTSAM's chart, which has the full
angle: `chart = "gtsam"` reads them so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.files.options import options_of
from teamslam.io.files.records import first_tag
from teamslam.io.graphs import toro
from teamslam.io.graphs.assemble import assemble
from teamslam.io.graphs.g2o_tags import EDGES, PARAMETERS, VERTICES
from teamslam.io.graphs.g2o_writer import lacks, write
from teamslam.io.graphs.text_graph import is_known, read_part
from teamslam.model import Dataset

__all__ = ["Options", "lacks", "read", "sniff", "write"]

TAGS = {*VERTICES, *EDGES, *PARAMETERS}


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whose chart the information of relative poses is in, 'g2o' or 'gtsam'."""

    chart: str = "g2o"


def sniff(path: Path) -> bool:
    """A .g2o file or a folder of them, or a file that begins with one of the tags."""
    if path.is_dir():
        return any(path.glob("*.g2o"))
    return (path.suffix == ".g2o" and not is_known(first_tag(path), toro.TAGS)) or is_known(first_tag(path), TAGS)


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a g2o file, or of a folder with one file for each robot; `options` as in `Options`.

    InputError names file, line and field of what cannot be read: an edge whose vertex is nowhere or of the wrong kind,
    information that is negative, numbers that are none.
    """
    chosen = options_of(Options, options, reader="g2o")
    if chosen.chart not in ("g2o", "gtsam"):
        raise InputError(f"expected 'g2o' or 'gtsam', found '{chosen.chart}'", field="chart")
    files = sorted(path.glob("*.g2o")) if path.is_dir() else [path]
    if not files:
        raise InputError("expected files *.g2o in this folder, found none", path=path)
    return assemble([read_part(file, half_angle=chosen.chart == "g2o") for file in files], str(path))
