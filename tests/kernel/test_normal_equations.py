"""A table by itself is linearised as a problem of that table alone, for every sensor, loss and pair of kinds."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.errors import ModelError
from teamslam.model import LOSSES, MODELS, Dataset, Loss, Model, Table
from teamslam.solver import System, normal_equations
from worlds import WORLDS, mixed_team, team


def tables_of(world: str) -> list[tuple[Dataset, Table]]:
    log = mixed_team() if world == "mixed" else team(world, robots=2, poses=6)
    return [(log, table) for table in log.tables]


def check(log: Dataset, table: Table, rng: np.random.Generator) -> None:
    assert log.truth is not None
    known = log.truth.only(np.unique(table.keys))
    values = known.retract(rng.normal(scale=0.05, size=known.layout.dof))
    expected = System(values.layout, tables=[table]).linearise(values)
    order = rng.permutation(len(values))
    keys, kinds = values.layout.keys[order], values.layout.kinds[order]
    state = np.concatenate([values.only([key]).state for key in keys])
    cost, H, g = normal_equations(table, keys, kinds, state)
    columns = values.layout.unknowns(keys)
    assert cost == pytest.approx(expected.cost, rel=1e-12)
    np.testing.assert_allclose(g, expected.gradient[columns], rtol=1e-9, atol=1e-9 * np.abs(g).max())
    whole = expected.hessian.to_csr().toarray()[np.ix_(columns, columns)]
    np.testing.assert_allclose(H, whole, rtol=1e-9, atol=1e-9 * np.abs(H).max())


@pytest.mark.parametrize("world", [*WORLDS, "mixed"])
@pytest.mark.parametrize("loss", LOSSES)
def test_it_is_what_a_system_gives_in_any_order_of_variables(world: str, loss: str) -> None:
    rng = np.random.default_rng(0)
    for log, table in tables_of(world):
        check(log, table.with_loss(Loss(loss, 1.5)), rng)


def test_a_sensor_that_people_added_is_linearised_too(monkeypatch: pytest.MonkeyPatch) -> None:
    built_in = MODELS["point"]
    own = Model(built_in.predict, built_in.minus, built_in.size, built_in.rows)
    monkeypatch.setitem(MODELS, "own", own)
    for log, table in tables_of("planar"):
        if table.model == "point":
            check(log, replace(table, model="own", loss=Loss("huber", 1.5)), np.random.default_rng(1))


def test_what_does_not_fit_is_refused() -> None:
    log, table = next((log, table) for log, table in tables_of("2d") if table.model == "point")
    assert log.truth is not None
    known = log.truth.only(np.unique(table.keys))
    with pytest.raises(ModelError, match="state"):
        normal_equations(table, known.layout.keys, known.layout.kinds, known.state[:-1])
    with pytest.raises(ModelError):
        normal_equations(table, known.layout.keys, np.zeros_like(known.layout.kinds), np.tile(known.state, 3))
