"""A log by a change of names: the rows of one robot that call a landmark otherwise than the team does."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from teamslam.model import Dataset, Names, Table, index_of, is_landmark
from teamslam.trust.labels.changes import Change


@dataclass(frozen=True)
class Renaming:
    """Called with a log it gives it by a `change` of names.

    Law: rows, their numbers and their weights stay as they are, in their order; an exchange twice is no exchange.
    """

    change: Change

    def __call__(self, log: Dataset) -> Dataset:
        """The log with the names as they should be."""
        tables = tuple(table_by(self.change, table) for table in log.tables)
        return replace(log, tables=tables, names=names_by([self.change], log.names))


def table_by(change: Change, table: Table) -> Table:
    """A table by a change; the same where it does not concern it."""
    target = table.keys[:, -1]
    if table.robot != change.robot or not np.isin(target, list(change.names)).any():
        return table
    keys = table.keys.copy()
    keys[:, -1] = [change.names.get(key, key) for key in target.tolist()]
    return replace(table, keys=np.where(is_landmark(table.keys), keys, table.keys))


def names_by(changes: Iterable[Change], names: Names) -> Names:
    """Names with one for each landmark that was given a key of its own."""
    called = dict(names.landmarks)
    for change in changes:
        if change.kind == "apart":
            one = names.landmark(int(index_of(change.one)))
            called[int(index_of(change.other))] = f"{one} as robot {names.robot(change.robot)} sees it"
    return replace(names, landmarks=called) if len(called) > len(names.landmarks) else names
