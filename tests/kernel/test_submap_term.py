"""A submap as one measurement: cost, g and H against the dense formulas; a term of its tables' own making is them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kernel.formulas import (
    DOFS,
    NUMBERS,
    POINT2,
    POINT3,
    POSE2,
    POSE3,
    Variables,
    add_row,
    compose,
    dense,
    derivative,
    lift,
    minus,
    on_pattern,
    random_variable,
    retract,
    rotation,
    split,
)
from teamslam.errors import ModelError
from teamslam.kernel import BlockPattern, Problem


def in_frame(base, kind, x):
    """X_b^-1 X: a variable seen from the base, as an estimate of the given kind."""
    if kind in (POINT2, POINT3):
        d = NUMBERS[kind]
        T, R = split(base if d == 2 else lift(base))
        return R.T @ (place_of(x, d) - T)
    if kind == POSE3:
        base, x = lift(base), lift(x)
    T, R = split(base)
    return compose(np.concatenate([-R.T @ T, R.T.ravel()]), x)


def place_of(x, d):
    """Where a variable is, in d dimensions: a pose's place, at height 0 in the plane, or a shadow there."""
    own = x[: 2 if len(x) in (NUMBERS[POSE2], NUMBERS[POINT2]) else 3]
    return np.concatenate([own, np.zeros(3)])[:d]


def identity(dim):
    return np.concatenate([np.zeros(dim), np.eye(dim).ravel()])


@st.composite
def submaps(draw):
    """A random submap over some of a problem's variables, in random order, with a block-sparse information."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    plane = draw(st.booleans())
    base_kind = draw(st.sampled_from([None, POSE2] if plane else [None, POSE2, POSE3]))
    # In space with a planar base: planar variables have estimates in space.
    kinds = rng.choice([POSE2, POINT2] if plane else [POSE2, POSE3, POINT3], draw(st.integers(2, 8)))
    if base_kind is not None:
        kinds = np.append(kinds, base_kind)
    n = len(kinds)
    variables = Variables(kinds, rng.random(n) < 0.2)
    base = -1 if base_kind is None else n - 1
    members = rng.permutation(n if base < 0 else n - 1)[: draw(st.integers(1, n - 1))]
    if base >= 0 and draw(st.booleans()):  # the base may come anywhere in the order of the unknowns
        order = rng.permutation(n)
        variables = Variables(kinds[order], variables.fixed[order])
        members, base = np.argsort(order)[members], int(np.argsort(order)[base])
    own_kinds = np.where(variables.kinds[members] == POSE2, POSE2 if plane else POSE3, variables.kinds[members])
    # Whatever has a place may have a point for its estimate, in the plane or in space.
    points = [POINT2] if plane else [POINT2, POINT3] if base_kind in (None, POSE2) else [POINT3]
    own_kinds = np.where(rng.random(len(members)) < 0.3, rng.choice(points, len(members)), own_kinds)
    state = variables.random_state(rng)
    estimate = np.concatenate([random_variable(rng, kind) for kind in own_kinds])
    dofs = np.array([DOFS[k] for k in own_kinds])
    pairs = rng.integers(0, len(members), (2, draw(st.integers(0, 2 * len(members)))))
    pattern = BlockPattern.from_pairs(dofs, *pairs)
    information = rng.normal(size=(dofs.sum(), dofs.sum()))
    values = on_pattern(pattern, information + information.T)
    eta = rng.normal(size=dofs.sum()) if draw(st.booleans()) else None
    return variables, state, base, members, own_kinds, estimate, pattern, values, eta


def error_of(variables, state, base, members, own_kinds, estimate):
    ends = np.cumsum([NUMBERS[k] for k in own_kinds])
    out = []
    for v, kind, s in zip(members, own_kinds, np.split(estimate, ends[:-1]), strict=True):
        frame = variables.of(state, base) if base >= 0 else identity(2 if kind in (POSE2, POINT2) else 3)
        out.append(minus(s, in_frame(frame, kind, variables.of(state, v))))
    return np.concatenate(out)


@given(submaps())
def test_term_agrees_with_the_dense_formulas(case):
    variables, state, base, members, own_kinds, estimate, pattern, values, eta = case
    problem = Problem(variables.kinds, variables.fixed)
    problem.add_submap(base, members, own_kinds, estimate, pattern, values, eta)
    cost, g, H = problem.linearise(state)

    I = dense(pattern, values)
    slope = np.zeros(len(I)) if eta is None else eta
    e = error_of(variables, state, base, members, own_kinds, estimate)
    np.testing.assert_allclose(cost, e @ I @ e + 2 * slope @ e, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(problem.cost(state), cost, rtol=1e-13)

    everyone = np.append(members, base) if base >= 0 else members
    ends = np.cumsum([DOFS[variables.kinds[v]] for v in everyone])

    def moved(d):
        new = state.copy()
        for v, part in zip(everyone, np.split(d, ends[:-1]), strict=True):
            new[variables.offsets[v] : variables.offsets[v + 1]] = retract(
                variables.kinds[v], variables.of(state, v), part
            )
        error = error_of(variables, new, base, members, own_kinds, estimate)
        return error if np.abs(error - e).max() < 1.0 else np.full_like(e, np.nan)

    A = -derivative(moved, int(ends[-1]))
    if not np.isfinite(A).all():
        return  # a rotation too near to a half turn for differences
    n = variables.dof_start[-1]
    expected_H, expected_g = np.zeros((n, n)), np.zeros(n)
    add_row(variables, everyone, A, I @ e + slope, I @ A, expected_H, expected_g)
    scale = 1 + np.abs(I).max() * np.abs(A).max() ** 2 * (1 + np.abs(e).max())
    np.testing.assert_allclose(g, expected_g, atol=1e-8 * scale)
    np.testing.assert_allclose(dense(problem.pattern, H), expected_H, atol=1e-8 * scale)


@given(submaps())
def test_new_numbers_are_as_good_as_a_new_term(case):
    variables, state, base, members, own_kinds, estimate, pattern, values, eta = case
    rng = np.random.default_rng(1)
    old, new = (Problem(variables.kinds, variables.fixed) for _ in range(2))
    other = np.concatenate([random_variable(rng, kind) for kind in own_kinds])
    handle = old.add_submap(base, members, own_kinds, other, pattern, values * 2.0, rng.normal(size=pattern.scalars))
    old.linearise(state)
    old.set_submap(handle, estimate, values, eta)
    new.add_submap(base, members, own_kinds, estimate, pattern, values, eta)
    for a, b in zip(old.linearise(state), new.linearise(state), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_submap_of_one_measurement_is_that_measurement():
    rng = np.random.default_rng(2)
    kinds = np.array([POSE3, POSE3, POINT3])
    state = Variables(kinds, np.zeros(3, bool)).random_state(rng)
    z, p = random_variable(rng, POSE3), rng.normal(size=3)
    W, V = rng.normal(size=(6, 6)), rng.normal(size=(3, 3))
    tables = Problem(kinds)
    tables.add_table("relative_pose", 3, [[0, 1]], z[None], W[None])
    tables.add_table("point", 3, [[0, 2]], p[None], V[None])
    joined = Problem(kinds)
    pattern = BlockPattern.from_pairs([6, 3], [], [])
    I = np.zeros((9, 9))
    I[:6, :6], I[6:, 6:] = W.T @ W, V.T @ V
    joined.add_submap(0, [1, 2], [POSE3, POINT3], np.concatenate([z, p]), pattern, on_pattern(pattern, I))
    for a, b in zip(tables.linearise(state), joined.linearise(state), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11)


def test_joining_ignores_the_choice_of_the_world():
    # All variables moved by one rigid motion: the cost of a submap with a base does not change.
    rng = np.random.default_rng(3)
    kinds = np.array([POSE3, POSE3, POINT3])
    variables = Variables(kinds, np.zeros(3, bool))
    state = variables.random_state(rng)
    motion = np.concatenate([rng.normal(size=3), rotation(rng, 3).ravel()])
    T, R = split(motion)
    moved = np.concatenate(
        [
            compose(motion, variables.of(state, 0)),
            compose(motion, variables.of(state, 1)),
            T + R @ variables.of(state, 2),
        ]
    )
    problem = Problem(kinds)
    pattern = BlockPattern.from_pairs([6, 3], [0], [1])
    root = rng.normal(size=(9, 9))
    estimate = np.concatenate([random_variable(rng, POSE3), rng.normal(size=3)])
    problem.add_submap(0, [1, 2], [POSE3, POINT3], estimate, pattern, on_pattern(pattern, root.T @ root))
    assert problem.cost(moved) == pytest.approx(problem.cost(state), rel=1e-11)


def refused(match, **changes):
    given = dict(
        base=0,
        members=[1, 2],
        kinds=[POSE3, POINT3],
        state=np.concatenate([identity(3), np.zeros(3)]),
        pattern=BlockPattern.from_pairs([6, 3], [0], [1]),
        values=np.ones(36 + 18 + 9),
    )
    problem = Problem([POSE3, POSE3, POINT3, POSE2, POINT2])
    problem.add_submap(**given)
    with pytest.raises(ModelError, match=match):
        problem.add_submap(**(given | changes))


def test_what_does_not_fit_is_refused():
    refused("base is variable 9", base=9)
    refused("base is variable -2", base=-2)
    refused("not a pose", base=2)
    refused("comes twice", members=[1, 0])
    refused("names variable 7", members=[1, 7])
    refused("names variable -1", members=[-1, 2])
    refused("comes twice", members=[1, 1], kinds=[POSE3, POSE3], state=np.tile(identity(3), 2),
            pattern=BlockPattern.from_pairs([6, 6], [0], [1]), values=np.ones(108))  # fmt: skip
    refused("cannot be the estimate", members=[4, 2])
    refused("cannot be the estimate", members=[2, 1])
    refused("from a base in space", members=[4], kinds=[POINT2], state=np.zeros(2),
            pattern=BlockPattern.from_pairs([2], [], []), values=np.ones(4))  # fmt: skip
    refused("kinds", kinds=[1, 7])
    refused("not those of the kinds", kinds=[POSE3, POINT2])
    refused("shape", values=np.ones(5))
    refused("not finite", values=np.full(63, np.nan))
    refused("not finite", state=np.full(15, np.inf))
    refused("rotation", state=np.zeros(15))
    refused("shape", eta=np.zeros(3))
    refused("not finite", eta=np.full(9, np.nan))
    refused("no members", members=[], kinds=[], state=[], pattern=BlockPattern.from_pairs([], [], []), values=[])
