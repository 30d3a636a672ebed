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

from teamslam.geometry import Array
from teamslam.model import Table
from teamslam.model.losses import SQUARED


@dataclass(frozen=True, eq=False)
class Change:
    """What is to be changed of the rows of one sensor: `rows`, by rising ids, with the noise that they have; `shift`
    (m, residual rows) to be taken out of their measurements, by how much they are to be `temper`-ed (m, residual rows),
    and what their loss weighs them by (m,)."""

    rows: Table
    shift: Array
    temper: Array
    weight: Array

    def of(self, table: Table) -> bool:
        """Whether it is about this table's rows."""
        mine = self.rows
        return (mine.robot, mine.kind) == (table.robot, table.kind)

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


def put_right(tables: Iterable[Table], changes: Sequence[Change], *, weigh: bool = True) -> list[Table]:
    """The tables of a log with all changes made."""
    out = list(tables)
    for change in changes:  # a sensor has one for each of its tables, which tell their rows by ids
        out = [new for old in out for new in (change.apply(old, weigh=weigh) if change.of(old) else [old])]
    return out
