"""A robot's filter: its Gaussian moved to a new pose, sharpened by rows, and told what a map knows, each in one call
(cpp/filter.hpp, cpp/telling.hpp)."""

from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, c_double, c_int32, c_void_p, cast
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teamslam.errors import ModelError
from teamslam.kernel.library import Floats, Integers, checked, floats, integers, library
from teamslam.kernel.problem import DOFS, MOST_DOF, NUMBERS

Sharpened = tuple[Floats, Floats] | None

_CALLED = CFUNCTYPE(c_int32, POINTER(c_double), POINTER(c_double), POINTER(c_double))


class Gaussian(NamedTuple):
    """Variables of `kinds` (n,), of which the first is the pose of now and those that turn (`turns` (n,)) turn
    with it about a `centre`; their `state`, and the `covariance` of their unknowns, both triangles."""

    kinds: NDArray[np.integer[Any]]
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


def told(given: Gaussian, known: Gaussian, theirs: Integers, fresh: Integers) -> Sharpened:
    """State and covariance with the variables at the places `fresh` of a map at the end, given what does not turn in
    `given`: the map holds these at the places `theirs`, one each. None where the map's covariance of these is not
    positive. Raises ModelError for what does not fit."""
    places = len(known.kinds)
    held = integers("theirs", theirs, (len(given.turns) - int(np.count_nonzero(given.turns)),))
    new = integers("fresh", fresh, (None,))
    for name, found in (("theirs", held), ("fresh", new)):
        if len(found) and not 0 <= found.min() <= found.max() < places:
            raise ModelError(f"{name}: found places {found.min()} to {found.max()}, expected 0 to {places - 1}")
    start, there = _arguments(given), _arguments(known)
    more = there[0][new]
    state, covariance = _room(len(start[3]) + int(NUMBERS[more].sum()), len(start[4]) + int(DOFS[more].sum()))
    table = (places, there[0], there[3], there[4], held, len(new), new)
    done = checked(library.told(len(start[0]), *start, *table, state, covariance))
    return (state, covariance) if done else None


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
    start = _arguments(given)
    state, covariance = _room(len(start[3]), len(start[4]))
    done = checked(function(len(start[0]), *start, *table, *more, state, covariance))
    return (state, covariance) if done else None


def _arguments(given: Gaussian) -> tuple[NDArray[np.int32], NDArray[np.bool_], Floats, Floats, Floats]:
    kinds = np.ascontiguousarray(given.kinds, np.int32)
    n, dof = int(NUMBERS[kinds].sum()), int(DOFS[kinds].sum())
    return (
        kinds,
        np.ascontiguousarray(given.turns, bool),
        floats("centre", given.centre, (2 + int(kinds[0]) % 2,)),
        floats("state", given.state, (n,)),
        floats("covariance", given.covariance, (dof, dof)),
    )


def _room(numbers: int, unknowns: int) -> tuple[Floats, Floats]:
    return np.empty(numbers), np.empty((unknowns, unknowns))
