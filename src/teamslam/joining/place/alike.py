"""Many small tables as few: a truss looks at all its rows some dozens of times, and a look at a table takes the same
time whether it has one row or a hundred."""

from collections.abc import Hashable, Sequence

import numpy as np

from teamslam.model import Table


def kind_of(table: Table) -> Hashable:
    """The same for tables whose rows can stand in one: of one model and loss, by a sensor that is mounted alike."""
    sensor = table.sensor
    mount = None if sensor is None else (sensor.dim, sensor.rotation.tobytes(), sensor.translation.tobytes())
    return table.model, table.dim, table.loss, mount


def together(tables: Sequence[Table]) -> Table:
    """The rows of tables of one kind one after the other, whoever measured them."""
    first = tables[0]
    if len(tables) == 1:
        return first
    whitening = [np.broadcast_to(t.whitening, (len(t), *t.whitening.shape[1:])) for t in tables]
    return Table(
        0, first.source, first.model, first.dim,
        np.concatenate([t.keys for t in tables]),
        np.concatenate([t.values for t in tables]),
        np.concatenate(whitening),
        np.arange(sum(map(len, tables))),
        first.sensor, first.loss,
    )  # fmt: skip
