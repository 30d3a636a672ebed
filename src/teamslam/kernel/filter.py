"""A robot's filter: its Gaussian moved to a new pose, and sharpened by rows, each in one call (cpp/filter.hpp)."""

from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, c_double, c_int32, c_void_p, cast
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teamslam.kernel.library import Floats, Integers, checked, floats, library
from teamslam.kernel.problem import DOFS, MOST_DOF, NUMBERS

Sharpened = tuple[Floats, Floats] | None

_CALLED = CFUNCTYPE(c_int32, POINTER(c_double), POINTER(c_double), POINTER(c_double))


class Gaussian(NamedTuple):
    """Variables of `kinds` (n,), of which the first is the pose of now and those that turn (`turns` (n,)) turn
    with it about a `centre`; their `state`, and the `covariance` of their unknowns, both triangles."""

    kinds: Integers
    turns: NDArray[np.bool_]
    centre: Floats
    state: Floats
    covariance: Floats


@dataclass(frozen=True, eq=False)
class UserRows:
    """Rows between variables that `index` (m, keys) names by their place, of `residuals` numbers each. `linearise`
    gives at a state e (m, residuals) and J = -de/dx (m, residuals, unknowns of a row), whitened and weighted; what it
    raises goes through."""

    index: Integers
    residuals: int
    linearise: Callable[[Floats], tuple[Floats, Floats]]


Rows = UserRows | tuple[Any, ...]  # of a table: what `table_arguments` makes of it


def moved(given: Gaussian, rows: Rows, step: Floats, backward: bool, settled: bool) -> Sharpened:
    """State and covariance at a new pose, by rows between the old one X (0) and the new one (1). It begins at X o step
    (X o step^-1 where that runs `backward`), and stays there where that is `settled`. None where they leave it open.
    Raises ModelError for what does not fit."""
    own = int(NUMBERS[given.kinds[0]])
    return _called(library.moved, given, rows, 2 * own, floats("step", step, (own,)), backward, settled)


def seen(given: Gaussian, rows: Rows, most: int, little: float) -> Sharpened:
    """State and covariance sharpened by rows, linearised anew, `most` times at most, while the pose of now or the sight
    of things turns by more than `little` [rad]. None where they are not finite. Raises ModelError for what does not
    fit."""
    return _called(library.seen, given, rows, len(given.state), most, little)


def _called(function: Any, given: Gaussian, rows: Rows, numbers: int, *more: Any) -> Sharpened:
    if isinstance(rows, UserRows):
        return _with_user(function, given, rows, numbers, *more)
    return _results(function, given, (*rows, 0, 0, None), more)


def _with_user(function: Any, given: Gaussian, rows: UserRows, numbers: int, *more: Any) -> Sharpened:
    (m, keys), r, trouble = rows.index.shape, rows.residuals, list[Exception]()

    def linearise(state: Any, e: Any, J: Any) -> int:
        try:
            error, jacobian = rows.linearise(np.ctypeslib.as_array(state, (numbers,)))
            np.ctypeslib.as_array(e, (m, r))[:] = error
            np.ctypeslib.as_array(J, (m, r, 2 * MOST_DOF))[..., : jacobian.shape[-1]] = jacobian
        except Exception as error:  # it cannot go through the kernel
            trouble.append(error)
        return -len(trouble)

    called = _CALLED(linearise)
    index = np.ascontiguousarray(rows.index, np.int64)
    table = (0, 2, m, index, None, None, False, None, 0, 1.0, keys, r, cast(called, c_void_p))
    try:
        return _results(function, given, table, more)
    finally:
        if trouble:
            raise trouble[0]


def _results(function: Any, given: Gaussian, table: tuple[Any, ...], more: tuple[Any, ...]) -> Sharpened:
    kinds = np.ascontiguousarray(given.kinds, np.int32)
    n, dof = int(NUMBERS[kinds].sum()), int(DOFS[kinds].sum())
    start = (
        kinds,
        np.ascontiguousarray(given.turns, bool),
        floats("centre", given.centre, (2 + int(kinds[0]) % 2,)),
        floats("state", given.state, (n,)),
        floats("covariance", given.covariance, (dof, dof)),
    )
    state, covariance = np.empty(n), np.empty((dof, dof))
    done = checked(function(len(kinds), *start, *table, *more, state, covariance))
    return (state, covariance) if done else None
