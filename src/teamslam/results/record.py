"""What is kept of a run: enough to draw, score and compare it later without the log.

`maps` holds one map for each component. `history` has the solver's steps in order. `report` is what report.json says.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Dataset, Submap, Values
from teamslam.pipeline import Result
from teamslam.results.report import report_of
from teamslam.solver import Covariances, Step


@dataclass(frozen=True, eq=False)
class Record:
    """A run as it is kept. `truth` is in the world's frame, `sightings` (n, 2) are pairs of pose keys."""

    maps: tuple[Submap, ...]
    covariances: tuple[Covariances, ...]
    truth: Values | None
    sightings: IntArray
    history: tuple[Step, ...]
    report: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, result: Result) -> "Record":
        """What to keep of a finished run."""
        components = result.joined.components
        solution = components[0].solution
        return cls(
            maps=tuple(c.map for c in components),
            covariances=result.covariances,
            truth=result.dataset.truth,
            sightings=robot_sightings(result.dataset),
            history=solution.history if solution else (),
            report=report_of(result),
        )

    @property
    def method(self) -> str:
        """How the map was made: 'join' or 'full'."""
        return str(self.report.get("method", "join"))

    @property
    def costs(self) -> list[float]:
        """The objective of the last solve, before it and after each step that was taken."""
        taken = [step.cost for step in self.history if step.accepted]
        return [*taken, float(self.report["objective"])] if taken else []


def robot_sightings(dataset: Dataset) -> IntArray:
    """Who saw whom: observer's and observed robot's pose keys (n, 2)."""
    pairs = [t.keys for t in dataset.tables if t.observes_robots]
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), np.int64)
