"""JSON robot logs (.jrl): a team's factors robot by robot, with true values, initial values and labels of outliers.

    {"name", "robots": ["a", ...], "measurements": {"a": [{"stamp", "measurements": [factor, ...]}, ...]},
     "groundtruth", "initialization": {"a": [{"key", "type", ...}, ...]},
     "potential_outlier_factors", "outlier_factors": {"a": [[entry, measurement], ...]}}

Factors read: those of `FACTORS`; others are left out and counted by their name. A factor belongs to the robot whose
pose it starts from. Keys are GTSAM's symbols: the top byte is the robot's letter (a, b, c are robots 1, 2, 3), the rest
counts poses; stamps of entries have no unit and are not used. Keys that a factor uses as points are landmarks.

Noise: covariances are row-major in GTSAM's charts, the right tangent of SE(2) and SE(3), the latter with its rotation
first; they are converted to the mixed chart to first order at the measurement (`charts`), and back on writing. Bearings
come before ranges; those in space have a covariance in GTSAM's basis of the sphere's tangents, which is turned into
teamslam's. Source: the public format documents of JRL (Daniel McGann).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io.files.garbage import uncollected
from teamslam.io.files.json_column import JsonColumn
from teamslam.io.files.json_place import Json, read_json
from teamslam.io.files.options import options_of
from teamslam.io.graphs.edges import Edges, matching, robots_of, tables_of, values_of, whitened
from teamslam.io.graphs.jrl_factors import FACTORS, Factor
from teamslam.io.graphs.jrl_keys import LARGEST_SYMBOL, keys_of, of_landmarks
from teamslam.io.graphs.jrl_noise import covariance_here
from teamslam.io.graphs.jrl_values import bearings_ranges, by_kind, last_of_each, poses_or_points, ranges
from teamslam.io.graphs.jrl_writer import NOTE, lacks, write
from teamslam.io.graphs.naming import names_in
from teamslam.io.graphs.symbols import LOWER_FIRST, landmark_numbers
from teamslam.model import (
    MODELS,
    Dataset,
    Dropped,
    Kind,
    Names,
    Values,
    point_kind,
    pose_kind,
    robot_of,
    whitening,
)

__all__ = ["Options", "lacks", "read", "sniff", "write"]


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whether measurements labelled as outliers are left out (and counted)."""

    drop_outliers: bool = False


def sniff(path: Path) -> bool:
    """A file *.jrl."""
    return path.is_file() and path.suffix == ".jrl"


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a JRL file; `options` as in `Options`.

    InputError names the file and the place in it (as `measurements.a[3].measurements[0].covariance`) of what cannot be
    read: damaged JSON, missing or strange entries, covariances of the wrong size or not positive definite.
    """
    chosen = options_of(Options, options, reader="jrl")
    with uncollected():
        return _Content(read_json(path)).dataset(str(path), chosen.drop_outliers)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Factors of one model and dimension: their places in the file and in the order of all that are known, and what
    their k keys are, as symbols; `landmarks` (m, k) says which of these are landmarks'."""

    model: str
    dim: int
    places: JsonColumn
    order: IntArray
    symbols: Sequence[Sequence[int]]  # k columns
    landmarks: BoolArray

    def marks(self) -> Iterator[int]:
        """The symbols of landmarks."""
        for symbols, landmarks in zip(self.symbols, self.landmarks.T, strict=True):
            yield from compress(symbols, landmarks)


@dataclass
class _Content:
    """A file's content on its way to a Dataset."""

    root: Json
    unknown: dict[str, int] = field(default_factory=dict)
    marks: dict[int, int] = field(default_factory=dict)  # the number of each landmark's symbol
    labelled: int = 0

    def dataset(self, origin: str, drop_outliers: bool) -> Dataset:
        """Everything as one Dataset."""
        factors = self._factors(drop_outliers)
        if not factors:
            raise InputError(f"no factor that teamslam knows ({', '.join(FACTORS)})", path=origin)
        self.marks = landmark_numbers({symbol for rows in factors for symbol in rows.marks()})
        edges = [self._edges(rows) for rows in factors]
        seen = np.unique(robot_of(np.concatenate([part.keys.ravel() for part in edges])))
        letters = {robot: str(LOWER_FIRST.letter(robot)) for robot in seen.tolist() if robot}
        dataset = Dataset(robots_of(edges, letters), tables_of(edges), self._names(letters), origin=origin)
        truth, no_truth = matching(self._values("groundtruth"), dataset)
        initial, no_initial = matching(self._values("initialization"), dataset)
        counts = [
            (no_truth + no_initial, "values of variables that no measurement names"),
            (self.labelled if drop_outliers else 0, "measurements labelled as outliers"),
            *((n, f"factors of the unknown type {name[:60]}") for name, n in self.unknown.items()),
        ]
        dropped = tuple(Dropped(n, reason) for n, reason in counts if n)
        return replace(dataset, truth=truth, initial=initial, dropped=dropped)

    def _names(self, letters: Mapping[int, str]) -> Names:
        """The names in teamslam's note, or the robots' letters."""
        if not self.root.has(NOTE):
            return Names(dict(sorted(letters.items())), {}, 1.0)
        try:
            return names_in(self.root.get(NOTE).value)
        except ValueError as error:
            raise self.root.get(NOTE).error(f"{error}; remove it") from None

    def _factors(self, drop_outliers: bool) -> list[_Rows]:
        """All known factors, those of each model and dimension together, labelled outliers left out where asked."""
        robots = self.root.get("measurements").items()
        entries, robot, number = JsonColumn.of(self.root.path, [place for _, place in robots]).elements()
        full = entries.have("measurements")
        places, entry, m = entries.select(full).get("measurements").elements()
        robot, number = robot[full][entry], number[full][entry]
        labelled = np.zeros(len(places), bool)
        for k, (letter, _) in enumerate(robots):
            if outliers := self._outliers(letter):
                own = np.flatnonzero(robot == k)
                pairs = zip(number[own].tolist(), m[own].tolist(), strict=True)
                labelled[own] = [pair in outliers for pair in pairs]
        self.labelled = int(labelled.sum())
        names = places.get("type").texts()
        for name in names:
            if name not in FACTORS:
                self.unknown[name] = self.unknown.get(name, 0) + 1
        kept = np.array([name in FACTORS for name in names], bool) & ~(labelled & drop_outliers)
        return _together(places.select(kept), [FACTORS[name] for name in compress(names, kept)])

    def _outliers(self, letter: str) -> set[tuple[int, int]]:
        if not self.root.has("outlier_factors"):
            return set()
        labels = self.root.get("outlier_factors")
        if isinstance(labels.value, dict):
            if not labels.has(letter):
                return set()
            labels = labels.get(letter)
        pairs = [[number.whole() for number in pair.elements()] for pair in labels.elements()]
        if any(len(pair) != 2 for pair in pairs):
            raise labels.error("a label is a pair: the entry's number, the measurement's number")
        return {(pair[0], pair[1]) for pair in pairs}

    def _edges(self, rows: _Rows) -> Edges:
        """Factors of one model and dimension."""
        ends = zip(rows.symbols, rows.landmarks.T, strict=True)
        keys = np.stack([keys_of(symbols, landmarks, self.marks, rows.places) for symbols, landmarks in ends], -1)
        if len(rows.symbols) == 2:
            rows.places.refuse(keys[:, 0] == keys[:, 1], lambda _: "the factor goes from a variable to itself")
        values = _measured(rows)
        size = MODELS[rows.model].residual_rows(rows.dim)
        covariances = rows.places.get("covariance").rows(size * size, f"a matrix {size} x {size}, row by row")
        noise = covariance_here(covariances.reshape(-1, size, size), values, rows.model, rows.dim)

        def fail(row: int, problem: str) -> InputError:
            return rows.places.place(row).error(problem)

        body = np.full(len(keys), -1)
        return Edges(rows.model, rows.dim, keys, values, whitened(whitening, noise, fail), rows.order, body, fail)

    def _values(self, name: str) -> Values | None:
        """Poses and landmarks of all robots, the last of those that stand twice; other types are of no use here."""
        if not self.root.has(name):
            return None
        found: dict[Kind, list[tuple[IntArray, Array]]] = {}
        for _, robot in self.root.get(name).items():
            for kind, symbols, places in by_kind(robot):
                landmarks = of_landmarks(symbols, not kind.is_pose)
                known = ~landmarks | np.array([symbol in self.marks for symbol in symbols], bool)
                places = places.select(known)
                keys = keys_of(list(compress(symbols, known)), landmarks[known], self.marks, places)
                found.setdefault(kind, []).append((keys, poses_or_points(places, kind)))
        return values_of((kind, *last_of_each(parts)) for kind, parts in found.items())


def _together(places: JsonColumn, factors: Sequence[Factor]) -> list[_Rows]:
    """Factors (n,), those of each model and dimension together."""
    groups: dict[tuple[str, int, int], int] = {}
    which = np.array([groups.setdefault((f.model, f.dim, len(f.ends)), len(groups)) for f in factors], np.int64)
    found = []
    for (model, dim, count), group in groups.items():
        order = np.flatnonzero(which == group)
        rows = places.select(order)
        symbols = [_symbols(rows, name) for name in (("key",) if count == 1 else ("key1", "key2"))]
        points = np.array([[not end.is_pose for end in factors[row].ends] for row in order.tolist()])
        landmarks = np.stack([of_landmarks(*end) for end in zip(symbols, points.T, strict=True)], -1)
        found.append(_Rows(model, dim, rows, order, symbols, landmarks))
    return found


def _measured(rows: _Rows) -> Array:
    """What factors measured, as rows of MODELS (m, size)."""
    measured = rows.places.get("prior" if len(rows.symbols) == 1 else "measurement")
    if rows.model == "range":
        return ranges(measured)[:, None]
    if rows.model == "range_bearing":
        return bearings_ranges(measured, rows.dim)
    return poses_or_points(measured, pose_kind(rows.dim) if rows.model != "position" else point_kind(rows.dim))


def _symbols(places: JsonColumn, name: str) -> Sequence[int]:
    """The keys of factors as the file has them."""
    symbols = places.get(name).wholes()
    bad = np.array([not 0 <= symbol <= LARGEST_SYMBOL for symbol in symbols], bool)
    places.refuse(bad, lambda row: f"keys run from 0 to 2^63 - 1, found {symbols[row]}")
    return symbols
