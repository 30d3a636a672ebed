"""TORO's and iSAM's text graphs (.graph, .txt), as GTSAM ships them: vertices and edges of one robot or a team.

What is read: TORO's VERTEX2, VERTEX3, EDGE2, EDGE3; iSAM's ODOMETRY, EDGE2, EDGE3, LANDMARK, POINT3, POSE3D_INIT,
POSE3D_TRUE; GTSAM's BR (bearing and range); g2o's words too, where a file mixes them. Lines without noise have one unit
of it. EQUIV lines and tags that teamslam does not know are left out and counted. Ids are read as those of g2o are;
landmarks are numbered for themselves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.files.options import options_of
from teamslam.io.files.records import first_tag
from teamslam.io.graphs import toro_tags
from teamslam.io.graphs.assemble import assemble
from teamslam.io.graphs.text_graph import is_known, read_part
from teamslam.io.graphs.toro_noise import MEANINGS
from teamslam.model import Dataset

TAGS = {*toro_tags.VERTICES, *toro_tags.EDGES, *toro_tags.TRUTH, *toro_tags.REPEATS}


@dataclass(frozen=True)
class Options:
    """What the reader may be told: what the numbers after a measurement are, 'information', 'square_root' (of it) or
    'covariance'; without it that is told by the file (see `toro_noise`)."""

    noise: str = "told by the file"


def sniff(path: Path) -> bool:
    """A .graph file or a folder of them, or a file that begins with one of the tags."""
    if path.is_dir():
        return any(path.glob("*.graph"))
    return path.suffix == ".graph" or is_known(first_tag(path), TAGS)


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a file, or of a folder with one file for each robot; `options` as in `Options`.

    InputError names file, line and field of what cannot be read.
    """
    chosen = options_of(Options, options, reader="toro")
    stated = None if chosen == Options() else chosen.noise
    if stated is not None and stated not in MEANINGS:
        raise InputError(f"expected one of {', '.join(MEANINGS)}, found '{stated}'", field="noise")
    files = sorted(path.glob("*.graph")) if path.is_dir() else [path]
    if not files:
        raise InputError("expected files *.graph in this folder, found none", path=path)
    return assemble([read_part(file, noise=stated) for file in files], str(path))
