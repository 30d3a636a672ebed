"""What every measurement leaves at a map: its whitened residual, its weight, and how much of it the map took up.

At a map's estimate all rows are linearised together, H = sum w A'A with the weights of their losses. Of a row with
residual u the map can follow the part that A spans; its leverage h = w tr(A H^-1 A') says how many of its numbers went
into the estimate, and all leverages add up to the unknowns. What is left of the row has a variance of 1 - h a number.

The leverages come from draws y of covariance H^-1 (white noise through the factor, see `Covariances.draws`), as
h = mean |w^1/2 A y|^2: no Jacobian is kept, no inverse, and as many draws as the log is small. A problem with no more
unknowns than draws gets the unit matrix for the noise, and its leverages are exact; of a sum of leverages that is large
the error is sqrt(2 / draws / sum) of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.answers.residuals import observers
from teamslam.geometry import Array, IntArray
from teamslam.joining import AtMap, Cost
from teamslam.model import Table, Values, chi2_quantile
from teamslam.solver import System
from teamslam.trust.expected import expected_cost

MOST_DRAWS, LEAST_DRAWS = 32, 4
NUMBERS_DRAWN = 200_000  # by all draws together, about: enough for a per cent of any sum that matters


def beside_median(squared: Array, ranks: IntArray) -> Array:
    """Squared residuals (m,) of rows of so many numbers (m,), over what their median should be."""
    return np.asarray(squared / chi2_quantile(0.5, np.maximum(ranks, 1)))


@dataclass(frozen=True, eq=False)
class Rows:
    """m rows of one table at a map.

    `whitened` (m, r) and `weight` (m,) by the loss; `leverage` (m,) of r; `followed` (r,) is the share of the variance
    of each part (see `in_parts`) that the map took up, over all rows; `given_way` is by how much the cost falls for
    each unit of leverage.
    """

    table: Table
    whitened: Array
    weight: Array
    leverage: Array
    followed: Array
    given_way: float

    def __repr__(self) -> str:
        return f"Rows({self.table!r})"

    def __len__(self) -> int:
        return len(self.table)

    @cached_property
    def numbers(self) -> IntArray:
        """How many numbers each row measures (m,): a row of zeros in its whitening measures nothing."""
        return self.table.ranks

    @cached_property
    def squared(self) -> Array:
        """s = |u|^2 (m,)."""
        return np.asarray(np.sum(self.whitened**2, -1))

    @cached_property
    def typical(self) -> Array:
        """s over what its median should be (m,)."""
        return beside_median(self.squared, self.numbers)

    @cached_property
    def cost(self) -> Array:
        """rho(s) (m,)."""
        return self.table.loss.cost(self.squared)

    @cached_property
    def expected(self) -> Array:
        """What they cost on average if the model is right (m,); of one row alone it may be below zero, as its leverage
        is estimated."""
        return self._by_numbers("mean") - self.given_way * self.leverage

    @cached_property
    def variance(self) -> Array:
        """Of the cost, if the model is right (m,); on the high side, as residuals that share an unknown vary less."""
        return self._by_numbers("variance") * np.maximum(1.0 - self.leverage / self.numbers, 0.0)

    @cached_property
    def parts(self) -> Array:
        """The residuals in the units of the measurement, each part divided by its own standard deviation (m, r)."""
        return in_parts(self.whitened, unwhitening(self.table))

    def _by_numbers(self, name: str) -> Array:
        """A field of what is expected of each row (m,)."""
        known, which = np.unique(self.numbers, return_inverse=True)
        return np.array([getattr(expected_cost(self.table.loss, int(n)), name) for n in known])[which]

    @property
    def observers(self) -> IntArray:
        """The robot's own pose that each row was taken from (m,), the later of two; 0 where there is none."""
        return observers(self.table)


@dataclass(frozen=True, eq=False)
class Residuals:
    """All rows at a map, table by table. `unknowns` of the map; `decrease` of the cost that a step from there to full
    least squares promises (a join is near it); `draws` that leverages were estimated with."""

    rows: tuple[Rows, ...]
    unknowns: int
    decrease: float
    draws: int

    def __repr__(self) -> str:
        return f"Residuals({sum(map(len, self.rows)):,} rows of {len(self.rows)} tables, {self.unknowns:,} unknowns)"

    @property
    def cost(self) -> Cost:
        """What the rows cost together."""
        return Cost(
            cost=sum(float(row.cost.sum()) for row in self.rows),
            chi2=sum(float(row.squared.sum()) for row in self.rows),
            rows=sum(int(row.numbers.sum()) for row in self.rows),
        )


def residuals_at(at: AtMap) -> Residuals:
    """What the rows of a log leave at a map. Rows of variables that it does not hold are left out.

    Raises SolveError where the rows at hand do not determine the map.
    """
    values, held, gap, system = at.values, at.tables, at.gap, at.gap.system
    errors = gap.factor.draws(white_noise(system.free.dof))
    whitened = [system.whitened(place, values) for place in range(len(held))]
    weights = [table.loss.weight(np.sum(u**2, -1)) for table, u in zip(held, whitened, strict=True)]
    leverages, followed = _taken_up(system, values, weights, errors)
    leverages = _adding_up_to(system.free.dof, leverages, held, errors.shape[1] >= system.free.dof)
    ways = _given_way(held, leverages)
    rows = tuple(map(Rows, held, whitened, weights, leverages, followed, ways))
    return Residuals(rows, system.free.dof, gap.decrease, errors.shape[1])


def white_noise(unknowns: int) -> Array:
    """Columns whose covariance is the unit matrix, on average: the same ones every time."""
    draws = int(np.clip(NUMBERS_DRAWN // max(unknowns, 1), LEAST_DRAWS, MOST_DRAWS))
    if unknowns <= draws:
        return np.asarray(np.sqrt(unknowns) * np.eye(unknowns))
    return np.random.default_rng(0).standard_normal((unknowns, draws))


def _taken_up(
    system: System, values: Values, weights: Sequence[Array], errors: Array
) -> tuple[list[Array], list[Array]]:
    """The leverage of every row, and the share of each part's variance that the estimate followed, by table."""
    leverages, followed = [], []
    for table, weight, ahead in zip(system.tables, weights, system.along(values, errors), strict=True):
        squares = ahead**2
        h = np.mean(np.sum(squares, 1), -1)
        back = unwhitening(table)
        if back is not None:
            squares = (back @ ahead) ** 2
        squared = table.loss.name == "squared"
        leverages.append(h if squared else weight * h)
        followed.append(np.mean((squares if squared else weight[:, None, None] * squares), (0, 2)))
    return leverages, followed


def _adding_up_to(unknowns: int, leverages: Sequence[Array], tables: Sequence[Table], exact: bool) -> list[Array]:
    """Leverages that add up to the unknowns, as the trace of H^-1 A'A must: without what draws add to it by chance, or
    rounding where a step meets a stiff row. Exact ones lie between nothing and the numbers of their row."""
    leverages = [np.nan_to_num(h) for h in leverages]
    if exact:
        leverages = [np.clip(h, 0.0, table.ranks) for h, table in zip(leverages, tables, strict=True)]
    total = sum(float(h.sum()) for h in leverages)
    return [h * (unknowns / total) for h in leverages] if total > 0.0 else leverages


def _given_way(tables: Sequence[Table], leverages: Sequence[Array]) -> list[float]:
    """By how much the cost of each table falls for a unit of its leverage.

    A table's own noise drew the estimate by its own beta / kappa (see `expected`), twice; against that, the estimate
    moved by the noise of all tables, whose mean over the leverages is paid back. They add up to what is stated there.
    """
    own = [expected_cost(t.loss, t.row.residual_rows(t.dim)).given_way for t in tables]
    sums = [float(h.sum()) for h in leverages]
    mean = sum(o * h for o, h in zip(own, sums, strict=True)) / max(sum(sums), 1e-12)
    return [2.0 * o - mean for o in own]


def unwhitening(table: Table) -> Array | None:
    """What turns whitened residuals W e into e, each part divided by its own standard deviation (m or 1, r, r); None
    where these are the same."""
    if not np.any(table.whitening - table.whitening * np.eye(table.whitening.shape[-1])):
        return None
    whole = bool((table.ranks == table.whitening.shape[-1]).all())
    back = np.linalg.inv(table.whitening) if whole else np.linalg.pinv(table.whitening)
    sigma = np.sqrt(np.sum(back**2, -1, keepdims=True))
    return np.asarray(back / np.where(sigma > 0.0, sigma, 1.0))


def in_parts(whitened: Array, back: Array | None) -> Array:
    """Whitened residuals by parts: each in its own standard deviation."""
    return whitened if back is None else np.asarray((back @ whitened[..., None])[..., 0])
