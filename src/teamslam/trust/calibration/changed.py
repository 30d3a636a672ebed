"""Rows put right: what `estimate` found, applied to the measurements themselves.

    z'   =  z (-) sum_j p_j effect_j(h)          systematic errors taken out, at the prediction of the map
    W'   =  W / scale                            each row as it is alone, for its loss to judge
    W''  =  w^1/2 W' / temper                    each row by what it counts beside the others

w is what the row's loss weighs it by where the map goes when the log is put right, and stays as it is: rows that are
weighed so are under no loss, and their map is found in a few steps. Rows keep their ids, so a log that was put right is
cut, built, joined and sent as any other.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Names, Table, Values
from teamslam.model.losses import SQUARED
from teamslam.model.sparse import sp
from teamslam.trust.calibration.rows import linearised
from teamslam.trust.calibration.successive import Successive
from teamslam.trust.calibration.systematic import Systematic


@dataclass(frozen=True, eq=False)
class Change:
    """What is to be changed of the rows of one sensor: `rows`, by rising ids, with the noise that they have; `shift`
    (m, residual rows) to be taken out of their measurements, by how much they are to be `temper`-ed (m, residual rows),
    what their loss weighs them by (m,), and what those that follow each other say of how they differ (`successive`)."""

    rows: Table
    shift: Array
    temper: Array
    weight: Array
    successive: Successive

    def of(self, table: Table) -> bool:
        """Whether it is about this table's rows."""
        mine = self.rows
        return (mine.robot, mine.kind) == (table.robot, table.kind)

    def further(self, errors: Iterable[tuple[Systematic, float]], tables: Iterable[Table]) -> "Change":
        """The same with so much more of each error taken out of those of its rows that are in `tables`."""
        ids = [table.ids for table in tables if self.of(table)]
        effects = [amount * effect for error, amount in errors if (effect := error.on(self.rows)) is not None]
        if not effects or not ids:
            return self
        inside = np.isin(self.rows.ids, np.concatenate(ids))
        return replace(self, shift=self.shift + sum(effects) * inside[:, None])

    def apply(self, table: Table, *, weigh: bool) -> Iterator[Table]:
        """The table's rows put right, each as it is alone, or, to `weigh` them, by what it counts. Rows that nothing is
        known of stay as they are."""
        at = np.minimum(np.searchsorted(self.rows.ids, table.ids), len(self.rows.ids) - 1)
        known = self.rows.ids[at] == table.ids
        if not known.all():
            yield table.select(~known)
            table, at = table.select(known), at[known]
        if not len(table):
            return
        right = replace(
            table,
            values=table.row.plus(table.values, -self.shift[at], table.dim),
            whitening=self.rows.whitening[at],
        )
        if weigh:
            root = np.sqrt(self.weight[at])[:, None, None] / self.temper[at][:, None, :]
            right = replace(right, whitening=root * right.whitening, loss=SQUARED)
        yield right


def differing(table: Table, changes: Sequence[Change]) -> sp.csr_array | None:
    """What takes errors (m r,) of rows that were put right to how those that follow each other differ, in deviations;
    None where they say nothing of it."""
    found = []
    for change in changes:
        if change.of(table) and len(change.successive.root):
            order = np.argsort(table.ids)
            ids = table.ids[order]
            at = np.minimum(np.searchsorted(ids, change.rows.ids), len(ids) - 1)
            places = np.where(ids[at] == change.rows.ids, order[at], -1)
            mine = change.successive.among(places)
            if len(mine.root):
                whitening = np.zeros((len(table), *change.rows.whitening.shape[1:]))
                there = places >= 0
                whitening[places[there]] = np.sqrt(change.weight[there])[:, None, None] * change.rows.whitening[there]
                found.append(mine.whitened(whitening))
    return sp.csr_array(sp.vstack(found)) if found else None


def beyond(
    tables: Iterable[Table], changes: Sequence[Change], values: Values, held: IntArray, names: Names
) -> tuple[sp.csr_array, Array, float] | None:
    """What rows that were put right, at `values` of which some are `held`, say beyond each alone, by how those that
    follow each other differ: J'D'DJ over the rest (n, n), J'D'De (n,) and |De|^2. None where they say nothing of it."""
    told = [(table, differ) for table in tables if (differ := differing(table, changes)) is not None]
    if not told:
        return None
    parts = []
    linear = linearised([table for table, _ in told], values, held, names)
    for (_, differ), (error, jacobian) in zip(told, linear, strict=True):
        along, left = differ @ jacobian, differ @ error.ravel()
        parts.append((along.T @ along, along.T @ left, float(left @ left)))
    information, slope, cost = zip(*parts, strict=True)
    return sp.csr_array(sum(information)), np.sum(slope, 0), sum(cost)


def put_right(tables: Iterable[Table], changes: Sequence[Change], *, weigh: bool = True) -> list[Table]:
    """The tables of a log with all changes made."""
    out = list(tables)
    for change in changes:  # a sensor has one for each of its tables, which tell their rows by ids
        out = [new for old in out for new in (change.apply(old, weigh=weigh) if change.of(old) else [old])]
    return out
