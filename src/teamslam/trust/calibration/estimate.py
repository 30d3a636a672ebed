"""What is wrong with the model of the data, estimated from the data: see docs/calibration.md.

At a map all rows are linearised once (`rows`). Where something looks wrong at all (`screen`), what is wrong with their
noise is looked for in a few sweeps (`search`); the last fit, by that noise, tells the systematic errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.joining import AtMap
from teamslam.trust.calibration.changed import Change
from teamslam.trust.calibration.drawn import white_noise
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.posterior import Fit
from teamslam.trust.calibration.rows import Linear, is_sighting, lasting_of, linear_at
from teamslam.trust.calibration.screen import suspicious
from teamslam.trust.calibration.search import Kinds, Search
from teamslam.trust.calibration.slips import Slips
from teamslam.trust.calibration.successive import Successive
from teamslam.trust.calibration.systematic import Systematic

FEWEST = 10  # numbers to spare, from which something may be told


@dataclass(frozen=True, eq=False)
class Estimate:
    """What was found at a map: of each table of `linear` the `scales` (rows,) of its deviations and the `tempers`
    (m, rows) of its rows, and the noise that they have (`now`, not tempered); `kinds` the persistence of each part by
    kind of rows; `theta` of slips; the last `fit`."""

    linear: Linear
    scales: tuple[Array, ...]
    tempers: tuple[Array, ...]
    now: tuple[Noise, ...]
    kinds: Kinds
    theta: Array
    fit: Fit

    @property
    def nothing(self) -> bool:
        """Whether the data show nothing wrong."""
        scaled = any((scale != 1.0).any() for scale in self.scales)
        lasting = any(not part.nothing for parts in self.kinds.values() for part in parts)
        return not (scaled or lasting or self.theta.any() or len(self.fit.choice.inside))


def estimate(at: AtMap) -> Estimate | None:
    """What is wrong with the model of the rows at a map; None where nothing looks like it. Raises SolveError where they
    do not determine it, or nothing is measured that the map does not take up."""
    if sum(table.dof for table in at.tables) - at.gap.free.dof < FEWEST:
        raise SolveError("too little is measured twice for the measurements to be told from their errors")
    if not suspicious(at):
        return None
    search, fit = searched(linear_at(at))
    return Estimate(
        search.linear, tuple(search.scales), tuple(search.tempers), tuple(search.now), search.lasting, search.theta, fit
    )


def searched(linear: Linear) -> tuple[Search, Fit]:
    """What is wrong with the noise of rows, looked for, and the last fit, whether anything looks wrong or not."""
    stated = [Noise.stated(table) for table in linear.tables]
    slips = [Slips.of(table, lasting_of(table, linear.names)) for table in linear.tables]
    search = Search(linear, stated, slips, white_noise(linear))
    return search, search.sweep()


def systematic_of(found: Estimate) -> list[Systematic]:
    """The systematic errors that were found."""
    sigmas = np.sqrt(np.diag(found.fit.covariance))
    robots = len({found.linear.tables[c.table].robot for c in found.fit.inside})
    relative = sum(c.term.relative for c in found.fit.inside)
    out = []
    for column, value, sigma, tau in zip(found.fit.inside, found.fit.values, sigmas, found.fit.choice.tau, strict=True):
        table, term, size = found.linear.tables[column.table], column.term, column.size
        order = np.argsort(table.ids)
        if term.relative:  # sensors of one robot may have theirs in common: as many are known as there are robots
            tau *= np.sqrt(relative / robots)
        out.append(
            Systematic(
                table.robot, *table.kind, term.name, term.unit, float(value * size),
                float(sigma * size), float(tau * size), table.ids[order], column.effect[order],
                column.landmark,
            )
        )  # fmt: skip
    return out


def changes_of(found: Estimate, systematic: Sequence[Systematic]) -> list[Change]:
    """What is to be changed of each table."""
    out = []
    left = found.linear.by_tables(found.fit.left(found.linear.errors[:, None]))
    for table, noise, temper, rest in zip(found.linear.tables, found.now, found.tempers, left, strict=True):
        order = np.argsort(table.ids)
        sorted_rows = table.select(order)
        effects = [(error.value, error.on(sorted_rows)) for error in systematic]
        shift = sum((value * e for value, e in effects if e is not None), np.zeros_like(temper))
        now = replace(sorted_rows, whitening=noise.all_whitening[order])
        held = found.kinds.get(table.kind, ()) if is_sighting(table) else ()
        if any(each.sharp for each in held):
            successive = Successive.of(sorted_rows, found.linear.names, held)
        else:
            successive = Successive.none(temper.shape[1])
        out.append(Change(now, shift, temper[order], noise.weights(rest)[order, 0], successive))
    return out
