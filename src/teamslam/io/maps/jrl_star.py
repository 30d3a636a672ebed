"""Whole maps as JSON robot logs (.jrl): the map as factors from its frame to each variable, and as initial values.

As the g2o graph of a map (`star`), in JRL's words: a factor states where a variable was found, seen from the base pose,
with the variable's own covariance; of a map in the world's frame it is a prior. The optimum of the factors is the map,
and marginal covariances there are the map's. Points are written as ranges with bearings. Correlations are left out.
Source: the public format documents of JRL (Daniel McGann).
"""

from collections.abc import Sequence
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.graphs import jrl_writer
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.star import as_log
from teamslam.model import Dropped


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: its initial values read back as the estimate, with the names, and
    its factors are least there. InputError for what JRL has no factor for."""
    logs = [as_log(found) for found in maps]
    problem = next((problem for log in logs if (problem := jrl_writer.lacks(log)) is not None), None)
    if problem is not None:
        raise InputError(f"{problem}; write a CSV")
    said = [
        lost for log, file in zip(logs, paths_of(path, len(maps)), strict=True) for lost in jrl_writer.write(log, file)
    ]
    count = sum(len(found.values) for found in maps)
    return (
        *said,
        Dropped(count, "variables whose correlations with others are left out: each has its own covariance"),
    )
