"""teamslam's own submap file, which is also what robots send each other.

    magic "TSSUBMAP" | version of the format (2 bytes) | length of the content (8 bytes) | content | blake2b (32 bytes)

All little-endian; the content is MessagePack of `_Content`, arrays as dtype, shape and bytes, the information matrix as
its upper triangle, so that it is symmetric by construction. The same submap gives the same bytes on every machine. The
digest is over everything before it.

Reading trusts nothing: lengths are checked before memory is taken, the digest before the content is looked at, and then
that the content means something: known kinds, keys once each, the base not among them, rotations that are rotations,
indices in range, every number finite, the information positive definite (by factorisation). What fails is an InputError
with the reason.
"""

import hashlib
import math
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import AnyArray, Array, Pose
from teamslam.io.files.whole import whole_file
from teamslam.io.submaps.soundness import check_keys, check_numbers, check_raw, check_rotations, check_table
from teamslam.model import (
    WORLD,
    Dropped,
    Kind,
    Layout,
    Loss,
    Names,
    Sources,
    Stretch,
    Submap,
    Table,
    Values,
    is_parameter,
    is_pose,
    pack,
)
from teamslam.model.keys import MAX_ROBOT
from teamslam.model.sparse import sp

MAGIC = b"TSSUBMAP"
FORMAT = 1
HEADER = struct.Struct("<8sHQ")
DIGEST_BYTES = 32
SUFFIX = ".submap"
DENSE = 400  # unknowns up to which a dense factorisation is the quicker check


class _Array(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    dtype: Literal["<f8", "<i8"]
    shape: tuple[int, ...]
    data: bytes


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    robot: int
    source: str
    model: str
    dim: int
    keys: _Array
    values: _Array
    whitening: _Array
    ids: _Array
    sensor: _Array | None
    loss: str
    loss_scale: float


class _Content(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    id: str
    version: int
    base: int
    base_dim: int
    keys: _Array
    kinds: _Array
    state: _Array
    indptr: _Array
    indices: _Array
    data: _Array
    sources: list[tuple[int, str, int, int]]
    robots: list[tuple[int, str]]
    landmarks: list[tuple[int, str]]
    tick_s: float
    raw: list[_Table]
    cost: float
    chi2: float
    rows: int


# --- files ------------------------------------------------------------------------------------------------------------


def sniff(path: Path) -> bool:
    """A submap file, or a folder of them."""
    if path.is_dir():
        return any(path.glob(f"*{SUFFIX}"))
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def read(path: Path, *, prove: bool = True) -> list[Submap]:
    """The submap in a file, or those of a folder by name; `prove` as in `read_submap`. InputError names the file that
    cannot be read."""
    if not path.is_dir():
        return [read_submap(path, prove=prove)]
    files = sorted(path.glob(f"*{SUFFIX}"))
    if not files:
        raise InputError(f"expected files *{SUFFIX} in this folder, found none", path=path)
    return [read_submap(file, prove=prove) for file in files]


def write(submaps: Sequence[Submap], path: Path) -> tuple[Dropped, ...]:
    """Writes one submap into a file `*.submap`, or several into a folder, named by their place and id."""
    if path.suffix == SUFFIX:
        if len(submaps) != 1:
            raise InputError(f"a file holds one submap, found {len(submaps)}; give a folder's name", path=path)
        write_submap(submaps[0], path)
        return ()
    width = len(str(len(submaps)))
    for number, submap in enumerate(submaps, 1):
        write_submap(submap, path / f"{number:0{width}}_{file_name(submap)}")
    return ()


def file_name(submap: Submap) -> str:
    """What a submap's file is called, after its id."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", submap.id)[:80] + SUFFIX


def read_submap(path: str | Path, *, prove: bool = True) -> Submap:
    """The submap in a file. InputError says what is wrong with it.

    `prove`: factorise the information to see that it is positive definite, which is most of the work; False where the
    caller does so, and for files that it has written itself, whose digest shows that they are as they were.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError("there is no such file; check the path", path=path) from None
    except OSError as error:
        raise InputError(f"the file cannot be read: {error.strerror or error}", path=path) from None
    try:
        return submap_from_bytes(content, prove=prove)
    except InputError as error:
        raise InputError(error.problem, path=path, field=error.field) from None


def write_submap(submap: Submap, path: str | Path) -> None:
    """Writes a submap's file, whole or not at all. Law: read_submap gives the same submap."""
    path = Path(path)
    parts = _message(submap)
    try:
        with whole_file(path) as file:
            file.writelines(parts)
    except OSError as error:
        raise InputError(f"the file cannot be written: {error.strerror or error}", path=path) from None


# --- bytes ------------------------------------------------------------------------------------------------------------


def submap_to_bytes(submap: Submap) -> bytes:
    """The submap as a message. The same submap gives the same bytes."""
    return b"".join(_message(submap))


def _message(submap: Submap) -> tuple[bytes, bytes, bytes]:
    """Head, content and digest, which together are the message: large ones are not copied once more for that."""
    upper = _upper(submap.information)
    layout = submap.values.layout
    content = _Content(
        id=submap.id,
        version=int(submap.version),
        base=int(submap.base),
        base_dim=int(submap.base_dim),
        keys=_packed(layout.keys),
        kinds=_packed(layout.kinds),
        state=_packed(submap.values.state),
        indptr=_packed(upper.indptr),
        indices=_packed(upper.indices),
        data=_packed(upper.data),
        sources=[(s.robot, s.source, s.start, s.stop) for s in submap.sources],
        robots=sorted(submap.names.robots.items()),
        landmarks=sorted(submap.names.landmarks.items()),
        tick_s=float(submap.names.tick_s),
        raw=[_packed_table(table) for table in submap.raw],
        cost=float(submap.cost),
        chi2=float(submap.chi2),
        rows=int(submap.rows),
    )
    body = msgspec.msgpack.encode(content)
    head = HEADER.pack(MAGIC, FORMAT, len(body))
    return head, body, _digest(head, body)


def _upper(matrix: sp.csr_array) -> sp.csr_array:
    """The upper triangle of 0.5 (A + A'), by rising columns and without zeros."""
    across = sp.csr_array(matrix.T)
    if matrix.has_canonical_format and _equal(matrix, across):
        symmetric = matrix
    else:
        symmetric = sp.csr_array(0.5 * (matrix + across))
        symmetric.sum_duplicates()
    rows = np.repeat(np.arange(symmetric.shape[0], dtype=symmetric.indices.dtype), np.diff(symmetric.indptr))
    kept = (symmetric.indices >= rows) & (symmetric.data != 0.0)
    starts = np.append(0, np.cumsum(np.bincount(rows[kept], minlength=symmetric.shape[0])))
    return sp.csr_array((symmetric.data[kept], symmetric.indices[kept], starts), shape=symmetric.shape)


def _equal(a: sp.csr_array, b: sp.csr_array) -> bool:
    return all(np.array_equal(getattr(a, part), getattr(b, part)) for part in ("indptr", "indices", "data"))


def submap_from_bytes(message: bytes, *, prove: bool = True) -> Submap:
    """The submap in a message. InputError says what is wrong with it; `prove` as in `read_submap`.

    Law: submap_from_bytes(submap_to_bytes(s)) is s, to the bit where its information is exactly symmetric.
    """
    content = _decoded(message)
    try:
        values = Values(_layout(content), _unpacked(content.state, "state", "<f8", 1))
        _check_values(values)
        _check_base(content)
        information = _information(content, values.layout.dof, prove)
        submap = Submap(
            id=content.id,
            version=content.version,
            base=content.base,
            base_dim=content.base_dim,
            values=values,
            information=information,
            sources=_sources(content),
            names=_names(content),
            raw=tuple(_unpacked_table(table) for table in content.raw),
            cost=_not_negative(content.cost, "cost"),
            chi2=_not_negative(content.chi2, "chi2"),
            rows=int(_not_negative(content.rows, "rows")),
        )
        check_raw(submap)
        return submap
    except ModelError as error:
        raise InputError(str(error)) from None


def _decoded(message: bytes) -> _Content:
    if len(message) < HEADER.size + DIGEST_BYTES:
        raise InputError(f"a submap file has at least {HEADER.size + DIGEST_BYTES} bytes, found {len(message)}")
    magic, version, length = HEADER.unpack_from(message)
    if magic != MAGIC:
        raise InputError(f"this is no submap file: it begins with {magic!r}, expected {MAGIC!r}")
    if version != FORMAT:
        raise InputError(f"the file is of version {version}, this teamslam reads version {FORMAT}; update teamslam")
    expected = HEADER.size + length + DIGEST_BYTES
    if len(message) != expected:
        raise InputError(f"the file states {expected} bytes and has {len(message)}: it was cut off or added to")
    if _digest(memoryview(message)[:-DIGEST_BYTES]) != message[-DIGEST_BYTES:]:
        raise InputError("the digest does not fit the content: the file is damaged; fetch it again")
    try:
        return msgspec.msgpack.decode(message[HEADER.size : -DIGEST_BYTES], type=_Content)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"the content is not that of a submap: {error}") from None


def _digest(*parts: bytes | memoryview) -> bytes:
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for part in parts:
        digest.update(part)
    return digest.digest()


def _packed(array: AnyArray) -> _Array:
    kind: Literal["<f8", "<i8"] = "<f8" if array.dtype.kind == "f" else "<i8"
    return _Array(kind, array.shape, np.ascontiguousarray(array, kind).tobytes())


def _unpacked(array: _Array, name: str, dtype: str, axes: int) -> AnyArray:
    """The array, which is of this type and number of axes and holds what its shape says."""
    if array.dtype != dtype or len(array.shape) != axes or min(array.shape, default=0) < 0:
        raise InputError(f"expected {axes} axes of {dtype}, found {array.shape} of {array.dtype}", field=name)
    if math.prod(array.shape) * 8 != len(array.data):
        raise InputError(f"the shape {array.shape} does not fit {len(array.data)} bytes", field=name)
    found = np.frombuffer(array.data, dtype).reshape(array.shape).astype(dtype[1:])
    check_numbers(found, name)
    return found


def _packed_table(table: Table) -> _Table:
    return _Table(
        robot=int(table.robot),
        source=table.source,
        model=table.model,
        dim=int(table.dim),
        keys=_packed(table.keys),
        values=_packed(table.values),
        whitening=_packed(table.whitening),
        ids=_packed(table.ids),
        sensor=None if table.sensor is None else _packed(pack(table.sensor)),
        loss=table.loss.name,
        loss_scale=float(table.loss.scale),
    )


def _unpacked_table(content: _Table) -> Table:
    sensor = None
    if content.sensor is not None:
        row = _unpacked(content.sensor, "sensor", "<f8", 1)
        if len(row) not in (6, 12):
            raise InputError(f"a sensor's pose has 6 or 12 numbers, found {len(row)}", field="sensor")
        dim = 2 if len(row) == 6 else 3
        sensor = Pose(row[dim:].reshape(dim, dim), row[:dim])
    table = Table(
        robot=content.robot,
        source=content.source,
        model=content.model,
        dim=content.dim,
        keys=_unpacked(content.keys, "raw keys", "<i8", 2),
        values=_unpacked(content.values, "raw values", "<f8", 2),
        whitening=_unpacked(content.whitening, "raw whitening", "<f8", 3),
        ids=_unpacked(content.ids, "raw ids", "<i8", 1),
        sensor=sensor,
        loss=Loss(content.loss, content.loss_scale),
    )
    check_table(table)
    return table


# --- meaning ----------------------------------------------------------------------------------------------------------


def _layout(content: _Content) -> Layout:
    keys, kinds = _unpacked(content.keys, "keys", "<i8", 1), _unpacked(content.kinds, "kinds", "<i8", 1)
    if ((kinds < 0) | (kinds >= len(Kind))).any():
        raise InputError(f"kinds of variables are 0 to {len(Kind) - 1}", field="kinds")
    points = kinds > Kind.POSE3 if len(kinds) == len(keys) else np.zeros(len(keys), bool)
    check_keys(keys[~(is_parameter(keys) & points)])
    if (is_pose(keys) & points).any():
        raise InputError("a robot's pose is stored as a point", field="kinds")
    return Layout(keys, kinds)


def _check_base(content: _Content) -> None:
    if content.base_dim not in (2, 3):
        raise InputError(f"the base lives in the plane (2) or in space (3), found {content.base_dim}", field="base_dim")
    if content.base != WORLD and not 1 <= content.base >> 51 <= MAX_ROBOT:
        raise InputError(f"the base {content.base} is neither a robot's pose nor the world frame", field="base")
    if not content.id or content.version < 0:
        raise InputError("a submap needs an id and a version that is not negative", field="id")


def _check_values(values: Values) -> None:
    for kind, _, data in values.parts():
        if kind.is_pose and isinstance(data, Pose):
            check_rotations(data)


def _information(content: _Content, dof: int, prove: bool) -> sp.csr_array:
    """The whole symmetric matrix of the upper triangle stored."""
    indptr, indices = _unpacked(content.indptr, "indptr", "<i8", 1), _unpacked(content.indices, "indices", "<i8", 1)
    data = _unpacked(content.data, "information", "<f8", 1)
    if len(indptr) != dof + 1 or indptr[0] != 0 or indptr[-1] != len(indices) or (np.diff(indptr) < 0).any():
        raise InputError(f"the row starts of the information do not fit {dof} unknowns", field="indptr")
    if len(indices) != len(data):
        raise InputError(f"{len(indices)} columns for {len(data)} numbers of the information", field="indices")
    rows = np.repeat(np.arange(dof), np.diff(indptr))
    if len(indices) and (indices.max() >= dof or (indices < rows).any()):
        raise InputError("a column of the information's upper triangle is out of range", field="indices")
    if ((np.diff(rows) == 0) & (np.diff(indices) <= 0)).any():
        raise InputError("the columns of a row of the information should rise", field="indices")
    if dof <= DENSE:
        whole = np.zeros((dof, dof))
        whole[rows, indices] = whole[indices, rows] = data
        information, sound = _sparse(whole), not prove or _definite(whole)
    else:
        upper = sp.csr_array((data, indices, indptr), shape=(dof, dof))
        information = sp.csr_array(upper + sp.triu(upper, 1, format="csr").T)
        information.sort_indices()
        sound = not prove or positive_definite(information)
    if not sound:
        raise InputError("the information is not positive definite: the map is not determined", field="information")
    return information


def _sparse(matrix: Array) -> sp.csr_array:
    """A dense matrix by rows; scipy's own way there is longer."""
    rows, columns = np.nonzero(matrix)
    starts = np.searchsorted(rows, np.arange(len(matrix) + 1))
    return sp.csr_array((matrix[rows, columns], columns.astype(np.int32), starts.astype(np.int32)), shape=matrix.shape)


def _definite(matrix: Array) -> bool:
    """True where a dense symmetric matrix is positive definite, scaled to a unit diagonal so that units do not
    matter."""
    diagonal = np.diagonal(matrix)
    if not (diagonal > 0.0).all():
        return False
    scale = 1.0 / np.sqrt(diagonal)
    scaled = matrix * scale[:, None] * scale
    if not np.isfinite(scaled).all():
        return False
    try:
        np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return False
    return True


def positive_definite(matrix: sp.csr_array) -> bool:
    """True where a symmetric matrix is positive definite, by factorisation, as `_definite` has it."""
    from scipy.sparse.linalg import splu

    if matrix.shape[0] <= DENSE:
        return _definite(matrix.toarray())
    diagonal = matrix.diagonal()
    if not (diagonal > 0.0).all():
        return False
    scale = sp.diags_array(1.0 / np.sqrt(diagonal))
    scaled = sp.csc_array(scale @ matrix @ scale)
    if not np.isfinite(scaled.data).all():
        return False
    try:
        factor = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return False
    # Without pivoting off the diagonal, U's diagonal is D of L D L', positive where the matrix is positive definite.
    return bool(np.array_equal(factor.perm_r, factor.perm_c) and (factor.U.diagonal() > 0.0).all())


def _sources(content: _Content) -> Sources:
    for robot, source, start, stop in content.sources:
        if not (1 <= robot <= MAX_ROBOT and source and 0 <= start < stop < 1 << 62):
            raise InputError(f"robot {robot}'s rows {start} to {stop} of '{source}' are none", field="sources")
    stretches = [Stretch(*entry) for entry in content.sources]
    for first, second in zip(sorted(stretches), sorted(stretches)[1:], strict=False):
        if (first.robot, first.source) == (second.robot, second.source) and second.start < first.stop:
            raise InputError(f"robot {first.robot}'s rows of '{first.source}' are counted twice", field="sources")
    return Sources(stretches)


def _names(content: _Content) -> Names:
    if not (math.isfinite(content.tick_s) and content.tick_s > 0.0):
        raise InputError(f"a tick lasts longer than 0 s, found {content.tick_s}", field="tick_s")
    return Names(dict(content.robots), dict(content.landmarks), content.tick_s)


def _not_negative(number: float, name: str) -> float:
    if not (math.isfinite(number) and number >= 0.0):
        raise InputError(f"expected a number that is not negative, found {number}", field=name)
    return number
