"""Whether the model fits the data: what a map costs beside what it should, in all and part by part.

    fits      the cost lies where it should, to within chance or a tenth
    loose     it is much lower: the standard deviations look too large, and so do the covariances
    strained  it is higher, as on many real logs: outliers, errors that are correlated, sigmas that are a bit small
    misfit    it plainly does not fit: the map is not to be trusted
    unknown   nobody can say: no measurement to spare, or no rows at hand

A misfit is one of three things, none of which an honest log with poor sigmas comes near: the cost is more than GROSS
times what is expected (residuals three times as large as stated, on the whole); of some sensor of a robot more than
half of the rows are farther off than one in a thousand should be; or a cause was found, which is a mistake in the log
and not in its sigmas. What a join's own approximation adds to the cost is never held against the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining import AtMap, Joined
from teamslam.model import Dataset, Names, chi2_quantile
from teamslam.trust.carriers import Share, carriers, sensor_shares
from teamslam.trust.cause import Cause
from teamslam.trust.noise import Noise, noise_of
from teamslam.trust.residuals import Residuals, Rows, residuals_at
from teamslam.trust.tally import PROBABILITY, kind_of, whole

GROSS = 9.0
NEAR = 0.1  # a difference of the cost that is of no matter, however sure it is
LOOSE = 0.67  # of the expected cost
FEWEST = 10  # rows of a sensor that can be refused


@dataclass(frozen=True, eq=False)
class Verdict:
    """How well a map fits the log that it was made of; `level` is one of those above.

    `cost` (sum of losses) beside what is `expected` and the `band` in which it lies 999 times of 1000 if the model is
    right; `chi2` counts outliers in full, `dof` is numbers measured - unknowns; `decrease` is what a step to full least
    squares would still take off, a join's own part of the cost. `sensors` are all parts by robot, source and model;
    `carriers` what carries the excess, the most first: sensors, landmarks, stretches of time. `parts` are the residuals
    by component. `reason` says why nothing is known, where that is so.
    """

    level: str
    cost: float
    expected: float
    band: tuple[float, float]
    chi2: float
    dof: int
    decrease: float
    sensors: tuple[Share, ...] = ()
    carriers: tuple[Share, ...] = ()
    noise: tuple[Noise, ...] = ()
    causes: tuple[Cause, ...] = ()
    parts: tuple[Residuals, ...] = ()
    names: Names = field(default_factory=Names)
    reason: str = ""

    @property
    def gross(self) -> bool:
        """True where the map is not to be trusted."""
        return self.level == "misfit"

    @property
    def rows(self) -> tuple[Rows, ...]:
        """The residuals of all components, table by table."""
        return tuple(row for part in self.parts for row in part.rows)


def verdict(dataset: Dataset, joined: Joined, at: Sequence[AtMap] | None = None) -> Verdict:
    """How well a team's map fits the log that it was made of.

    Rows of variables that the map does not hold are left out; `at`, the log at each component's map, saves linearising
    it again. Law: for the squared loss and a right model `cost` is distributed as chi-square with `dof` degrees of
    freedom where the map is that of full least squares.
    """
    at = at or [AtMap(dataset.tables, component.map) for component in joined.components]
    try:
        parts = tuple(map(residuals_at, at))
    except SolveError as error:
        return unknown(f"the measurements themselves do not determine the map: {error}")
    rows = [row for part in parts for row in part.rows]
    dof = sum(int(row.numbers.sum()) for row in rows) - sum(part.unknowns for part in parts)
    if dof < 1:
        return unknown("every number measured was needed to make the map, and none is left to check it")
    return _judged(parts, rows, dof, dataset.names)


def unknown(reason: str) -> Verdict:
    """The verdict where there is none."""
    none = float("nan")
    return Verdict("unknown", none, none, (none, none), none, 0, 0.0, reason=reason)


def _judged(parts: tuple[Residuals, ...], rows: Sequence[Rows], dof: int, names: Names) -> Verdict:
    total = whole(rows)
    cost, expected = float(total.cost[0]), float(total.expected[0])
    low, high = (float(end[0]) for end in total.band)
    decrease = min(sum(part.decrease for part in parts), max(cost - expected, 0.0))
    level = "misfit" if refused(rows) else _level(cost - decrease, expected, (low, high))
    return Verdict(
        level=level,
        cost=cost,
        expected=expected,
        band=(low, high),
        chi2=float(sum(np.sum(row.squared) for row in rows)),
        dof=dof,
        decrease=decrease,
        sensors=tuple(sensor_shares(rows, names)),
        carriers=tuple(carriers(rows, names)) if level in ("strained", "misfit") else (),
        noise=tuple(noise_of(rows)),
        parts=parts,
        names=names,
    )


def _level(cost: float, expected: float, band: tuple[float, float]) -> str:
    if cost > max(GROSS * expected, band[1]):
        return "misfit"
    if cost < LOOSE * expected and cost < band[0]:
        return "loose"
    return "strained" if cost > max(band[1], (1.0 + NEAR) * expected) else "fits"


def refused(rows: Sequence[Rows]) -> list[tuple[int, str, str]]:
    """The sensors (robot, source, model) of which more than half of the rows are farther off than one in a thousand
    should be."""
    found = []
    for kind, group in groupby(sorted(rows, key=kind_of), kind_of):
        far = np.concatenate([r.squared > chi2_quantile(PROBABILITY, r.numbers) for r in group])
        if len(far) >= FEWEST and np.mean(far) > 0.5:
            found.append(kind)
    return found
