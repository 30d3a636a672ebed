"""What the six numbers after an EDGE2 are. Three programs write the same tags and mean different things:

    TORO    information, in the order I11 I12 I22 I33 I13 I23
    iSAM    R, upper triangular, with information R'R, row by row: R11 R12 R13 R22 R23 R33
    GTSAM   its copies of iSAM's files hold covariances, row by row

The order is told by the zeros, or by which order makes positive definite matrices. What they are is told by the file:
with VERTEX lines it is TORO's, without it is iSAM's, unless that makes headings uncertain by more than half a turn: no
odometry is, so the numbers are covariances. The reader says what it found; the option `noise` says otherwise.

Translations are uncertain along the axes of the observer, which are teamslam's; the angles of space are roll, pitch
and yaw, and are turned into a rotation vector to first order at the measurement.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.io.files.records import Records, triangle
from teamslam.io.graphs.edges import Fail, whitened
from teamslam.io.graphs.tags import FORMS, Tag
from teamslam.io.graphs.toro_tags import EDGES, SIGMAS, TORO
from teamslam.model import whitening, whitening_of_information

MEANINGS = ("information", "square_root", "covariance")
TRIANGLE, TORO_ORDER = (0, 1, 2, 3, 4, 5), (0, 1, 4, 2, 5, 3)  # places of 11 12 13 22 23 33
HALF_TURN = np.pi


@dataclass(frozen=True)
class Dialect:
    """How a file writes noise: what the numbers are, and the order of the six of the plane; `note` says so in words."""

    meaning: str
    order: tuple[int, ...]
    note: str | None


def dialect_of(records: Sequence[Records], stated: str | None) -> Dialect:
    """The dialect of a file's lines; `stated` is what the reader was told that the numbers are (None: nothing)."""
    tags = {lines.tag for lines in records}
    numbers = [_numbers(lines, EDGES[lines.tag]) for lines in records if lines.tag in EDGES and lines.tag not in SIGMAS]
    plane = np.concatenate([np.zeros((0, 6)), *(found for found in numbers if found.shape[1] == 6)])
    with_vertices = bool(tags & set(TORO))
    order = _order(plane, TORO_ORDER if with_vertices else TRIANGLE)
    if stated is not None:
        return Dialect(stated, order, None)
    if all(np.isin(found, (0.0, 1.0)).all() for found in numbers):
        return Dialect("information", order, None)  # of ones and zeros all meanings are the same
    if with_vertices or order == TORO_ORDER:
        return Dialect("information", order, "noise is read as information, as TORO's graphs have it")
    if len(plane) and np.median(1.0 / np.maximum(np.abs(plane[:, 5]), 1e-300)) > HALF_TURN:
        why = "as iSAM's square roots of information, headings would be uncertain by more than half a turn"
        return Dialect("covariance", order, f"noise is read as covariances: {why}")
    return Dialect("square_root", order, "noise is read as square roots of information, as iSAM's graphs have it")


def _numbers(records: Records, tag: Tag) -> Array:
    """The noise (m, triangle) of the lines that state it."""
    start, count = len(tag.ends) + tag.numbers, triangle(tag.rows)
    whole = np.array([len(words) == start + count for words in records.words], bool)
    return records.select(whole).floats(start, ["a number of the noise"] * count)


def _order(six: Array, otherwise: tuple[int, ...]) -> tuple[int, ...]:
    """The order in which the rows (n, 6) are matrices whose diagonals are above zero; where both are, `otherwise`."""
    good = [bool((six[:, [order[k] for k in (0, 3, 5)]] > 0.0).all()) for order in (TRIANGLE, TORO_ORDER)]
    if good[0] == good[1]:
        return otherwise
    return TRIANGLE if good[0] else TORO_ORDER


def whitening_of(records: Records, tag: Tag, start: int, values: Array, dialect: Dialect) -> Array:
    """W (n, r, r) of lines whose noise begins at the word `start`; of lines without noise, the unit matrix."""
    if len(records) and len(records.words[0]) == start:
        return np.broadcast_to(np.eye(tag.rows), (len(records), tag.rows, tag.rows)).copy()
    if records.tag in SIGMAS:
        sigmas = records.floats(start, [f"sigma of {name}" for name in FORMS[tag.form].names])
        records.refuse(sigmas.min(1) <= 0.0, "a standard deviation is above zero", "sigma")
        return np.asarray(np.eye(tag.rows) / sigmas[:, None, ::-1])
    numbers = records.floats(start, ["a number of the noise"] * triangle(tag.rows))
    if tag.form == "xytheta":
        numbers = numbers[:, dialect.order]
    matrix = np.zeros((len(records), tag.rows, tag.rows))
    above = np.triu_indices(tag.rows)
    matrix[:, above[0], above[1]] = numbers
    found = _whitened(matrix, dialect.meaning, records.error)
    return found @ _of_rotation_vector(values, records.error) if tag.form == "euler" else found


def _whitened(upper: Array, meaning: str, fail: Fail) -> Array:
    """W of upper triangles (n, r, r)."""
    if meaning == "square_root":
        lost = np.flatnonzero((np.diagonal(upper, axis1=1, axis2=2) < 0.0).any(1))
        if len(lost):
            raise fail(int(lost[0]), "a square root of information has a diagonal of 0 or more")
        return upper
    full = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
    return whitened(whitening_of_information if meaning == "information" else whitening, full, fail)


def _of_rotation_vector(values: Array, fail: Fail) -> Array:
    """d(x y z roll pitch yaw) / d(translation, rotation vector on the right), (n, 6, 6), at measured poses (n, 12)."""
    rotation = values[:, 3:].reshape(-1, 3, 3)
    sine = np.clip(-rotation[:, 2, 0], -1.0, 1.0)
    cosine = np.hypot(rotation[:, 2, 1], rotation[:, 2, 2])
    upright = np.flatnonzero(cosine < 1e-6)
    if len(upright):
        raise fail(int(upright[0]), "a pitch of 90 degrees: roll and yaw, and so their noise, have no meaning there")
    s, c = rotation[:, 2, 1] / cosine, rotation[:, 2, 2] / cosine  # of roll
    body = np.zeros((len(values), 3, 3))  # rotation vector = body @ (roll, pitch, yaw)
    body[:, 0, 0] = 1.0
    body[:, 0, 2] = -sine
    body[:, 1, 1], body[:, 1, 2] = c, s * cosine
    body[:, 2, 1], body[:, 2, 2] = -s, c * cosine
    out = np.broadcast_to(np.eye(6), (len(values), 6, 6)).copy()
    out[:, 3:, 3:] = np.linalg.inv(body)
    return out
