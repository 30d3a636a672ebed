"""Variations of real logs: a seed takes a published log, cuts, thins and renames it, and maps it by one of the faces.

Nobody made these logs for us, so noise, outliers and gaps are what they are. A variation ends with a map that keeps its
laws (`maps`, `whole`, `reports`), or with a sentence that is true of the log at its reference: the published truth,
completed by the full least squares of the whole log, which a test of its own holds against the truth.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

import teamslam as ts
from stress.drive import DRIVES, EXACT, Drive
from stress.scenario import LOSSES
from stress.world import numbered
from teamslam.config import Config, SplitOptions
from teamslam.geometry import BoolArray, IntArray
from teamslam.model import (
    SQUARED,
    Dataset,
    Loss,
    Table,
    Values,
    index_of,
    is_landmark,
    is_pose,
    landmark_key,
    pose_key,
    robot_of,
)

LOGS = {  # and how often each is drawn
    "mrclam_1": 0.15,
    "mrclam_6": 0.15,
    "mrclam_7": 0.15,
    "mrclam_9": 0.15,
    "mrclam5a.pyfg": 0.1,
    "plaza2.pyfg": 0.08,
    "distributed_mapper_4robots": 0.08,
    "parking-garage.g2o": 0.06,
    "islsjf_535": 0.08,
}
CUT = SplitOptions(poses_per_piece=50)
DRIVEN: dict[str, Drive] = {
    **{
        n: DRIVES[n]
        for n in ("join", "full", "exact", "heading", "sequential", "tree", "functions", "plain", "command")
    },
    "pieces": Drive(Config(split=CUT)),
    "exact pieces": Drive(replace(EXACT, split=CUT)),
}
Find = Callable[[str], Path]
Change = Callable[[Dataset, np.random.Generator], tuple[Dataset, str]]


@dataclass(frozen=True)
class Variation:
    """Which log, and what was made of it, in words; `space`, `noise` and `faults` are what campaigns count by."""

    seed: int
    space: str
    faults: tuple[str, ...]
    words: tuple[str, ...]
    noise: str = "real"

    def __str__(self) -> str:
        return f"seed {self.seed}: {self.space}, {'; '.join(self.words) or 'as it is'}"


def vary(seed: int, find: Find, log: str | None = None) -> tuple[Variation, Dataset, str]:
    """The variation of a seed, its log (its truth completed by the reference), and the drive that goes with it."""
    rng = np.random.default_rng((seed, 5))
    shares = np.array(list(LOGS.values()))
    name = str(rng.choice(list(LOGS), p=shares / shares.sum()))
    name = log or name
    drive = str(rng.choice(list(DRIVEN)))
    out, faults, words = complete(name, find), [], []
    for change, (often, make) in CHANGES.items():
        if rng.random() < often and out.tables:
            changed, said = make(out, rng)
            if changed.tables:
                out, faults, words = changed, [*faults, change], [*words, said]
    return Variation(seed, name, tuple(faults), tuple(words)), out, drive


@cache
def complete(name: str, find: Find) -> Dataset:
    """A published log, whose truth is its own where it has one, and else the full least squares' map."""
    log = ts.read(find(name))
    log = replace(log, tables=numbered(log.tables))
    reference = ts.run(log, Config(method="full", calibrate=False))
    (component,) = reference.joined.components
    values = component.map.all_values
    if log.truth is None:
        return replace(log, truth=values)
    known = ts.score(component.map, log.truth).alignment
    assert known is not None
    return replace(log, truth=values.transform(known).update(log.truth))


# --- changes ----------------------------------------------------------------------------------------------------------


def _fewer_robots(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """Some robots, and all that was seen of them, are not there."""
    robots = sorted(log.robots)
    if len(robots) < 2:
        return log, "its one robot"
    kept = sorted(rng.choice(robots, int(rng.integers(1, len(robots))), replace=False).tolist())

    def there(table: Table) -> BoolArray:
        return np.asarray(np.isin(robot_of(table.keys), [0, -1, *kept]).all(1)) & (table.robot in kept)

    out = _where(log, there)
    return replace(out, robots={r: log.robots[r] for r in kept}), f"robots {kept} alone"


def _window(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """What was measured in a stretch of time."""
    keys = log.layout.keys
    times = index_of(keys[is_pose(keys)])
    share = float(np.exp(rng.uniform(np.log(0.01), np.log(0.5))))
    first = int(np.quantile(times, rng.uniform(0.0, 1.0 - share)))
    last = int(first + share * (times.max() - times.min()))

    def inside(table: Table) -> BoolArray:
        index = index_of(table.keys)
        return np.asarray((~is_pose(table.keys) | ((index >= first) & (index <= last))).all(1))

    out = _where(log, inside)
    spoken = (
        set(np.unique(robot_of(np.concatenate([t.keys.ravel() for t in out.tables]))).tolist()) if out.tables else ()
    )
    return replace(out, robots={r: d for r, d in log.robots.items() if r in spoken}), f"{share:.0%} of its time"


def _thinned(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """A share of what was seen."""
    share = float(np.exp(rng.uniform(np.log(0.02), np.log(0.9))))
    out = _where(log, lambda t: np.ones(len(t), bool) if t.source == "odometry" else rng.random(len(t)) < share)
    return out, f"{share:.0%} of the sightings"


def _lossy(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """Rows of every kind are lost here and there."""
    share = float(rng.uniform(0.005, 0.3))
    return _where(log, lambda t: rng.random(len(t)) >= share), f"{share:.1%} of all rows lost"


def _gaps(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """Odometry is silent for a while."""
    count = int(rng.integers(1, 6))
    gaps = {t.robot: np.zeros(len(t), bool) for t in log.tables if t.source == "odometry"}
    for _ in range(count if gaps else 0):
        mask = gaps[int(rng.choice(sorted(gaps)))]
        at = int(rng.integers(len(mask)))
        mask[at : at + int(rng.integers(1, 21))] = True

    def keep(table: Table) -> BoolArray:
        lost = gaps.get(table.robot)
        return (
            ~lost
            if table.source == "odometry" and lost is not None and len(lost) == len(table)
            else np.ones(len(table), bool)
        )

    return _where(log, keep), f"{count} gaps in odometry"


def _forgiven(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """Sightings under another loss."""
    name = str(rng.choice(list(LOSSES)))
    loss = SQUARED if name == "squared" else Loss(name, float(rng.choice([0.5, 1.0, 2.0, 5.0])))
    return log.with_loss(loss), f"loss {loss.name}({loss.scale:g})"


def _renamed(log: Dataset, rng: np.random.Generator) -> tuple[Dataset, str]:
    """Robots and landmarks have other numbers."""
    robots = dict(
        zip(sorted(log.robots), rng.choice(np.arange(1, 900), len(log.robots), replace=False).tolist(), strict=True)
    )
    marks = log.landmark_keys
    numbers = landmark_key(rng.permutation(len(marks)) + int(rng.integers(0, 10**9)))
    lookup = np.zeros(max(robots) + 1, np.int64)
    lookup[list(robots)] = list(robots.values())

    def name(keys: IntArray) -> IntArray:
        out = keys.copy()
        poses, seen = is_pose(keys), is_landmark(keys)
        out[poses] = pose_key(lookup[robot_of(keys[poses])], index_of(keys[poses]))
        out[seen] = numbers[np.searchsorted(marks, keys[seen])]
        return out

    assert log.truth is not None
    of = log.truth.only(np.intersect1d(log.truth.layout.keys, log.layout.keys))
    truth = Values.of({kind: (name(keys), data) for kind, keys, data in of.parts()})
    tables = tuple(replace(t, robot=robots[t.robot], keys=name(t.keys)) for t in log.tables)
    names = replace(log.names, robots={}, landmarks={})
    dims = {robots[r]: dim for r, dim in log.robots.items()}
    out = replace(log, robots=dims, tables=tables, truth=truth, names=names, initial=None)
    return out, "other numbers for robots and landmarks"


def _where(log: Dataset, keep: Callable[[Table], BoolArray]) -> Dataset:
    tables = [t.select(keep(t)) for t in log.tables]
    return log.with_tables(numbered(t for t in tables if len(t)))


CHANGES: dict[str, tuple[float, Change]] = {
    "fewer robots": (0.4, _fewer_robots),
    "a window": (0.7, _window),
    "thinned": (0.35, _thinned),
    "lossy": (0.25, _lossy),
    "gaps": (0.3, _gaps),
    "another loss": (0.4, _forgiven),
    "renamed": (0.25, _renamed),
}
