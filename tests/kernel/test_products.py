"""Products with Jacobians that are never stored: the same as with those that are, in space and plane, sorted or not."""

import numpy as np
import pytest

from teamslam.errors import ModelError
from teamslam.joining import AtMap, full
from teamslam.sim import PRESETS, simulate


@pytest.fixture(scope="module", params=["2d", "planar", "3d", "tags", "mixed"])
def at(request: pytest.FixtureRequest) -> AtMap:
    options = PRESETS[request.param]
    log = simulate(options, 3)
    return AtMap(log.tables, full(log).map)


def test_a_product_is_that_with_the_jacobian(at: AtMap) -> None:
    system, rng = at.gap.system, np.random.default_rng(0)
    steps = rng.standard_normal((system.free.dof, 3))
    whitened = [rng.standard_normal((len(t), t.row.residual_rows(t.dim), 3)) for t in at.tables]
    jacobians = [system.jacobian(k, at.values) for k in range(len(at.tables))]
    for made, jacobian in zip(system.along(at.values, steps), jacobians, strict=True):
        assert np.allclose(made.reshape(-1, 3), jacobian @ steps, rtol=1e-12, atol=1e-9)
    pulled = sum(j.T @ u.reshape(-1, 3) for j, u in zip(jacobians, whitened, strict=True))
    assert np.allclose(system.pull(at.values, whitened), pulled, rtol=1e-12, atol=1e-9)
    assert np.array_equal(system.pull(at.values, iter(whitened)), system.pull(at.values, whitened))


def test_shapes_that_do_not_fit_are_refused(at: AtMap) -> None:
    problem, state = at.gap.system._problem, at.values.state
    handle = at.gap.system._handles[0]
    with pytest.raises(ModelError, match="y"):
        problem.along(state, handle, np.zeros((1, 2)))
    with pytest.raises(ModelError, match="sums"):
        shape = problem.residuals(state, handle).shape
        problem.pull(state, handle, np.zeros((*shape, 2)), np.zeros((1, 2)))
