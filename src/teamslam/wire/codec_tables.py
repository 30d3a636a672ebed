"""Measurement tables as fields of a message, to the bit or rounded within a stated bound."""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose, directions, rotations
from teamslam.model import (
    LOSSES,
    MODELS,
    Kind,
    Loss,
    Table,
    pack,
    ranks,
    unpack,
)
from teamslam.wire.codec_places import inside, inside_all
from teamslam.wire.packing import DAMAGED, Reader, Writer
from teamslam.wire.rounding import (
    EXACT,
    Precision,
)


def put_tables(out: Writer, tables: Sequence[Table], known: IntArray, precision: Precision) -> Precision:
    """Write measurement tables, which share one bound on the shift: sqrt(sum |W (z~ - z)|^2)."""
    out.number(len(tables))
    numbers = sum(t.dof for t in tables)
    exact = not precision.shift_sigma
    fineness = 0.0 if exact else precision.shift_sigma * np.sqrt(12.0 / max(numbers, 1))
    rounded = [_rounded(t, fineness, exact) for t in tables]
    while not exact and (shift := _shift(tables, [z for _, z in rounded])) > precision.shift_sigma:
        fineness *= 0.9
        rounded = [_rounded(t, fineness, exact) for t in tables]
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
            kind = Kind(table.dim - 2) if table.row.measures_pose else Kind.POINT2
            out.number(0)
            put_rows(out, table.values, kind) if kind.is_pose else out.reals(table.values)
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
        name, model = source.text(), list(MODELS)[inside(source.number(), len(MODELS))]
        dim, robot = source.number(), source.number()
        if dim not in (2, 3):
            raise InputError(DAMAGED.format(f"a table of it has dimension {dim}"))
        loss = Loss(list(LOSSES)[inside(source.number(), len(LOSSES))], source.real())
        sensor = _get_sensor(source)
        m, row = source.count(), MODELS[model]
        keys = known[inside_all(source.columns(m, 1 if row.unary else 2), len(known))]
        ids = source.columns(m, 1)[:, 0]
        whitening, which = _get_whitening(source, m, row.residual_rows(dim))
        if source.number() == 0:
            kind = Kind(dim - 2)
            size = row.z_size(dim)
            values = get_rows(source, m, kind) if row.measures_pose else source.reals(m * size).reshape(m, size)
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
    if MODELS[model].measures_pose:
        pose = unpack(values, Kind(dim - 2))
        assert isinstance(pose, Pose)
        return pose.minus(Pose.identity(dim, (len(values),)))
    if model in ("bearing", "range_bearing"):
        sphere = directions(dim)
        return np.concatenate([values[:, : -sphere.SIZE], sphere.angles(values[:, -sphere.SIZE :])], -1)
    return values


def _measured(coordinates: Array, model: str, dim: int) -> Array:
    """The measurement from its coordinates."""
    if MODELS[model].measures_pose:
        return pack(Pose(rotations(dim).exp(coordinates[:, dim:]), coordinates[:, :dim]))
    if model in ("bearing", "range_bearing"):
        sphere = directions(dim)
        return np.concatenate([coordinates[:, : -sphere.DOF], sphere.of_angles(coordinates[:, -sphere.DOF :])], -1)
    return coordinates


def _rounded(table: Table, fineness: float, exact: bool) -> tuple[tuple[IntArray, IntArray] | None, Array]:
    """As `_round_measured`; to the bit where that is asked for, and where a row holds what was not measured."""
    return (None, table.values) if exact or table.row.given else _round_measured(table, fineness)


def _round_measured(table: Table, fineness: float) -> tuple[tuple[IntArray, IntArray], Array]:
    """Integers (m, rows) and exponents of their steps for each distinct noise, and the measurements they stand for."""
    distinct, which = _distinct_noise(table)
    scale = np.sqrt(np.sum(distinct**2, axis=1))  # 1 / sigma of each row, the others held fixed
    scale = np.maximum(scale, 1e-3 * scale.max(1, keepdims=True) + 1e-300)  # what is left open turns with the rest
    exponents = np.floor(np.log2(fineness / scale)).astype(np.int64)
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
    which = inside_all(source.integers(m), count) if count > 1 else np.zeros(m, np.int64)
    used = np.unpackbits(np.frombuffer(source.take(-(-rows * rows // 8)), np.uint8))[: rows * rows] == 1
    out = np.zeros((count, rows * rows))
    single = source.number() == 1
    out[:, used] = source.reals(count * int(used.sum()), single=single).reshape(count, -1)
    return out.reshape(count, rows, rows), which


def _relative_change(exact: Array, rounded: Array) -> float:
    """max |W^-T (W~'W~) W^-1 - 1|: how much the information of a measurement has changed; infinite where W is
    singular, since what says nothing must not begin to."""
    if (ranks(exact) < exact.shape[-1]).any():
        return np.inf
    change = rounded @ np.linalg.inv(exact)
    square = np.swapaxes(change, -1, -2) @ change - np.eye(exact.shape[-1])
    return float(np.abs(np.linalg.eigvalsh(square)).max())


def put_rows(out: Writer, rows: Array, kind: Kind) -> None:
    """Rows of a state vector to the bit; of planar rotations only the first column where it gives the second."""
    short = kind == Kind.POSE2 and _second_column(rows[:, [2, 4]]).tobytes() == rows[:, [3, 5]].tobytes()
    out.number(int(short))
    out.reals(rows[:, [0, 1, 2, 4]] if short else rows)


def get_rows(source: Reader, count: int, kind: Kind) -> Array:
    if not source.number():
        return source.reals(count * kind.size).reshape(count, kind.size)
    x = source.reals(count * 4).reshape(count, 4)
    second = _second_column(x[:, 2:])
    return np.stack([x[:, 0], x[:, 1], x[:, 2], second[:, 0], x[:, 3], second[:, 1]], -1)


def _second_column(first: Array) -> Array:
    return np.stack([-first[:, 1], first[:, 0]], -1)
