"""GTSAM's values as JSON robot results (.jrr), the form in which JRL keeps what a method found.

    {"dataset_name", "method_name", "robots": ["a", ...], "solutions": {"a": [{"key", "type", ...}, ...]}}

Keys are GTSAM's symbols and values are written as in JRL files (see `jrl`); landmarks stand with the lowest robot.
There is no place for covariances. Source: the public format documents of JRL (Daniel McGann).
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import Array, IntArray
from teamslam.io.files.json_place import Json, read_json
from teamslam.io.files.text import write_text
from teamslam.io.graphs.jrl_factors import KINDS
from teamslam.io.graphs.jrl_values import keyed, pose_or_point
from teamslam.io.graphs.jrl_writer import NOTE, letters_of, values_by_robot
from teamslam.io.graphs.naming import names_in, note_of
from teamslam.io.graphs.symbols import LOWER_FIRST, fits, landmark_numbers, split_symbol
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.model import WORLD, Dropped, Kind, Names, Values, landmark_key, pose_key

METHOD = "teamslam"


def sniff(path: Path) -> bool:
    """A file *.jrr."""
    return path.is_file() and path.suffix == ".jrr"


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: `read` gives the same estimate and names. InputError for robots
    without a letter."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        problem = LOWER_FIRST.lacks(found.robots, "GTSAM's keys")
        if problem is not None:
            raise InputError(f"{problem}; write a CSV")
        letters = letters_of(found.robots)
        content = {
            "dataset_name": path.stem,
            "method_name": METHOD,
            NOTE: note_of(found.names) | {"base": found.base},
            "robots": list(letters.values()),
            "solutions": values_by_robot(found.values, letters),
        }
        write_text(file, json.dumps(content, allow_nan=False) + "\n")
    count = sum(len(found.values) for found in maps)
    return (Dropped(count, "covariances of variables: GTSAM's values have none"),)


def read(path: Path) -> list[MapEstimate]:
    """The map in a file. InputError names the place of what cannot be read."""
    root = read_json(path)
    places = [(symbol, place) for _, robot in root.get("solutions").items() for symbol, place in keyed(robot)]
    kinds = [KINDS.get(place.get("type").text()) for _, place in places]
    known = [(s, place, kind) for (s, place), kind in zip(places, kinds, strict=True) if kind is not None]
    marks = landmark_numbers(
        s for s, _, kind in known if not kind.is_pose or split_symbol(s)[0] == LOWER_FIRST.landmark
    )
    rows: dict[Kind, dict[int, tuple[float, ...]]] = {}
    for symbol, place, kind in known:
        rows.setdefault(kind, {})[_key(symbol, marks, place)] = pose_or_point(place, kind)
    parts: dict[Kind, tuple[IntArray, Array]] = {
        kind: (np.array(list(of), np.int64), np.array(list(of.values()))) for kind, of in rows.items()
    }
    try:
        return [
            MapEstimate(Values.of({**parts}), None, *_noted(root, [int(k) for keys, _ in parts.values() for k in keys]))
        ]
    except ModelError as error:
        raise InputError(str(error), path=path) from None


def _key(symbol: int, marks: dict[int, int], place: Json) -> int:
    if symbol in marks:
        return int(landmark_key(marks[symbol]))
    letter, count = split_symbol(symbol)
    robot = LOWER_FIRST.robot(letter)
    if robot is None or not fits(count):
        raise place.error(f"the key {symbol} is no robot's pose: its top byte should be a letter (but L)")
    return int(pose_key(robot, count))


def _noted(root: Json, keys: list[int]) -> tuple[int, Names]:
    """The base and the names in teamslam's note; without it the robots' letters, in a frame that nobody named."""
    if root.has(NOTE):
        note = root.get(NOTE)
        try:
            return int(note.get("base").whole()), names_in(note.value)
        except ValueError as error:
            raise note.error(f"{error}; remove it") from None
    robots = sorted({key >> 51 for key in keys if key >> 51 > 0})
    return WORLD, Names({robot: str(LOWER_FIRST.letter(robot)) for robot in robots}, {}, 1.0)
