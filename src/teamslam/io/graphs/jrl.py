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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.io.files.json_place import Json, read_json
from teamslam.io.files.options import options_of
from teamslam.io.graphs.edges import Edges, matching, robots_of, tables_of, values_of, whitened
from teamslam.io.graphs.jrl_factors import FACTORS, KINDS, Factor
from teamslam.io.graphs.jrl_noise import covariance_here
from teamslam.io.graphs.jrl_values import bearing_range, keyed, pose_or_point, scalar
from teamslam.io.graphs.jrl_writer import NOTE, lacks, write
from teamslam.io.graphs.naming import names_in
from teamslam.io.graphs.symbols import LOWER_FIRST, fits, landmark_numbers, split_symbol
from teamslam.model import Dataset, Dropped, Kind, Names, Values, landmark_key, pose_key, robot_of, whitening

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
    content = _Content(read_json(path))
    return content.dataset(str(path), chosen.drop_outliers)


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
        self.marks = landmark_numbers(
            symbol
            for factor, place in factors
            for symbol, kind in zip(_symbols(factor, place), factor.ends, strict=True)
            if not kind.is_pose or split_symbol(symbol)[0] == LOWER_FIRST.landmark
        )
        edges = self._edges(factors)
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

    def _factors(self, drop_outliers: bool) -> list[tuple[Factor, Json]]:
        """All known factors in the order of the file, labelled outliers left out where asked."""
        found = []
        for letter, robot in self.root.get("measurements").items():
            outliers = self._outliers(letter)
            for e, entry in enumerate(robot.elements()):
                for m, place in enumerate(entry.get("measurements").elements() if entry.has("measurements") else ()):
                    name = place.get("type").text()
                    self.labelled += (e, m) in outliers
                    if name not in FACTORS:
                        self.unknown[name] = self.unknown.get(name, 0) + 1
                    elif not (drop_outliers and (e, m) in outliers):
                        found.append((FACTORS[name], place))
        return found

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

    def _edges(self, factors: Sequence[tuple[Factor, Json]]) -> list[Edges]:
        """The factors, those of each model and dimension together."""
        found: dict[tuple[str, int, int], list[tuple[int, Factor, Json]]] = {}
        for order, (factor, place) in enumerate(factors):
            found.setdefault((factor.model, factor.dim, len(factor.ends)), []).append((order, factor, place))
        return [self._together(rows) for rows in found.values()]

    def _together(self, rows: Sequence[tuple[int, Factor, Json]]) -> Edges:
        """Factors of one model and dimension."""
        factor, places = rows[0][1], [place for _, _, place in rows]
        keys = np.array([self._keys(other, place) for _, other, place in rows], np.int64)
        values = np.array([_value(factor, place) for place in places])
        noise = [covariance_here(_covariance(factor, p), v, factor.model, factor.dim)
                 for p, v in zip(places, values, strict=True)]  # fmt: skip

        def fail(row: int, problem: str) -> InputError:
            return places[row].error(problem)

        order, body = np.array([order for order, _, _ in rows]), np.full(len(rows), -1)
        return Edges(
            factor.model, factor.dim, keys, values, whitened(whitening, np.stack(noise), fail), order, body, fail
        )

    def _keys(self, factor: Factor, place: Json) -> tuple[int, ...]:
        keys = tuple(self._key(*end, place) for end in zip(_symbols(factor, place), factor.ends, strict=True))
        if len(set(keys)) != len(keys):
            raise place.error("the factor goes from a variable to itself")
        return keys

    def _key(self, symbol: int, kind: Kind, place: Json) -> int:
        letter, count = split_symbol(symbol)
        if not kind.is_pose or letter == LOWER_FIRST.landmark:
            return int(landmark_key(self.marks[symbol]))
        robot = LOWER_FIRST.robot(letter)
        if robot is None or not fits(count):
            raise place.error(f"the key {symbol} is no robot's pose: its top byte should be a letter (but L)")
        return int(pose_key(robot, count))

    def _values(self, name: str) -> Values | None:
        """Poses and landmarks of all robots; other types of values are of no use here."""
        if not self.root.has(name):
            return None
        rows: dict[Kind, dict[int, Sequence[float]]] = {}
        for _, robot in self.root.get(name).items():
            for symbol, place in keyed(robot):
                kind = KINDS.get(place.get("type").text())
                of_landmark = kind is not None and (not kind.is_pose or split_symbol(symbol)[0] == LOWER_FIRST.landmark)
                if kind is None or (of_landmark and symbol not in self.marks):
                    continue
                rows.setdefault(kind, {})[self._key(symbol, kind, place)] = pose_or_point(place, kind)
        return values_of((kind, np.array(list(of)), np.array(list(of.values()))) for kind, of in rows.items())


def _value(factor: Factor, place: Json) -> tuple[float, ...]:
    """What a factor measured, as a row of MODELS."""
    measured = place.get("prior" if len(factor.ends) == 1 else "measurement")
    if factor.model == "range":
        found = scalar(measured)
        if found < 0.0:
            raise measured.error(f"a range is not negative, found {found}")
        return (found,)
    if factor.model == "range_bearing":
        return bearing_range(measured, factor.dim)
    return pose_or_point(measured, factor.value_kind)


def _covariance(factor: Factor, place: Json) -> Array:
    rows = factor.rows
    numbers = [number.number() for number in place.get("covariance").elements()]
    if len(numbers) != rows * rows:
        raise place.get("covariance").error(
            f"expected {rows * rows} numbers (a matrix {rows} x {rows}, row by row), found {len(numbers)}"
        )
    return np.array(numbers).reshape(rows, rows)


def _symbols(factor: Factor, place: Json) -> list[int]:
    """The keys of a factor as the file has them."""
    names = ["key"] if len(factor.ends) == 1 else ["key1", "key2"]
    symbols = [place.get(name).whole() for name in names]
    for symbol in symbols:
        if not 0 <= symbol < 1 << 63:
            raise place.error(f"keys run from 0 to 2^63 - 1, found {symbol}")
    return symbols
