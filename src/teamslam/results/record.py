"""What is kept of a run: enough to draw, score and compare it later without the log.

`maps` holds one map for each component, `histories` the steps of the last solve of each, in order. `report` is what
report.json says, `residuals` what residuals.csv does (nothing in a record that was read back, until they are).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.answers import Answers, Residuals, ResidualTable
from teamslam.answers.maps_card import facts_of, maps_card
from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.model import Dataset, Submap, Values
from teamslam.pipeline import Result
from teamslam.results.report import report_of
from teamslam.results.residuals import residuals_in, residuals_of
from teamslam.solver import Covariances, Step


@dataclass(frozen=True, eq=False)
class Record(Answers):
    """A run as it is kept, asked by name (see `teamslam.answers`). `truth` is in the world's frame, `sightings` (n, 2)
    are pairs of pose keys; `rows` what every row of the log leaves at the map (else `folder`, where
    it was read from, has them)."""

    maps: tuple[Submap, ...]
    covariances: tuple[Covariances, ...]
    truth: Values | None
    sightings: IntArray
    histories: tuple[tuple[Step, ...], ...]
    report: Mapping[str, Any] = field(default_factory=dict)
    rows: tuple[Residuals, ...] = ()
    folder: Path | None = None

    @classmethod
    def of(cls, result: Result) -> "Record":
        """What to keep of a finished run."""
        components = result.joined.components
        return cls(
            maps=tuple(c.map for c in components),
            covariances=result.covariances,
            truth=result.dataset.truth,
            sightings=robot_sightings(result.dataset),
            histories=tuple(c.solution.history if c.solution else () for c in components),
            report=report_of(result),
            rows=residuals_of(result.verdict),
        )

    def residuals(self) -> ResidualTable:
        """How far every row of the log is off; of a run that was read back, as its folder has them. InputError where
        there are none."""
        rows = self.rows or (residuals_in(self.folder) if self.folder is not None else ())
        if not rows:
            raise InputError("this run has no residuals: the measurements that it was made of were not at hand")
        return ResidualTable(rows)

    def __repr__(self) -> str:
        return f"Record({'; '.join(value for _, value in self._facts())}{'; ' * bool(self._fit)}{self._fit})"

    def _repr_html_(self) -> str:
        return maps_card(self.report.get("input") or "A team's map", self, self._facts(), self._fit)

    def _facts(self) -> list[tuple[str, str]]:
        done = self.report.get("converged")
        state = [] if done is None else [("state", "converged" if done else "not converged")]
        return [*facts_of(self), *state]

    @property
    def _fit(self) -> str:
        return str((self.report.get("fit") or {}).get("sentence", ""))

    def with_covariances(self) -> "Record":
        """Itself, the covariances of all variables at hand: made once, before several ask at a time."""
        for covariances in self.covariances:
            covariances.all  # noqa: B018
        return self

    @property
    def method(self) -> str:
        """How the map was made: 'join' or 'full'."""
        return str(self.report.get("method", "join"))

    @property
    def costs(self) -> list[list[float]]:
        """The objective of each component's last solve, before it and after each step that was taken; empty where
        nothing was solved."""
        ends = [float(part["objective"]) for part in self.report["parts"]]
        taken = [[step.cost for step in history if step.accepted] for history in self.histories]
        return [[*costs, end] if costs else [] for costs, end in zip(taken, ends, strict=True)]


def robot_sightings(dataset: Dataset) -> IntArray:
    """Who saw whom: observer's and observed robot's pose keys (n, 2)."""
    pairs = [t.keys for t in dataset.tables if t.observes_robots]
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), np.int64)
