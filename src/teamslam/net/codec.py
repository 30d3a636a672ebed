"""Submaps and measurement tables as fields of a message, to the bit or rounded within a stated bound.

A message opens with the variables that it names (`known`, sorted); everything else refers to them by place.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.model import (
    LOSSES,
    MODELS,
    Kind,
    Layout,
    Loss,
    Names,
    Sources,
    Stretch,
    Submap,
    Table,
    Values,
    index_of,
    is_landmark,
    is_pose,
    pack,
    robot_of,
    unpack,
)
from teamslam.net.packing import DAMAGED, Reader, Writer
from teamslam.net.rounding import (
    EXACT,
    FORMS,
    Precision,
    RoundedInformation,
    coupled_pairs,
    mirrored,
    number_of_integers,
    numbers_at,
    restore_estimate,
    restore_information,
    round_estimate,
    round_information,
    upper_places,
)

FORM_CODES = ("exact", *FORMS)


# --- a submap -----------------------------------------------------------------------------------------------------


def put_submap(out: Writer, submap: Submap, precision: Precision) -> Precision:
    """Write a submap; returns the bound that its rounding keeps."""
    known = np.unique(np.concatenate([submap.keys, *(t.keys.ravel() for t in submap.raw)]))
    put_known(out, known)
    out.text(submap.id)
    out.number(submap.version)
    out.number(int(np.searchsorted(known, submap.base)))
    out.number(submap.base_dim)
    for real in (submap.cost, submap.chi2):
        out.real(real)
    out.number(submap.rows)
    put_names(out, submap.names, known, submap.sources)
    _put_sources(out, submap.sources)
    layout = submap.values.layout
    for kind in Kind:
        _put_places(out, np.searchsorted(known, layout.keys_of(kind)))
    pairs = coupled_pairs(layout, submap.information)
    _put_pairs(out, len(layout), pairs)
    if submap.raw:  # two shifts, which add up in quadrature
        precision = replace(precision, shift_sigma=precision.shift_sigma * np.sqrt(0.5))
    kept = _put_information(out, layout, pairs, submap.information, precision.information)
    shift = _put_estimate(out, submap.values, submap.information, precision.shift_sigma)
    raw = put_tables(out, submap.raw, known, precision)
    return Precision(shift, kept).beside(raw)


def get_submap(source: Reader) -> Submap:
    """Read a submap. Raises InputError or ModelError where it makes no sense."""
    known = get_known(source)
    id_, version, base, base_dim = source.text(), source.number(), source.number(), source.number()
    cost, chi2, rows = source.real(), source.real(), source.number()
    names, sources = get_names(source), _get_sources(source)
    keys = [known[_get_places(source, len(known))] for _ in Kind]
    layout = Layout(np.concatenate(keys), np.repeat([int(k) for k in Kind], [len(k) for k in keys]))
    pairs = _get_pairs(source, len(layout))
    information = _get_information(source, layout, pairs)
    return Submap(
        id=id_,
        version=version,
        base=int(known[_inside(base, len(known))]),
        base_dim=base_dim,
        values=_get_estimate(source, layout),
        information=information,
        sources=sources,
        names=names,
        raw=get_tables(source, known),
        cost=cost,
        chi2=chi2,
        rows=rows,
    )


def _put_information(out: Writer, layout: Layout, pairs: IntArray, information: sp.csr_array, eta: float) -> float:
    """The shortest form that keeps the bound; exact numbers where none does."""
    exact = Writer()
    exact.reals(numbers_at(information, upper_places(layout, pairs)))
    candidates = [(exact.content(), "exact", 0.0)]
    for rounded in round_information(layout, pairs, information, eta) if eta else ():
        _, groups = number_of_integers(layout, pairs, rounded.form)
        body = Writer()
        body.integers(rounded.exponents)
        body.integers(rounded.integers, groups)
        candidates.append((body.content(), rounded.form, eta))
    data, form, bound = min(candidates, key=lambda c: len(c[0]))
    out.number(FORM_CODES.index(form))
    out.raw(data)
    return bound


def _get_information(source: Reader, layout: Layout, pairs: IntArray) -> sp.csr_array:
    form = FORM_CODES[_inside(source.number(), len(FORM_CODES))]
    if form == "exact":
        places = upper_places(layout, pairs)
        return mirrored(layout.dof, places, source.reals(len(places[0])))
    exponents = source.integers(layout.dof)
    count, groups = number_of_integers(layout, pairs, form)
    return restore_information(layout, pairs, RoundedInformation(form, exponents, source.integers(count, groups)))


def _put_estimate(out: Writer, values: Values, information: sp.csr_array, limit_sigma: float) -> float:
    out.number(int(limit_sigma > 0.0))
    if not limit_sigma:
        for kind in Kind:
            _put_rows(out, values.table(kind), kind)
        return 0.0
    integers, exponents, shift = round_estimate(values, information, limit_sigma)
    for kind in Kind:
        at = values.layout.unknowns(values.layout.keys_of(kind))
        out.columns(integers[at].reshape(-1, kind.dof))
        out.columns(exponents[at].reshape(-1, kind.dof))
    return shift


def _get_estimate(source: Reader, layout: Layout) -> Values:
    if not source.number():
        rows = [_get_rows(source, len(layout.keys_of(kind)), kind) for kind in Kind]
        return Values(layout, np.concatenate([r.ravel() for r in rows]))
    integers, exponents = np.zeros(layout.dof, np.int64), np.zeros(layout.dof, np.int64)
    for kind in Kind:
        keys = layout.keys_of(kind)
        at = layout.unknowns(keys)
        integers[at] = source.columns(len(keys), kind.dof).ravel()
        exponents[at] = source.columns(len(keys), kind.dof).ravel()
    return restore_estimate(layout, integers, exponents)


def _put_rows(out: Writer, rows: Array, kind: Kind) -> None:
    """Rows of a state vector to the bit; of planar rotations only the first column where it gives the second."""
    short = kind == Kind.POSE2 and _second_column(rows[:, [2, 4]]).tobytes() == rows[:, [3, 5]].tobytes()
    out.number(int(short))
    out.reals(rows[:, [0, 1, 2, 4]] if short else rows)


def _get_rows(source: Reader, count: int, kind: Kind) -> Array:
    if not source.number():
        return source.reals(count * kind.size).reshape(count, kind.size)
    x = source.reals(count * 4).reshape(count, 4)
    second = _second_column(x[:, 2:])
    return np.stack([x[:, 0], x[:, 1], x[:, 2], second[:, 0], x[:, 3], second[:, 1]], -1)


def _second_column(first: Array) -> Array:
    return np.stack([-first[:, 1], first[:, 0]], -1)


# --- tables -------------------------------------------------------------------------------------------------------


def put_tables(out: Writer, tables: Sequence[Table], known: IntArray, precision: Precision) -> Precision:
    """Write measurement tables, which share one bound on the shift: sqrt(sum |W (z~ - z)|^2)."""
    out.number(len(tables))
    numbers = sum(t.dof for t in tables)
    exact = not precision.shift_sigma
    fineness = 0.0 if exact else precision.shift_sigma * np.sqrt(12.0 / max(numbers, 1))
    rounded = [(None, t.values) if exact else _round_measured(t, fineness) for t in tables]
    while not exact and (shift := _shift(tables, [z for _, z in rounded])) > precision.shift_sigma:
        fineness *= 0.9
        rounded = [_round_measured(t, fineness) for t in tables]
    eta = 0.0
    for table, (steps, _) in zip(tables, rounded, strict=True):
        out.text(table.source)
        out.number(list(MODELS).index(table.model))
        out.number(table.dim)
        out.number(table.robot)
        out.number(list(LOSSES).index(table.loss.name))
        out.real(table.loss.scale)
        out.number(0 if table.sensor is None else table.sensor.dim)
        if table.sensor is not None:
            out.reals(pack(table.sensor))
        out.number(len(table))
        out.columns(np.searchsorted(known, table.keys))
        out.columns(table.ids[:, None])
        eta = max(eta, _put_whitening(out, table, precision.information))
        if steps is None:
            kind = Kind(table.dim - 2) if table.row.targets_pose else Kind.POINT2
            out.number(0)
            _put_rows(out, table.values, kind) if kind.is_pose else out.reals(table.values)
        else:
            integers, exponents = steps
            out.number(1)
            out.columns(exponents)
            out.columns(integers)
    return EXACT if exact or not tables else Precision(shift, eta)


def get_tables(source: Reader, known: IntArray) -> tuple[Table, ...]:
    """Read measurement tables."""
    tables = []
    for _ in range(source.count()):
        name, model = source.text(), list(MODELS)[_inside(source.number(), len(MODELS))]
        dim, robot = source.number(), source.number()
        if dim not in (2, 3):
            raise InputError(DAMAGED.format(f"a table of it has dimension {dim}"))
        loss = Loss(list(LOSSES)[_inside(source.number(), len(LOSSES))], source.real())
        sensor = _get_sensor(source)
        m, row = source.count(), MODELS[model]
        keys = known[_inside_all(source.columns(m, 1 if row.unary else 2), len(known))]
        ids = source.columns(m, 1)[:, 0]
        whitening, which = _get_whitening(source, m, row.residual_rows(dim))
        if source.number() == 0:
            kind = Kind(dim - 2)
            size = row.z_size(dim)
            values = _get_rows(source, m, kind) if row.targets_pose else source.reals(m * size).reshape(m, size)
        else:
            exponents = source.columns(len(whitening), row.residual_rows(dim))
            integers = source.columns(m, row.residual_rows(dim))
            values = _measured(np.ldexp(integers.astype(float), exponents[which]), model, dim)
        whitening = whitening if len(whitening) == 1 else whitening[which]
        tables.append(Table(robot, name, model, dim, keys, values, whitening, ids, sensor, loss))
    return tuple(tables)


def _get_sensor(source: Reader) -> Pose | None:
    dim = source.number()
    if not dim:
        return None
    if dim not in (2, 3):
        raise InputError(DAMAGED.format(f"a sensor of it has dimension {dim}"))
    mount = unpack(source.reals(Kind(dim - 2).size), Kind(dim - 2))
    assert isinstance(mount, Pose)
    return mount


def _coordinates(values: Array, model: str, dim: int) -> Array:
    """A measurement in as many numbers as its residual has rows: rotations by their Log, directions by two angles."""
    if MODELS[model].targets_pose:
        pose = unpack(values, Kind(dim - 2))
        assert isinstance(pose, Pose)
        return pose.minus(Pose.identity(dim, (len(values),)))
    if dim == 3 and model in ("bearing", "range_bearing"):
        u = values[:, -3:]
        angles = np.stack([np.arctan2(u[:, 1], u[:, 0]), np.arctan2(u[:, 2], np.hypot(u[:, 0], u[:, 1]))], -1)
        return np.concatenate([values[:, :-3], angles], -1)
    return values


def _measured(coordinates: Array, model: str, dim: int) -> Array:
    """The measurement from its coordinates."""
    if MODELS[model].targets_pose:
        return pack(Pose(rotations(dim).exp(coordinates[:, dim:]), coordinates[:, :dim]))
    if dim == 3 and model in ("bearing", "range_bearing"):
        azimuth, elevation = coordinates[:, -2], coordinates[:, -1]
        level = np.cos(elevation)
        u = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], -1)
        return np.concatenate([coordinates[:, :-2], u], -1)
    return coordinates


def _round_measured(table: Table, fineness: float) -> tuple[tuple[IntArray, IntArray], Array]:
    """Integers (m, rows) and exponents of their steps for each distinct noise, and the measurements they stand for."""
    distinct, which = _distinct_noise(table)
    scale = np.sqrt(np.sum(distinct**2, axis=1))  # 1 / sigma of each row, the others held fixed
    exponents = np.floor(np.log2(fineness / np.maximum(scale, 1e-300))).astype(np.int64)
    z = _coordinates(table.values, table.model, table.dim)
    integers = np.rint(np.ldexp(z, -exponents[which])).astype(np.int64)
    restored = _measured(np.ldexp(integers.astype(float), exponents[which]), table.model, table.dim)
    return (integers, exponents), restored


def _shift(tables: Sequence[Table], rounded: Sequence[Array]) -> float:
    total = 0.0
    for table, z in zip(tables, rounded, strict=True):
        error = table.row.minus(z, table.values, table.dim)
        total += float(np.sum((table.whitening @ error[..., None]) ** 2))
    return float(np.sqrt(total))


def _distinct_noise(table: Table) -> tuple[Array, IntArray]:
    """The distinct whitening matrices (k, r, r), and which one each row has (m,)."""
    if len(table.whitening) == 1:
        return table.whitening, np.zeros(len(table), np.int64)
    flat = table.whitening.reshape(len(table), -1)
    _, first, which = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    return table.whitening[first], which.reshape(-1)


def _put_whitening(out: Writer, table: Table, eta: float) -> float:
    """Each distinct noise once: its numbers that are not zero everywhere; single precision where eta allows that."""
    distinct, which = _distinct_noise(table)
    out.number(len(distinct))
    if len(distinct) > 1:
        out.integers(which)
    used = (distinct != 0.0).any(0)
    out.raw(np.packbits(used).tobytes())
    with np.errstate(over="ignore"):  # what single precision cannot hold goes in double
        single = distinct.astype(np.float32).astype(float)
    bound = _relative_change(distinct, single) if eta and len(distinct) > 1 else np.inf
    out.number(int(bound <= eta))
    out.reals(distinct[:, used], single=bound <= eta)
    return bound if bound <= eta else 0.0


def _get_whitening(source: Reader, m: int, rows: int) -> tuple[Array, IntArray]:
    count = source.count()
    which = _inside_all(source.integers(m), count) if count > 1 else np.zeros(m, np.int64)
    used = np.unpackbits(np.frombuffer(source.take(-(-rows * rows // 8)), np.uint8))[: rows * rows] == 1
    out = np.zeros((count, rows * rows))
    single = source.number() == 1
    out[:, used] = source.reals(count * int(used.sum()), single=single).reshape(count, -1)
    return out.reshape(count, rows, rows), which


def _relative_change(exact: Array, rounded: Array) -> float:
    """max |W^-T (W~'W~) W^-1 - 1|: how much the information of a measurement has changed."""
    change = rounded @ np.linalg.inv(exact)
    square = np.swapaxes(change, -1, -2) @ change - np.eye(exact.shape[-1])
    return float(np.abs(np.linalg.eigvalsh(square)).max())


# --- names and places ---------------------------------------------------------------------------------------------


def put_names(out: Writer, names: Names, known: IntArray, sources: Sources) -> None:
    """Write the names of what a message speaks of."""
    robots = {int(r) for r in robot_of(known[is_pose(known)])} | {s.robot for s in sources}
    landmarks = {int(n) for n in index_of(known[is_landmark(known)])}
    out.real(names.tick_s)
    for called, used in ((names.robots, robots), (names.landmarks, landmarks)):
        told = sorted((number, name) for number, name in called.items() if number in used and name != str(number))
        out.number(len(told))
        for number, name in told:
            out.number(number)
            out.text(name)


def get_names(source: Reader) -> Names:
    """Read names."""
    tick_s = source.real()
    robots, landmarks = ({source.number(): source.text() for _ in range(source.count())} for _ in range(2))
    return Names(robots, landmarks, tick_s)


def put_known(out: Writer, keys: IntArray) -> None:
    """Write the variables (sorted, unique) that a message names: by robot, as steps from one to the next."""
    robots, counts = np.unique(robot_of(keys), return_counts=True)
    out.number(len(robots))
    for robot, count in zip(robots.tolist(), counts.tolist(), strict=True):
        out.signed(robot)
        out.number(count)
        indices = index_of(keys[robot_of(keys) == robot])
        out.number(int(indices[0]))
        out.integers(np.diff(indices))


def get_known(source: Reader) -> IntArray:
    """Read the variables that a message names."""
    parts = [np.zeros(0, np.int64)]
    for _ in range(source.count()):
        robot, count, first = source.signed(), source.count(), source.number()
        if not -1 <= robot < 1 << 12 or first >= 1 << 51:
            raise InputError(DAMAGED.format("a variable in it has no possible name"))
        indices = first + np.concatenate([[0], np.cumsum(source.integers(count - 1))]).astype(np.int64)
        parts.append(np.int64(robot) << np.int64(51) | indices)
    return np.concatenate(parts)


def _put_sources(out: Writer, sources: Sources) -> None:
    logs = sorted({(s.robot, s.source) for s in sources})
    out.number(len(logs))
    for robot, name in logs:
        stretches = sorted((s.start, s.stop) for s in sources if (s.robot, s.source) == (robot, name))
        out.number(robot)
        out.text(name)
        out.number(len(stretches))
        edges = np.array(stretches, np.int64).ravel()
        out.number(int(edges[0]))
        out.integers(np.diff(edges) - 1, np.arange(len(edges) - 1) % 2)


def _get_sources(source: Reader) -> Sources:
    found = []
    for _ in range(source.count()):
        robot, name, count, first = source.number(), source.text(), source.count(), source.number()
        steps = source.integers(2 * count - 1, np.arange(2 * count - 1) % 2) + 1
        edges = first + np.concatenate([[0], np.cumsum(steps)])
        found += [Stretch(robot, name, int(a), int(b)) for a, b in edges.reshape(-1, 2).tolist()]
    return Sources(found)


def _put_places(out: Writer, places: IntArray) -> None:
    out.number(len(places))
    out.integers(np.diff(places, prepend=-1) - 1)


def _get_places(source: Reader, most: int) -> IntArray:
    count = source.count()
    return _inside_all(np.cumsum(source.integers(count) + 1) - 1, most)


def _put_pairs(out: Writer, variables: int, pairs: IntArray) -> None:
    """Which variables are coupled: nothing more to say where all are, else each one's partners as gaps."""
    complete = len(pairs) == variables * (variables + 1) // 2
    out.number(int(complete))
    if not complete:
        later = pairs[pairs[:, 0] < pairs[:, 1]]
        counts = np.bincount(later[:, 0], minlength=variables)
        out.integers(counts)
        first = np.append(True, np.diff(later[:, 0]) != 0)[: len(later)]
        out.integers(np.where(first, later[:, 1] - later[:, 0], np.diff(later[:, 1], prepend=0)) - 1)


def _get_pairs(source: Reader, variables: int) -> IntArray:
    if source.number():
        return np.stack(np.triu_indices(variables), -1)
    counts = source.integers(variables)
    if (counts < 0).any() or counts.sum() > variables**2:
        raise InputError(DAMAGED.format("it couples more variables than it has"))
    first = np.repeat(np.arange(variables), counts)
    gaps = source.integers(len(first)) + 1
    walked = np.cumsum(gaps)
    start = np.repeat(np.cumsum(counts) - counts, counts)
    before = np.concatenate([[0], walked])[start] if len(first) else walked
    second = _inside_all(first + walked - before, variables)
    own = np.arange(variables)
    pairs = np.stack([np.append(own, first), np.append(own, second)], -1)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _inside(place: int, most: int) -> int:
    if not 0 <= place < most:
        raise InputError(DAMAGED.format("it refers to something that it does not hold"))
    return place


def _inside_all(places: IntArray, most: int) -> IntArray:
    if places.size and not (places.min() >= 0 and places.max() < most):
        raise InputError(DAMAGED.format("it refers to something that it does not hold"))
    return places
