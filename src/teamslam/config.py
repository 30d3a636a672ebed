"""The options of each room, gathered: one TOML file in, one file saved beside the result.

    method = "join"              # or "full": all measurements in one least squares problem
    calibrate = true             # false: the noise is taken as the log states it, whatever the data show
    [read]                       # options of the reader, as in teamslam.read(path, **options)
    [loss]                       # replaces the loss of every sighting; absent: as the reader set it
    name = "huber"
    scale = 2.0
    [split]                      # where logs are cut into submaps; absent: one submap a robot
    poses_per_piece = 200
    [join]                       # how submaps are joined
    order = "at once"            # or "sequential", "tree"
    exact = false                # true: rounds until the join is the full least squares
    [trust]                      # what is not believed
    reject = true                # sightings that are wrong are left out; absent: all are believed
    wrong = 0.1                  # the probability that a sighting is wrong; absent: by the data
    repair = false               # true: names that lie are put right, and robots that lie left out
    [solver]                     # how least squares problems are solved
    max_iterations = 100

What a file does not mention keeps its default. A key that is not known, or a value of the wrong type, is an InputError
that names the key and, for a misspelt one, the nearest key there is.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, cast

import tomli_w

from teamslam.errors import InputError
from teamslam.io.files.toml import read_toml, record_from
from teamslam.joining import ORDERS
from teamslam.model import Loss
from teamslam.solver import Options as SolverOptions

METHODS = ("join", "full")
ReaderOption = bool | int | float | str | list[str]


@dataclass(frozen=True)
class SplitOptions:
    """Where logs are cut into submaps, beyond gaps in the odometry: after `poses_per_piece` poses, or where the
    dead-reckoned heading is uncertain by `heading_sigma` [rad]. Without either, a robot's log is one submap."""

    poses_per_piece: int | None = None
    heading_sigma: float | None = None

    def __post_init__(self) -> None:
        if self.poses_per_piece is not None and self.poses_per_piece < 2:
            raise InputError(f"a piece of a log needs at least 2 poses, found {self.poses_per_piece}")
        if self.heading_sigma is not None and not 0.0 < self.heading_sigma < math.inf:
            raise InputError(f"heading_sigma is an angle above 0, found {self.heading_sigma}")


@dataclass(frozen=True)
class JoinOptions:
    """How submaps are joined: `order` is a row of ORDERS. `exact`: in rounds instead, until the decrease of the full
    cost still to be had is below `gap` of it, at most `max_rounds`."""

    order: str = "at once"
    exact: bool = False
    gap: float = 1e-20
    max_rounds: int = 300

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise InputError(f"unknown order of joining '{self.order}'; choose one of {', '.join(ORDERS)}")
        if not 0.0 < self.gap < math.inf:
            raise InputError(f"gap is above 0 and finite, a share of the cost; found {self.gap}")
        if self.max_rounds < 1:
            raise InputError(f"max_rounds is at least 1, found {self.max_rounds}")
        if self.exact and self.order != "at once":
            raise InputError(f"an exact join takes all at once; leave out exact, or the order '{self.order}'")


@dataclass(frozen=True)
class TrustOptions:
    """What is not believed. `reject`: sightings that are wrong are found and left out; `wrong` is the probability that
    one is, by the data where it is None. `repair`: names of landmarks that lie are put right, and robots that lie are
    left out; else they are only named."""

    reject: bool = False
    wrong: float | None = None
    repair: bool = False

    def __post_init__(self) -> None:
        if self.wrong is not None and not 0.0 < self.wrong < 1.0:
            raise InputError(f"the probability that a sighting is wrong lies between 0 and 1, found {self.wrong}")
        if self.wrong is not None and not self.reject:
            raise InputError("wrong, the probability of wrong sightings, is without effect unless reject = true")


@dataclass(frozen=True)
class Config:
    """Everything that a run may be told. `Config()` is the default run.

    `loss` None keeps the losses that the reader chose for its sensors. `read` is handed to the reader of the input's
    format, which knows the names and checks them. `calibrate`: what the data show to be wrong with their model
    is put right, and the map made again; false takes the noise as it is stated.
    """

    method: str = "join"
    calibrate: bool = True
    read: Mapping[str, ReaderOption] = field(default_factory=dict)
    loss: Loss | None = None
    split: SplitOptions = field(default_factory=SplitOptions)
    join: JoinOptions = field(default_factory=JoinOptions)
    trust: TrustOptions = field(default_factory=TrustOptions)
    solver: SolverOptions = field(default_factory=SolverOptions)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"unknown method '{self.method}'; choose one of {', '.join(METHODS)}", field="method")
        if self.method == "full" and self.join.exact:
            raise InputError(
                "full least squares is exact and has no rounds; leave out --exact (exact = true), or the method",
                field="method",
            )


def read_config(path: str | Path) -> Config:
    """The options in a TOML file. InputError names the file, the key and the cure."""
    path = Path(path)
    return config_from(read_toml(path), path=path)


def config_from(table: Mapping[str, Any], *, path: str | Path | None = None) -> Config:
    """The options in a nested table, as TOML gives it. Law: config_from(to_table(config)) == config."""
    return record_from(table, Config, path=path)


def to_table(config: Config) -> dict[str, Any]:
    """The options as a nested table that TOML can hold; what is None is left out, as TOML has no word for it."""
    return cast(dict[str, Any], _plain(asdict(config)))


def write_config(config: Config, path: str | Path) -> None:
    """Save every option as it was used, defaults included, so that the run can be repeated."""
    Path(path).write_text(config_text(config), encoding="utf-8")


def config_text(config: Config) -> str:
    """Every option as it was used, defaults included, in TOML."""
    return tomli_w.dumps(to_table(config))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, Enum):
        return value.value
    return list(value) if isinstance(value, tuple) else value
