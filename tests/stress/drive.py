"""DRIVES: a log through teamslam by one of its faces, to an outcome: a map with what was said, or a sentence alone."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import teamslam as ts
from teamslam.config import Config, JoinOptions, SplitOptions
from teamslam.joining import Component, Joined, exact_join
from teamslam.model import Dataset

FORMATS = ("plain", "g2o", "jrl", "pyfg")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a log: the log as it was mapped, by which method, and the map; or the error that was raised."""

    log: Dataset
    method: str
    joined: Joined | None = None
    error: Exception | None = None
    written: Exception | None = None  # why a format could not hold the log; it was then mapped as it is

    @property
    def components(self) -> tuple[Component, ...]:
        """The maps, none where an error was raised."""
        return self.joined.components if self.joined is not None else ()

    @property
    def exact(self) -> bool:
        """Whether the map is meant to be that of the full least squares."""
        return self.method in ("full", "exact")


@dataclass(frozen=True)
class Drive:
    """One way to map a log: with which options, whether by the functions instead of `run`, by which file first."""

    config: Config = field(default_factory=Config)
    by_functions: bool = False
    format: str = ""

    @property
    def method(self) -> str:
        """'join', 'exact' or 'full'."""
        return "exact" if self.config.method == "join" and self.config.join.exact else self.config.method


EXACT = Config(join=JoinOptions(exact=True))
PIECES = SplitOptions(poses_per_piece=3)
DRIVES: dict[str, Drive] = {
    "join": Drive(),
    "full": Drive(Config(method="full")),
    "exact": Drive(EXACT),
    "pieces": Drive(Config(split=PIECES)),
    "exact pieces": Drive(replace(EXACT, split=PIECES)),
    "heading": Drive(Config(split=SplitOptions(heading_sigma=0.05))),
    "sequential": Drive(Config(join=JoinOptions(order="sequential"))),
    "tree": Drive(Config(join=JoinOptions(order="tree"))),
    "functions": Drive(by_functions=True),
    "exact functions": Drive(EXACT, by_functions=True),
    **{name: Drive(format=name) for name in FORMATS},
}
WEIGHTS = {"join": 4.0, "full": 4.0, "exact": 4.0, "pieces": 2.0, "plain": 2.0}


def drive_of(seed: int) -> str:
    """The drive that goes with a seed."""
    weights = np.array([WEIGHTS.get(name, 1.0) for name in DRIVES])
    return list(DRIVES)[int(np.random.default_rng((seed, 3)).choice(len(DRIVES), p=weights / weights.sum()))]


def go(log: Dataset, drive: Drive) -> Outcome:
    """The outcome of a log. Every error ends up in it: which of them may be, the claims tell."""
    outcome = Outcome(log, drive.method)
    if drive.format:
        try:
            outcome = replace(outcome, log=through_file(log, drive.format))
        except Exception as error:
            outcome = replace(outcome, written=error)
    try:
        mapped = _by_functions if drive.by_functions else _by_run
        return replace(outcome, joined=mapped(outcome.log, drive.config))
    except Exception as error:
        return replace(outcome, error=error)


def through_file(log: Dataset, format: str) -> Dataset:
    """The log written in a format and read again; its truth is kept where the format does not hold it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("log" if format == "plain" else f"log.{format}")
        ts.write(log, path, format=format)
        back = ts.read(path, format=format)
    return back if back.truth is not None else replace(back, truth=log.truth)


def _by_run(log: Dataset, config: Config) -> Joined:
    return ts.run(log, config).joined


def _by_functions(log: Dataset, config: Config) -> Joined:
    pieces = ts.split(log)
    if config.join.exact:
        return exact_join(pieces)
    return ts.join([ts.build(piece) for piece in pieces])
