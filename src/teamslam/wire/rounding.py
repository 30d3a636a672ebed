"""Rounding an estimate and its information, with a bound on what that does to any map made of them.

    estimate     S~ = S^ (+) d, steps 2^a.            shift = sqrt(d' I d)              [sigma]
    information  (1 - eta) I <= I~ <= (1 + eta) I     checked by two Cholesky factorisations, not estimated

A join with minimiser x and information H moves by at most |x~ - x|_H <= (shift + eta |e|_I) / (1 - eta), where e is
what the submap and the joined map disagree by, and no variable, nor any combination of variables, moves by more of its
own standard deviations than that; sigmas themselves change by at most a factor (1 - eta)^-1/2. Messages that were
rounded apart from each other add up in quadrature.

Information is rounded in one of two forms, whichever is shorter:

    entries   each number of I by a step relative to its diagonal; as fine as the worst-known direction demands
    root      the triangle U of I = U'U with error feedback (Babai's nearest plane, 1986): E = (U~ - U) U^-1 is kept
              within half a step in every entry, column by column, so that no direction is known worse than another
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError, SolveError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Kind, Layout, Values, rows_of
from teamslam.model.sparse import sp
from teamslam.solver import Factor

FINEST = 1e-9  # of a limit: finer than this is the same as to the bit, but longer
LARGEST_ROOT = 1200  # unknowns: beyond, the dense inverse that error feedback needs costs more than it saves


@dataclass(frozen=True)
class Precision:
    """How far rounding may go, or went: `shift_sigma`, of the estimate in sigmas of the whole submap; `information`,
    eta, the relative change of the information in any direction. Zero means to the bit. Raises InputError for numbers
    that are neither."""

    shift_sigma: float = 0.03
    information: float = 0.01

    def __post_init__(self) -> None:
        for name, value, most in (("shift_sigma", self.shift_sigma, 1.0), ("information", self.information, 0.5)):
            if not 0.0 <= value <= most:
                raise InputError(f"{name} is 0 (to the bit) or at most {most:g}, found {value:g}")

    def as_limit(self) -> "Precision":
        """Itself, to be kept by a rounding. Raises InputError for a limit that no rounding can keep."""
        for name, value in (("shift_sigma", self.shift_sigma), ("information", self.information)):
            if 0.0 < value < FINEST:
                raise InputError(f"{name} is 0 (to the bit) or at least {FINEST:g}, found {value:g}")
        return self

    def beside(self, other: "Precision") -> "Precision":
        """The bound of two roundings together: shifts in quadrature, of the informations the worse."""
        return Precision(float(np.hypot(self.shift_sigma, other.shift_sigma)), max(self.information, other.information))


EXACT, COMPACT = Precision(0.0, 0.0), Precision()


# --- the estimate -------------------------------------------------------------------------------------------------


def round_estimate(values: Values, information: sp.csr_array, limit_sigma: float) -> tuple[IntArray, IntArray, float]:
    """Integers and exponents of the steps, both (dof,), and the shift [sigma] that comes of it, at most the limit."""
    tangent = values.minus(_origin(values.layout))
    scale = np.sqrt(np.maximum(information.diagonal(), 1e-300))
    fineness = limit_sigma * np.sqrt(12.0 / max(len(tangent), 1))
    while True:
        exponents = np.floor(np.log2(fineness / scale)).astype(np.int64)
        integers = np.rint(np.ldexp(tangent, -exponents)).astype(np.int64)
        error = restore_estimate(values.layout, integers, exponents).minus(values)
        shift = float(np.sqrt(max(error @ (information @ error), 0.0)))
        if shift <= limit_sigma:
            return integers, exponents, shift
        fineness *= 0.75


def restore_estimate(layout: Layout, integers: IntArray, exponents: IntArray) -> Values:
    """The estimate that was rounded so."""
    return _origin(layout).retract(np.ldexp(integers.astype(float), exponents))


def _origin(layout: Layout) -> Values:
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in Kind:
        if len(keys := layout.keys_of(kind)):
            blank = Pose.identity(kind.dim, (len(keys),)) if kind.is_pose else np.zeros((len(keys), kind.dim))
            parts[kind] = (keys, blank)
    return Values.of(parts)


# --- the information ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RoundedInformation:
    """What is sent of an information matrix: of what form, exponents (dof,), and integers in the form's order."""

    form: str
    exponents: IntArray
    integers: IntArray


@dataclass(frozen=True)
class Form:
    """A row of FORMS: where the numbers stand (row, column, in the order they are sent), what rounds a matrix at a
    fineness to exponents and integers, and how these are restored."""

    places: Callable[[Layout, IntArray], tuple[IntArray, IntArray]]
    rounding: Callable[[sp.csr_array, tuple[IntArray, IntArray]], Callable[[float], tuple[IntArray, IntArray]]]
    restore: Callable[[int, tuple[IntArray, IntArray], IntArray, IntArray], sp.csr_array]


def round_information(
    layout: Layout, pairs: IntArray, information: sp.csr_array, eta: float
) -> list[RoundedInformation]:
    """The coarsest rounding within eta, in each form that can keep it; empty where none can.

    `pairs` (p, 2): the coupled variables, places with first <= second, as `coupled_pairs` gives them.
    """
    found = []
    for name, form in FORMS.items():
        if name == "root" and layout.dof > LARGEST_ROOT:
            continue
        places = form.places(layout, pairs)
        best = _coarsest(form.rounding(information, places), _check(layout, information, form, places, eta))
        if best is not None:
            found.append(RoundedInformation(name, *best))
    return found


def _check(
    layout: Layout, information: sp.csr_array, form: Form, places: tuple[IntArray, IntArray], eta: float
) -> Callable[[IntArray, IntArray], bool]:
    def holds(exponents: IntArray, integers: IntArray) -> bool:
        return within(layout, information, form.restore(layout.dof, places, exponents, integers), eta)

    return holds


def restore_information(layout: Layout, pairs: IntArray, rounded: RoundedInformation) -> sp.csr_array:
    """The information that was rounded so: symmetric."""
    form = FORMS[rounded.form]
    return form.restore(layout.dof, form.places(layout, pairs), rounded.exponents, rounded.integers)


def number_of_integers(layout: Layout, pairs: IntArray, form: str) -> tuple[int, IntArray]:
    """How many integers a form sends, and their groups: the column that each stands in."""
    _, columns = FORMS[form].places(layout, pairs)
    return len(columns), columns


def within(layout: Layout, information: sp.csr_array, rounded: sp.csr_array, eta: float) -> bool:
    """Whether (1 - eta) I <= I~ <= (1 + eta) I: both differences are positive definite."""
    try:
        Factor.of(layout, sp.csr_array(rounded - (1.0 - eta) * information))
        Factor.of(layout, sp.csr_array((1.0 + eta) * information - rounded))
    except SolveError:
        return False
    return True


def _coarsest(
    rounded: Callable[[float], tuple[IntArray, IntArray]], holds: Callable[[IntArray, IntArray], bool]
) -> tuple[IntArray, IntArray] | None:
    """The result at the coarsest fineness 2^(-k/4), k = 0 .. 180, that is within bounds, by bisection."""
    fine, coarse = 181, -1  # fine: known to do (or none does); coarse: known to fail
    best = None
    k = 32
    while fine - coarse > 1:
        result = rounded(2.0 ** (-k / 4))
        if holds(*result):
            best, fine = result, k
        else:
            coarse = k
        k = (fine + coarse) // 2
    return best


# --- what is coupled ----------------------------------------------------------------------------------------------


def coupled_pairs(layout: Layout, information: sp.csr_array) -> IntArray:
    """The coupled variables (p, 2), first <= second, in order; every variable with itself."""
    coo = sp.coo_array(information)
    owner = np.repeat(np.arange(len(layout)), layout.dofs)
    there = coo.data != 0.0
    first, second = owner[coo.row[there]], owner[coo.col[there]]
    upper = first < second
    own = np.arange(len(layout))
    pairs = np.stack([np.append(own, first[upper]), np.append(own, second[upper])], -1)
    return np.unique(pairs, axis=0)


def upper_places(layout: Layout, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Row and column of every number of the upper triangle in the blocks of `pairs`, block by block."""
    height, width = layout.dofs[pairs[:, 0]], layout.dofs[pairs[:, 1]]
    size = height * width
    block = np.repeat(np.arange(len(pairs)), size)
    within_block = rows_of(np.zeros(len(pairs), np.int64), size)
    rows = layout.dof_start[pairs[block, 0]] + within_block // width[block]
    columns = layout.dof_start[pairs[block, 1]] + within_block % width[block]
    upper = rows <= columns
    return rows[upper], columns[upper]


def numbers_at(matrix: sp.csr_array, places: tuple[IntArray, IntArray]) -> Array:
    """The numbers of a matrix at rows and columns."""
    if not len(places[0]):  # SciPy answers an empty question with a sparse array
        return np.zeros(0)
    return np.asarray(matrix[places[0], places[1]]).ravel()


def mirrored(dof: int, places: tuple[IntArray, IntArray], numbers: Array) -> sp.csr_array:
    """The symmetric matrix with these numbers in its upper triangle."""
    rows, columns = places
    strictly = rows != columns
    data = np.concatenate([numbers, numbers[strictly]])
    at = np.concatenate([rows, columns[strictly]]), np.concatenate([columns, rows[strictly]])
    return sp.csr_array(sp.coo_array((data, at), shape=(dof, dof)))


# --- form: entries ------------------------------------------------------------------------------------------------


def _rounding_of_entries(
    information: sp.csr_array, places: tuple[IntArray, IntArray]
) -> Callable[[float], tuple[IntArray, IntArray]]:
    rows, columns = places
    diagonal = np.maximum(information.diagonal(), 1e-300)
    numbers = numbers_at(information, places)

    def at(fineness: float) -> tuple[IntArray, IntArray]:
        exponents = np.floor(0.5 * np.log2(fineness * diagonal)).astype(np.int64)
        return exponents, np.rint(np.ldexp(numbers, -(exponents[rows] + exponents[columns]))).astype(np.int64)

    return at


def _restore_entries(
    dof: int, places: tuple[IntArray, IntArray], exponents: IntArray, integers: IntArray
) -> sp.csr_array:
    rows, columns = places
    return mirrored(dof, places, np.ldexp(integers.astype(float), exponents[rows] + exponents[columns]))


# --- form: root ---------------------------------------------------------------------------------------------------


def _root_places(layout: Layout, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """Where U of the reordered I = U'U can be non-zero, in the unknowns of the layout: a row's own unknown first in
    the order of elimination. Both sides find the order from the couplings alone."""
    order, filled = eliminate_by_degree(len(layout), pairs)
    reordered_dofs = layout.dofs[order]
    start = np.concatenate([[0], np.cumsum(reordered_dofs)])
    height, width = reordered_dofs[filled[:, 0]], reordered_dofs[filled[:, 1]]
    size = height * width
    block = np.repeat(np.arange(len(filled)), size)
    inside = rows_of(np.zeros(len(filled), np.int64), size)
    rows = start[filled[block, 0]] + inside // width[block]
    columns = start[filled[block, 1]] + inside % width[block]
    upper = rows <= columns
    unknowns = rows_of(layout.dof_start[order], reordered_dofs)
    return unknowns[rows[upper]], unknowns[columns[upper]]


def eliminate_by_degree(variables: int, pairs: IntArray) -> tuple[IntArray, IntArray]:
    """An order of elimination (least neighbours first, then the lowest) and the couplings (p, 2) of the triangle that
    it leaves, as places in that order, first <= second."""
    neighbours: list[set[int]] = [set() for _ in range(variables)]
    for a, b in pairs.tolist():
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    left = set(range(variables))
    order: list[int] = []
    above: list[set[int]] = []
    while left:
        v = min(left, key=lambda u: (len(neighbours[u]), u))
        left.discard(v)
        around = neighbours[v]
        for u in around:
            neighbours[u] |= around
            neighbours[u] -= {u, v}
        order.append(v)
        above.append(around)
    place = np.zeros(variables, np.int64)
    place[order] = np.arange(variables)
    filled = [(i, i) for i in range(variables)]
    filled += [(i, int(place[u])) for i, around in enumerate(above) for u in around]
    return np.array(order, np.int64), np.array(sorted(filled), np.int64).reshape(-1, 2)


def _rounding_of_root(
    information: sp.csr_array, places: tuple[IntArray, IntArray]
) -> Callable[[float], tuple[IntArray, IntArray]]:
    rows, columns = places
    order = rows[rows == columns]  # the unknowns in their order of elimination
    n = len(order)
    place = np.zeros(n, np.int64)
    place[order] = np.arange(n)
    upper = np.linalg.cholesky(information.toarray()[np.ix_(order, order)]).T
    inverse, pivots = np.linalg.inv(upper), np.diag(upper)
    pattern = np.zeros((n, n), bool)
    pattern[place[rows], place[columns]] = True

    def at(fineness: float) -> tuple[IntArray, IntArray]:
        exponents = np.floor(np.log2(fineness * pivots)).astype(np.int64)
        steps = np.ldexp(1.0, exponents)
        integers, error = np.zeros((n, n)), np.zeros((n, n))
        for j in range(n):
            # What earlier columns' errors have put into E_ij is taken out again by this one.
            target = upper[: j + 1, j] - pivots[j] * (error[: j + 1, :j] @ inverse[:j, j])
            rounded = np.where(pattern[: j + 1, j], np.rint(target / steps[j]), 0.0)
            rounded[j] = max(rounded[j], 1.0)
            integers[: j + 1, j] = rounded
            error[: j + 1, j] = rounded * steps[j] - upper[: j + 1, j]
        in_layout = np.zeros(n, np.int64)
        in_layout[order] = exponents
        return in_layout, integers[place[rows], place[columns]].astype(np.int64)

    return at


def _restore_root(dof: int, places: tuple[IntArray, IntArray], exponents: IntArray, integers: IntArray) -> sp.csr_array:
    rows, columns = places
    root = sp.csr_array(
        sp.coo_array((np.ldexp(integers.astype(float), exponents[columns]), (rows, columns)), shape=(dof, dof))
    )
    product = sp.csr_array(root.T @ root)
    return sp.csr_array(0.5 * (product + product.T))


FORMS: dict[str, Form] = {
    "entries": Form(upper_places, _rounding_of_entries, _restore_entries),
    "root": Form(_root_places, _rounding_of_root, _restore_root),
}
