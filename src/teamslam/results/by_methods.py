"""A log whose truth is known, mapped by each method of the paper's experiment: full least squares, joining, and joining
in rounds until it is exact; all by the noise as it is stated.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from teamslam.config import Config
from teamslam.errors import SolveError
from teamslam.joining import Joined
from teamslam.model import Dataset
from teamslam.pipeline import Clock, Progress, mapped

METHODS = ("full", "join", "exact")


@dataclass(frozen=True, eq=False)
class ByMethods:
    """The maps by method, and why some methods gave none."""

    maps: Mapping[str, Joined]
    missing: tuple[str, ...]


def by_methods(dataset: Dataset, config: Config, progress: Progress | None = None) -> ByMethods:
    """The maps of a log by each of METHODS."""
    clock = Clock(progress)
    maps, missing = {}, []
    for method in METHODS:
        name = "full" if method == "full" else "join"
        options = replace(config, method=name, join=replace(config.join, exact=method == "exact"))
        try:
            _, _, maps[method] = mapped(dataset, options, None, None, clock)
        except SolveError as error:
            missing.append(f"{method}: {error}")
    return ByMethods(maps, tuple(missing))
