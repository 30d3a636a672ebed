"""DRIVES: a log through teamslam by one of its faces, to an outcome: a map with what was said, or a sentence alone."""

import warnings
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import teamslam as ts
from teamslam.config import Config, JoinOptions, SplitOptions
from teamslam.errors import SolveError
from teamslam.joining import Component, Joined, Unbuilt, accounted, build_choices, exact_join
from teamslam.model import Dataset, Dropped, Submap
from teamslam.pipeline import Result

FORMATS = ("plain", "g2o", "jrl", "pyfg")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a log: the log as it was mapped, by which method, and the map; or the error that was raised."""

    log: Dataset
    method: str
    joined: Joined | None = None
    result: Result | None = None  # of a whole run
    error: Exception | None = None
    file: "File | None" = None  # the log was written and read before it was mapped
    written: Exception | None = None  # why a format could not hold the log; it was then mapped as it is

    @property
    def components(self) -> tuple[Component, ...]:
        """The maps, none where an error was raised."""
        return self.joined.components if self.joined is not None else ()

    @property
    def exact(self) -> bool:
        """Whether the map is meant to be that of the full least squares."""
        return self.method in ("full", "exact")


@dataclass(frozen=True, eq=False)
class File:
    """A log that went through a file: as it was, and what the writer had no place for."""

    before: Dataset
    format: str
    dropped: tuple[Dropped, ...]


class Threads:
    """Workers that are a thread of this process: there at once, and their warnings are errors too."""

    def open(self) -> Executor:
        """An executor for their tasks."""
        return ThreadPoolExecutor(1)


@dataclass(frozen=True)
class Drive:
    """One way to map a log: with which options, whether by the functions instead of `run`, by which file first,
    whether the command line does the same, and whether a tree of workers joins."""

    config: Config = field(default_factory=Config)
    by_functions: bool = False
    format: str = ""
    by_command: bool = False
    on_workers: bool = False

    @property
    def method(self) -> str:
        """'join', 'exact' or 'full'."""
        return "exact" if self.config.method == "join" and self.config.join.exact else self.config.method


ADDED = ("levels", "frame")  # sources of rows that a run adds, and says so
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
    "workers": Drive(Config(split=PIECES), on_workers=True),
    "functions": Drive(by_functions=True),
    "exact functions": Drive(EXACT, by_functions=True),
    **{name: Drive(format=name) for name in FORMATS},
    "command": Drive(format="plain", by_command=True),
    "exact command": Drive(EXACT, format="plain", by_command=True),
}
WEIGHTS = {"join": 4.0, "full": 4.0, "exact": 4.0, "pieces": 2.0, "plain": 2.0, "tree": 0.5, "workers": 0.5}


def drive_of(seed: int) -> str:
    """The drive that goes with a seed."""
    weights = np.array([WEIGHTS.get(name, 1.0) for name in DRIVES])
    return list(DRIVES)[int(np.random.default_rng((seed, 3)).choice(len(DRIVES), p=weights / weights.sum()))]


def go(log: Dataset, drive: Drive) -> Outcome:
    """The outcome of a log. Every error ends up in it: which of them may be, the claims tell."""
    outcome = Outcome(log, drive.method)
    if drive.format:
        try:
            back, dropped = through_file(log, drive.format)
            outcome = replace(outcome, log=back, file=File(log, drive.format, dropped))
        except Exception as error:
            outcome = replace(outcome, written=error)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return _mapped(outcome, drive)
    except Exception as error:
        return replace(outcome, error=error)


def _mapped(outcome: Outcome, drive: Drive) -> Outcome:
    if drive.by_functions:
        return replace(outcome, joined=_by_functions(outcome.log, drive.config))
    as_stated = replace(drive.config, calibrate=False)  # what is checked is checked of the rows as they are
    result = ts.run(outcome.log, as_stated, workers=Threads() if drive.on_workers else None)
    added = [table for table in result.dataset.tables if table.source in ADDED]
    log = replace(outcome.log.with_tables([*outcome.log.tables, *added]), truth=result.dataset.truth)
    return replace(outcome, log=log if added else outcome.log, result=result, joined=result.joined)


def through_file(log: Dataset, format: str) -> tuple[Dataset, tuple[Dropped, ...]]:
    """The log written in a format and read again, and what was left out; its truth is kept where the format does not
    hold it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("log" if format == "plain" else f"log.{format}")
        dropped = ts.write(log, path, format=format)
        back = ts.read(path, format=format)
    return (back if back.truth is not None else replace(back, truth=log.truth)), dropped


def _by_functions(log: Dataset, config: Config) -> Joined:
    built: list[tuple[Dataset, list[Submap]]] = []
    unbuilt = []
    for piece in ts.split(log):
        try:
            built.append((piece, build_choices(piece) if config.join.exact else [ts.build(piece)]))
        except SolveError as error:
            unbuilt.append(Unbuilt(piece, str(error)))
    if unbuilt and not built:
        raise SolveError(unbuilt[0].reason)
    pieces, choices = [piece for piece, _ in built], [submaps for _, submaps in built]
    joined = exact_join(pieces, choices=choices) if config.join.exact else ts.join([first for first, *_ in choices])
    return accounted(log, joined, unbuilt)  # joins know submaps alone; this function knows what else the log holds
