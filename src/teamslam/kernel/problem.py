"""A non-linear least-squares problem: terms are added, then it is linearised as often as wanted."""

import threading
import weakref
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from teamslam.errors import ModelError
from teamslam.kernel.library import Floats, InKernel, Integers, checked, floats, integers, library
from teamslam.kernel.pattern import BlockPattern

# Names in the order of the kernel's numbers (cpp/models.hpp, cpp/losses.hpp, cpp/curvature.hpp).
MODELS = ("relative_pose", "point", "range", "bearing", "range_bearing", "position", "pose", "corners")
LOSSES = ("squared", "huber", "cauchy", "geman_mcclure")
CURVATURES = ("none", "losses", "all")

NUMBERS = np.array([6, 12, 2, 3])  # of each kind, in the state
DOFS = np.array([3, 6, 2, 3])
MOST_DOF = 6

T = TypeVar("T")
Blocks = Mapping[int, tuple[ArrayLike, ArrayLike, float]]


class Problem(InKernel):
    """Variables (`kinds` (n,), those that are `fixed` (n,) held constant and absent from H) and terms.

    All terms are added before the first use, which fixes the structure. Methods raise ModelError for what does not
    fit; nothing given is changed or kept. A problem may be used from several threads, which then take turns.
    """

    def __init__(self, kinds: ArrayLike, fixed: ArrayLike | None = None) -> None:
        self._kinds = integers("kinds", kinds, (None,))
        n = len(self._kinds)
        held = np.zeros(n, bool) if fixed is None else np.asarray(fixed)
        if held.shape != (n,) or held.dtype != bool:
            raise ModelError(f"fixed: found {held.dtype} {held.shape}, expected bool ({n},)")
        if n and (self._kinds.min() < 0 or self._kinds.max() > 3):
            raise ModelError("kinds: expected 0 pose2, 1 pose3, 2 point2 or 3 point3")
        pointer = library.problem_new(n, self._kinds.astype(np.int32), np.ascontiguousarray(held, np.uint8))
        if not pointer:
            raise ModelError(library.error().decode())
        self._pointer: int = pointer
        weakref.finalize(self, library.problem_free, pointer)
        self._lock = threading.Lock()
        self._numbers = int(NUMBERS[self._kinds].sum())
        self._tables: dict[int, tuple[int, int]] = {}  # handle -> rows, residuals of a row
        self._submaps: dict[int, tuple[int, int, int]] = {}  # handle -> numbers, values, unknowns
        self._blocks: dict[int, tuple[int, int, int]] = {}  # handle -> rows, residuals of a row, columns
        self._pattern: BlockPattern | None = None
        self._system = 0
        self._one = np.empty(1)

    # --- adding ---------------------------------------------------------------------------------------------------

    def add_table(
        self,
        model: str | int,
        dimension: int,
        index: ArrayLike,
        z: ArrayLike,
        whitening: ArrayLike,
        sensor: ArrayLike | None = None,
        loss: str = "squared",
        scale: float = 1.0,
    ) -> int:
        """A table of m measurements of one model (a name of MODELS, or its place); returns its handle.

        `dimension` 2 or 3; index (m, keys) names variables; z (m, numbers); whitening (m, r, r), or (1, r, r) for all
        rows; `sensor` is the sensor's pose in the observer's body, T then R row by row (6 or 12). `loss` is a name of
        LOSSES and `scale` its scale in standard deviations.
        """
        given = table_arguments(model, dimension, index, z, whitening, sensor, loss, scale)
        handle = checked(library.add_table(self._pointer, *given))
        m, r = given[2], _model_shape(given[0], dimension)[2]
        self._tables[handle] = (m, r)
        return handle

    def set_weights(self, handle: int, weights: ArrayLike | None) -> None:
        """Factors (m,), at least 0, on each row's part of cost, gradient and H; None takes them away."""
        m, _ = self._known(self._tables, handle, "table")
        given = None if weights is None else floats("weights", weights, (m,))
        with self._lock:
            checked(library.set_weights(self._pointer, handle, given))

    def set_whitening(self, handle: int, whitening: ArrayLike) -> None:
        """Another whitening (m, r, r), or (1, r, r) for all rows, in the place of a table's."""
        m, r = self._known(self._tables, handle, "table")
        given = floats("whitening", whitening, (m, r, r), (1, r, r))
        with self._lock:
            checked(library.set_whitening(self._pointer, handle, given, len(given) == 1))

    def set_curvature(self, handle: int, curvature: str) -> None:
        """What H holds of a table or submap beyond J'W'WJ: a name of CURVATURES. "none" (at first) is information;
        "losses" adds how robust losses bend along their residuals, "all" how residuals bend too: the second derivative
        of the cost, for steps like Newton's (it may be indefinite)."""
        if handle not in self._tables and handle not in self._submaps:
            raise ModelError(f"handle {handle!r} is no table or submap of this problem")
        level = _place(curvature, CURVATURES, "curvature")
        with self._lock:
            checked(library.set_curvature(self._pointer, handle, level))

    def add_submap(
        self,
        base: int,
        members: ArrayLike,
        kinds: ArrayLike,
        state: ArrayLike,
        pattern: BlockPattern,
        values: ArrayLike,
        eta: ArrayLike | None = None,
    ) -> int:
        """A submap as one measurement (paper, eq. 11): cost e'Ie + 2 eta'e with e_v = s_v (-) (X_base^-1 X_v).

        `base` is the variable that is the submap's frame, -1 for the world's; members (n,) are variables, with local
        estimates of `kinds` (n,) in `state`. The information I has `pattern` (over the estimates' unknowns) and
        `values`; eta (its unknowns,) is zero if left out. A pose3 estimate may stand for a pose2 variable.
        """
        names = integers("submap members", members, (None,))
        n = len(names)
        own_kinds = integers("submap kinds", kinds, (n,))
        if n and (own_kinds.min() < 0 or own_kinds.max() > 3):
            raise ModelError("submap kinds: expected 0 pose2, 1 pose3, 2 point2 or 3 point3")
        if len(pattern.dofs) != n or (pattern.dofs != DOFS[own_kinds]).any():
            raise ModelError("submap pattern: its unknowns are not those of the kinds of the members")
        sizes = (int(NUMBERS[own_kinds].sum()), pattern.size, pattern.scalars)
        estimate, information, slope = _submap_arrays(sizes, state, values, eta)
        handle = checked(
            library.add_submap(
                self._pointer,
                int(base),
                n,
                names,
                own_kinds.astype(np.int32),
                estimate,
                pattern.column_start,
                pattern.row,
                information,
                slope,
            )
        )
        self._submaps[handle] = sizes
        return handle

    def add_submaps(
        self,
        bases: ArrayLike,
        counts: ArrayLike,
        members: ArrayLike,
        kinds: ArrayLike,
        state: ArrayLike,
        row_start: ArrayLike,
        columns: Sequence[ArrayLike],
        values: Sequence[ArrayLike],
        eta: ArrayLike | None = None,
    ) -> list[int]:
        """Many submaps at once, as `add_submap`, their arrays one after another; returns their handles.

        Submap k has base bases[k] and counts[k] members. Each information is sparse by rows of scalars, both triangles:
        `row_start` is each submap's own, from 0 and one longer than its unknowns; columns[k] rise within a row, and
        values[k] go with them.
        """
        frames = integers("submap bases", bases, (None,))
        number = integers("submap counts", counts, (len(frames),))
        if len(frames) == 0:
            return []
        if number.min() < 1:
            raise ModelError(f"submap {int(number.argmin())}: it has no members")
        names = integers("submap members", members, (int(number.sum()),))
        own_kinds = integers("submap kinds", kinds, (len(names),))
        if own_kinds.min() < 0 or own_kinds.max() > 3:
            raise ModelError("submap kinds: expected 0 pose2, 1 pose3, 2 point2 or 3 point3")
        firsts = np.cumsum(number) - number
        unknowns = np.add.reduceat(DOFS[own_kinds], firsts)
        numbers = np.add.reduceat(NUMBERS[own_kinds], firsts)
        start = integers("submap row starts", row_start, (int(unknowns.sum()) + len(frames),))
        entries = start[np.cumsum(unknowns + 1) - 1]
        places = _pieces("submap columns", columns, entries, np.int32)
        information = _pieces("submap values", values, entries, np.float64)
        estimate = floats("submap state", state, (int(numbers.sum()),))
        slope = None if eta is None else floats("submap eta", eta, (int(unknowns.sum()),))
        sizes = np.empty(len(frames), np.int64)
        first = checked(
            library.add_submaps(
                self._pointer,
                len(frames),
                frames,
                number,
                names,
                own_kinds.astype(np.int32),
                estimate,
                start,
                _addresses(places),
                _addresses(information),
                slope,
                sizes,
            )
        )
        handles = list(range(first, first + len(frames)))
        each = zip(numbers.tolist(), sizes.tolist(), unknowns.tolist(), strict=True)
        self._submaps.update(zip(handles, each, strict=True))
        return handles

    def set_submap(self, handle: int, state: ArrayLike, values: ArrayLike, eta: ArrayLike | None = None) -> None:
        """New numbers in place of a submap's, on the same structure."""
        sizes = self._known(self._submaps, handle, "submap")
        estimate, information, slope = _submap_arrays(sizes, state, values, eta)
        with self._lock:
            checked(library.set_submap(self._pointer, handle, estimate, information, slope))

    def add_blocks(self, index: ArrayLike, rows: int) -> int:
        """Measurements linearised by the caller: index (m, k) names variables of the same kinds in every row, each row
        with `rows` residuals. `linearise` then wants (e, J, cost) under the handle returned."""
        names = integers("blocks index", index, (None, None))
        m, keys = names.shape
        handle = checked(library.add_blocks(self._pointer, m, keys, names, int(rows)))
        self._blocks[handle] = (m, int(rows), int(DOFS[self._kinds[names[0]]].sum()))
        return handle

    def set_homes(self, home: ArrayLike) -> None:
        """Which pose carries each variable (n,) when a step is taken, -1 for none (cpp/retraction.hpp).

        A home is a pose, not in space where the variable is planar; homes may have homes, but not in a circle.
        """
        with self._lock:
            checked(library.set_homes(self._pointer, integers("homes", home, (len(self._kinds),))))

    # --- using ----------------------------------------------------------------------------------------------------

    @property
    def pattern(self) -> BlockPattern:
        """The blocks of H, over the free variables in the order of their index."""
        if self._pattern is None:
            self._pattern = self._freeze()
        return self._pattern

    def linearise(self, state: ArrayLike, blocks: Blocks | None = None) -> tuple[float, Floats, Floats]:
        """Cost, gradient g (scalars,) and the values of H on `pattern`, all weighted, at `state`.

        `blocks` gives for every handle of `add_blocks` e (m, rows) and J (m, rows, dof), J = -de/dx, both whitened and
        weighted, and their part of the cost.
        """
        x = self._state(state)
        pattern = self.pattern
        handles, e, J, user_cost = self._user_blocks(blocks or {}) if blocks or self._blocks else _NO_BLOCKS
        system = np.empty(self._system)
        with self._lock:
            count, at_e, at_J = len(e), _addresses(e), _addresses(J)
            checked(library.linearise(self._pointer, x, count, handles, at_e, at_J, system, self._one))
            cost = float(self._one[0])
        size = pattern.size
        return cost + user_cost, system[size : size + pattern.scalars], system[:size]

    def slope(self, state: ArrayLike) -> tuple[float, Floats]:
        """Cost and gradient alone, as `linearise` gives them, in a third to a half of its time. ModelError where there
        are blocks of a user's."""
        x = self._state(state)
        start, end = self.pattern.size, self.pattern.size + self.pattern.scalars
        system = np.empty(self._system)
        with self._lock:
            checked(library.slope(self._pointer, x, system, self._one))
            return float(self._one[0]), system[start:end].copy()

    def cost(self, state: ArrayLike) -> float:
        """The cost at `state` of all terms but the blocks of `add_blocks`."""
        x = self._state(state)
        with self._lock:
            checked(library.cost(self._pointer, x, self._one))
            return float(self._one[0])

    def sharpest(self) -> float:
        """The most information that any submap has on one number of its estimate; 0 where there are none."""
        with self._lock:
            return float(library.sharpest(self._pointer))

    def residuals(self, state: ArrayLike, handle: int) -> Floats:
        """The whitened residuals (m, r) of a table, without loss or weights, in the order in which it was given."""
        out = np.empty(self._known(self._tables, handle, "table"))
        x = self._state(state)
        with self._lock:
            checked(library.residuals(self._pointer, handle, x, out))
        return out

    def jacobians(self, state: ArrayLike, handle: int) -> Floats:
        """The derivatives -de/dx of a table's whitened residuals (m, r, 12), without loss or weights, in the order in
        which it was given: by the unknowns of each row's first variable, then of its second, then zeros."""
        out = np.zeros((*self._known(self._tables, handle, "table"), 2 * MOST_DOF))
        x = self._state(state)
        with self._lock:
            checked(library.jacobians(self._pointer, handle, x, out))
        return out

    def along(self, state: ArrayLike, handle: int, y: ArrayLike) -> Floats:
        """What these derivatives make of y (scalars, k): WJ y (m, r, k)."""
        m, r = self._known(self._tables, handle, "table")
        x, steps = self._state(state), floats("y", y, (self.pattern.scalars, None))
        out = np.empty((m, r, steps.shape[1]))
        with self._lock:
            checked(library.along(self._pointer, handle, x, steps, steps.shape[1], out))
        return out

    def pull(self, state: ArrayLike, handle: int, whitened: ArrayLike, sums: Floats) -> None:
        """Adds J'W'u to `sums` (scalars, k) for u (m, r, k), without loss or weights."""
        m, r = self._known(self._tables, handle, "table")
        x, u = self._state(state), floats("u", whitened, (m, r, None))
        expected = (self.pattern.scalars, u.shape[2])
        if sums.shape != expected or sums.dtype != np.float64 or not sums.flags.c_contiguous:
            raise ModelError(f"sums: found {sums.dtype} {sums.shape}, expected contiguous float64 {expected}")
        with self._lock:
            checked(library.pull(self._pointer, handle, x, u, u.shape[2], sums))

    def fault(self, state: ArrayLike, handle: int) -> int | None:
        """The first row of a table, or member of a submap, of which a residual, Jacobian or cost is not finite at
        `state`; None where all are."""
        if handle not in self._tables and handle not in self._submaps:
            raise ModelError(f"handle {handle!r} is no table or submap of this problem")
        x, row = self._state(state), np.empty(1, np.int64)
        with self._lock:
            checked(library.fault(self._pointer, handle, x, row))
        return None if row[0] < 0 else int(row[0])

    def retract(self, state: ArrayLike, delta: ArrayLike) -> Floats:
        """The state moved by delta (scalars,) over the free variables, carried by homes where there are any. Rotations
        are kept orthonormal to rounding."""
        x = self._state(state)
        step = floats("delta", delta, (self.pattern.scalars,))
        out = np.empty_like(x)
        checked(library.retract(self._pointer, x, step, out))
        return out

    # --- inside ---------------------------------------------------------------------------------------------------

    def _state(self, state: ArrayLike) -> Floats:
        return floats("state", state, (self._numbers,))

    @staticmethod
    def _known(terms: dict[int, T], handle: int, name: str) -> T:
        try:
            return terms[handle]
        except (KeyError, TypeError):
            raise ModelError(f"handle {handle!r} is no {name} of this problem") from None

    def _freeze(self) -> BlockPattern:
        sizes = np.empty(5, np.int64)
        with self._lock:
            checked(library.freeze(self._pointer, sizes))
        n, blocks, size, scalars, self._system = sizes.tolist()
        dofs, column_start, row = np.empty(n, np.int32), np.empty(n + 1, np.int64), np.empty(blocks, np.int32)
        library.pattern(self._pointer, dofs, column_start, row)
        return BlockPattern.trusted(dofs, column_start, row, size, scalars)

    def _user_blocks(self, given: Blocks) -> tuple[Integers, list[Floats], list[Floats], float]:
        if set(given) != set(self._blocks):
            raise ModelError(f"blocks: found handles {sorted(given)}, expected {sorted(self._blocks)}")
        errors, jacobians, total = [], [], 0.0
        for handle, (m, rows, columns) in self._blocks.items():
            error, jacobian, cost = given[handle]
            e, J = floats("blocks e", error, (m, rows)), floats("blocks J", jacobian, (m, rows, columns))
            if not (np.isfinite(e).all() and np.isfinite(J).all() and np.isfinite(cost)):
                raise ModelError(f"blocks: e, J or the cost of handle {handle} has a number that is not finite")
            errors.append(e)
            jacobians.append(J)
            total += float(cost)
        return np.array(list(self._blocks), np.int64), errors, jacobians, total


_NO_BLOCKS: tuple[Integers, list[Floats], list[Floats], float] = (np.zeros(0, np.int64), [], [], 0.0)


@cache
def _model_shape(model: int, dimension: int) -> tuple[int, int, int]:
    shape = np.empty(3, np.int32)
    library.model_shape(model, dimension, shape)
    return int(shape[0]), int(shape[1]), int(shape[2])


def table_arguments(
    model: str | int,
    dimension: int,
    index: ArrayLike,
    z: ArrayLike,
    whitening: ArrayLike,
    sensor: ArrayLike | None,
    loss: str,
    scale: float,
) -> tuple[int, int, int, Integers, Floats, Floats, bool, Floats | None, int, float]:
    """What `Problem.add_table` is given as the kernel takes it: checked, contiguous, names as numbers."""
    which = _place(model, MODELS, "model") if isinstance(model, str) else int(model)
    if not 0 <= which < len(MODELS):
        raise ModelError(f"model: found {which}, expected 0 to {len(MODELS) - 1}")
    if dimension not in (2, 3):
        raise ModelError(f"dimension: found {dimension}, expected 2 or 3")
    name = MODELS[which]
    keys, numbers, r = _model_shape(which, dimension)
    pairs = integers(f"{name} index", index, (None, keys))
    m = len(pairs)
    measured = floats(f"{name} z", z, (m, numbers))
    white = floats(f"{name} whitening", whitening, (m, r, r), (1, r, r))
    mount = None if sensor is None else floats(f"{name} sensor", sensor, ((6,), (12,))[dimension - 2])
    shared = len(white) == 1
    return which, dimension, m, pairs, measured, white, shared, mount, _place(loss, LOSSES, "loss"), float(scale)


def _place(name: str, names: tuple[str, ...], what: str) -> int:
    if name not in names:
        raise ModelError(f"{what}: found {name!r}, expected one of {', '.join(names)}")
    return names.index(name)


def _submap_arrays(
    sizes: tuple[int, int, int], state: ArrayLike, values: ArrayLike, eta: ArrayLike | None
) -> tuple[Floats, Floats, Floats | None]:
    return (
        floats("submap state", state, (sizes[0],)),
        floats("submap values", values, (sizes[1],)),
        None if eta is None else floats("submap eta", eta, (sizes[2],)),
    )


def _pieces(name: str, given: Sequence[ArrayLike], lengths: Integers, dtype: DTypeLike) -> list[NDArray[Any]]:
    """One array of each length, not copied where it is contiguous and of the `dtype` already."""
    arrays = [
        a if isinstance(a, np.ndarray) and a.dtype == dtype and a.flags.c_contiguous else _converted(name, a, dtype)
        for a in given
    ]
    if [a.shape for a in arrays] != [(length,) for length in lengths.tolist()]:
        raise ModelError(f"{name}: expected one array for each submap, as long as its row starts say")
    return arrays


def _converted(name: str, given: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    if dtype is np.float64:
        return floats(name, given, (None,))
    wide = integers(name, given, (None,))
    narrow = wide.astype(dtype)
    if not np.array_equal(wide, narrow):
        raise ModelError(f"{name}: found numbers up to {np.abs(wide).max()}, which are too large")
    return narrow


def _addresses(arrays: Sequence[NDArray[Any]]) -> NDArray[np.uintp] | None:
    if not arrays:
        return None
    return np.array([array.__array_interface__["data"][0] for array in arrays], np.uintp)
