"""Whatever arrays come, the kernel answers with numbers or with a ModelError; it never crashes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from kernel.formulas import POINT2, POINT3, POSE2, POSE3, Variables, measurement
from teamslam.errors import ModelError, SolveError, TeamslamError
from teamslam.kernel import LOSSES, MODELS, BlockPattern, Factor, Problem, set_threads

KINDS = np.array([POSE2, POSE3, POINT2, POINT3, POSE2])
NUMBERS = int(Variables(KINDS, np.zeros(5, bool)).offsets[-1])
STATE = Variables(KINDS, np.zeros(5, bool)).random_state(np.random.default_rng(1))

numbers = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324]), st.floats(width=64)
)
arrays = hnp.arrays(
    st.sampled_from([np.dtype(t) for t in ("f8", "f4", "i8", "u8", "i1", "?", "c16", "U3", "O", ">f8")]),
    hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=6),
)
anything = st.one_of(arrays, st.none(), st.text(max_size=3), st.integers(), st.floats(), st.just([[1], [1, 2]]))


@given(st.data())
def test_any_table(data):
    problem = Problem(KINDS)
    model, dim = data.draw(st.sampled_from(MODELS)), data.draw(st.sampled_from((2, 3)))
    try:
        problem.add_table(
            model,
            dim,
            data.draw(anything),
            data.draw(anything),
            data.draw(anything),
            data.draw(anything),
            data.draw(st.sampled_from(LOSSES)),
            data.draw(numbers),
        )
    except ModelError:
        return
    problem.linearise(STATE)


@settings(max_examples=200)
@given(st.data())
def test_tables_of_the_right_shape_with_any_numbers(data):
    problem = Problem(KINDS)
    model, dim = data.draw(st.sampled_from(MODELS)), data.draw(st.sampled_from((2, 3)))
    rng = np.random.default_rng(data.draw(st.integers(0, 100)))
    keys = 1 if model in ("position", "pose") else 2
    m = data.draw(st.integers(0, 3))
    r = {"relative_pose": 3 * dim - 3, "pose": 3 * dim - 3, "range": 1, "bearing": dim - 1, "corners": 8}.get(
        model, dim
    )
    index = data.draw(hnp.arrays(np.int64, (m, keys), elements=st.integers(-1, 5)))
    z = np.array([measurement(rng, model, dim) for _ in range(m)] or np.zeros((0, 1)))
    if data.draw(st.booleans()) and z.size:
        z.flat[rng.integers(z.size)] = data.draw(numbers)
    whitening = data.draw(hnp.arrays(np.float64, (1, r, r), elements=numbers))
    state = STATE.copy()
    if data.draw(st.booleans()):
        state[rng.integers(len(state))] = data.draw(numbers)
    try:
        handle = problem.add_table(model, dim, index, z, whitening, loss=data.draw(st.sampled_from(LOSSES)))
        _, g, values = problem.linearise(state)
        problem.residuals(state, handle)
        factor = Factor(problem.pattern)
        factor.factor(values)
        problem.retract(state, factor.solve(g))
    except TeamslamError:
        pass


@given(anything, anything)
def test_any_problem(kinds, fixed):
    try:
        problem = Problem(kinds, fixed)
    except ModelError:
        return
    assert problem.pattern.scalars >= 0


@given(anything, anything, st.data())
def test_any_state_step_and_weights(state, delta, data):
    problem = Problem(KINDS)
    handle = problem.add_table("position", 2, [[0], [2]], np.zeros((2, 2)), np.eye(2)[None])
    for call in (
        lambda: problem.cost(state),
        lambda: problem.linearise(state),
        lambda: problem.residuals(state, handle),
        lambda: problem.retract(state, delta),
        lambda: problem.set_weights(handle, delta if delta is not None else "no"),
        lambda: problem.add_blocks(state, 2),
    ):
        with pytest.raises(ModelError):
            call()


@given(anything, anything, anything)
def test_any_pattern(dofs, column_start, row):
    try:
        pattern = BlockPattern(dofs, column_start, row)
    except ModelError:
        return
    if len(pattern.dofs) and pattern.scalars < 1000:
        with pytest.raises(ModelError):
            Factor(pattern).factor(np.zeros(pattern.size + 1))


@given(hnp.arrays(np.float64, 63, elements=numbers), hnp.arrays(np.float64, 9, elements=numbers))
def test_any_numbers_to_factorise(values, damping):
    pattern = BlockPattern.from_pairs([6, 3], [0], [1])
    factor = Factor(pattern)
    try:
        factor.factor(values, damping)
        factor.solve(damping)
        factor.inverse_on_pattern()
    except SolveError:
        pass


@given(anything, anything, anything, anything, anything)
def test_any_submap(members, kinds, state, values, eta):
    problem = Problem(KINDS)
    pattern = BlockPattern.from_pairs([3, 2], [0], [1])
    with pytest.raises(ModelError):
        problem.add_submap(0, members, kinds, state, pattern, values, eta)
    handle = problem.add_submap(0, [4, 2], [POSE2, POINT2], [0, 0, 1, 0, 0, 1, 3, 4], pattern, np.zeros(19))
    with pytest.raises(ModelError):
        problem.set_submap(handle, state, values, eta)


def test_messages_say_what_was_found_and_expected():
    problem = Problem(KINDS)
    eye = np.eye(2)[None]
    cases = [
        ("found 'points', expected one of relative_pose", ("points", 2, [[0, 2]], [[1.0, 2]], eye)),
        ("dimension: found 4", ("point", 4, [[0, 2]], [[1.0, 2]], eye)),
        ("model: found 9", (9, 2, [[0, 2]], [[1.0, 2]], eye)),
        (r"point index: found shape \(2,\), expected \(any, 2\)", ("point", 2, [0, 2], [[1.0, 2]], eye)),
        ("point index: found float64 numbers, expected int64", ("point", 2, [[0.0, 2.0]], [[1.0, 2]], eye)),
        (r"point z: found shape \(1, 3\), expected \(1, 2\)", ("point", 2, [[0, 2]], [[1.0, 2, 3]], eye)),
        ("point z: found complex128", ("point", 2, [[0, 2]], [[1.0, 2j]], eye)),
        (r"whitening: found shape \(2, 2\), expected \(1, 2, 2\)", ("point", 2, [[0, 2]], [[1.0, 2]], eye[0])),
        ("row 0 names variable 7, but there are 5", ("point", 2, [[0, 7]], [[1.0, 2]], eye)),
        ("row 0 names variable -1", ("point", 2, [[0, -1]], [[1.0, 2]], eye)),
        ("row 0: names variable 0 twice", ("point", 2, [[0, 0]], [[1.0, 2]], eye)),
        ("row 0: the measurement is not finite", ("point", 2, [[0, 2]], [[np.nan, 2]], eye)),
        ("no rows", ("point", 2, np.zeros((0, 2), int), np.zeros((0, 2)), eye)),
        (
            "the whitening has a number that is not finite",
            ("point", 2, [[0, 2]], [[1.0, 2]], np.full((1, 2, 2), np.inf)),
        ),
        ("the sensor's pose", ("point", 2, [[0, 2]], [[1.0, 2]], eye, np.ones(6))),
        (r"sensor: found shape \(12,\)", ("point", 2, [[0, 2]], [[1.0, 2]], eye, np.ones(12))),
        ("loss: found 'tukey'", ("point", 2, [[0, 2]], [[1.0, 2]], eye, None, "tukey")),
        ("needs a scale above zero", ("point", 2, [[0, 2]], [[1.0, 2]], eye, None, "huber", 0.0)),
        ("cannot relate pose2 to point2 in 3", ("point", 3, [[0, 2]], [[1.0, 2, 3]], np.eye(3)[None])),
        ("the measured rotation is none", ("pose", 2, [[0]], [[1.0, 2, 1, 1, 0, 1]], np.eye(3)[None])),
        ("is not a unit vector", ("bearing", 3, [[1, 3]], [[1.0, 1, 1]], eye)),
        ("needs a pose to sit on", ("position", 2, [[2]], [[1.0, 1]], eye, np.array([0, 0, 1, 0, 0, 1.0]))),
    ]
    for message, arguments in cases:
        with pytest.raises(ModelError, match=message):
            problem.add_table(*arguments)
    with pytest.raises(ModelError, match="handle 0 is no table"):
        problem.residuals(STATE, 0)
    with pytest.raises(ModelError, match="at least 1"):
        set_threads(0)


def test_state_weights_blocks_and_order_of_use():
    problem = Problem(KINDS)
    handle = problem.add_table("position", 2, [[0], [2]], np.zeros((2, 2)), np.eye(2)[None])
    blocks = problem.add_blocks([[2, 3]], 1)
    given_blocks = {blocks: (np.ones((1, 1)), np.ones((1, 1, 5)), 1.0)}
    problem.linearise(STATE, given_blocks)
    bad = STATE.copy()
    bad[7] = np.nan
    with pytest.raises(ModelError, match="state of variable 1 is not finite"):
        problem.linearise(bad, given_blocks)
    bad[7], bad[9] = 0.0, 17.0
    with pytest.raises(ModelError, match="rotation of variable 1"):
        problem.cost(bad)
    with pytest.raises(ModelError, match="found shape"):
        problem.cost(STATE[1:])
    for weights in ([1.0], [-1.0, 1.0], [np.nan, 1.0], [np.inf, 1.0]):
        with pytest.raises(ModelError, match="weight"):
            problem.set_weights(handle, weights)
    r = problem.residuals(STATE, handle).shape[1]
    for whitening in (np.eye(r), np.ones((3, r, r)), np.full((1, r, r), np.nan)):
        with pytest.raises(ModelError, match="whitening"):
            problem.set_whitening(handle, whitening)
    with pytest.raises(ModelError, match="expected"):
        problem.linearise(STATE)
    with pytest.raises(ModelError, match="found handles"):
        problem.linearise(STATE, given_blocks | {17: given_blocks[blocks]})
    with pytest.raises(ModelError, match="not finite"):
        problem.linearise(STATE, {blocks: (np.ones((1, 1)), np.full((1, 1, 5), np.nan), 1.0)})
    with pytest.raises(ModelError, match="fixed by its first use"):
        problem.add_blocks([[2, 3]], 1)
    with pytest.raises(ModelError, match="other kinds"):
        Problem(KINDS).add_blocks([[2, 3], [3, 2]], 1)
    with pytest.raises(ModelError, match="twice"):
        Problem(KINDS).add_blocks([[2, 2]], 1)
    with pytest.raises(ModelError, match="at least one row"):
        Problem(KINDS).add_blocks(np.zeros((0, 2), int), 1)
    with pytest.raises(ModelError, match="at least one variable"):
        Problem([])


def test_arrays_given_are_neither_changed_nor_kept():
    problem = Problem(KINDS)
    index, z, whitening = np.array([[0], [2]]), np.ones((2, 2)), np.tile(np.eye(2), (2, 1, 1))
    handle = problem.add_table("position", 2, index, z, whitening)
    state = STATE.copy()
    before = problem.residuals(state, handle)
    for array in (index, z, whitening):
        array[:] = 0
    np.testing.assert_array_equal(problem.residuals(state, handle), before)
    problem.retract(state, np.ones(problem.pattern.scalars))
    np.testing.assert_array_equal(state, STATE)
