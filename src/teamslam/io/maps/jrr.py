"""GTSAM's values as JSON robot results (.jrr), the form in which JRL keeps what a method found.

    {"dataset_name", "method_name", "robots": ["a", ...], "solutions": {"a": [{"key", "type", ...}, ...]}}

Keys are GTSAM's symbols and values are written as in JRL files (see `jrl`); landmarks stand with the lowest robot.
There is no place for covariances. Source: the public format documents of JRL (Daniel McGann).
"""

from collections.abc import Sequence
from itertools import compress
from pathlib import Path

from teamslam.errors import InputError, ModelError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.garbage import uncollected
from teamslam.io.files.json_place import Json, read_json
from teamslam.io.files.json_text import encoded
from teamslam.io.files.text import write_text
from teamslam.io.graphs.jrl_keys import keys_of, of_landmarks
from teamslam.io.graphs.jrl_values import by_kind, last_of_each, poses_or_points
from teamslam.io.graphs.jrl_writer import NOTE, letters_of, values_by_robot
from teamslam.io.graphs.naming import names_in, note_of
from teamslam.io.graphs.symbols import LOWER_FIRST, landmark_numbers
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.model import WORLD, Dropped, Kind, Names, Values

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
        write_text(file, encoded(content) + "\n")
    count = sum(len(found.values) for found in maps)
    return (Dropped(count, "covariances of variables: GTSAM's values have none"),)


def read(path: Path) -> list[MapEstimate]:
    """The map in a file. InputError names the place of what cannot be read."""
    with uncollected():
        return _content(read_json(path))


def _content(root: Json) -> list[MapEstimate]:
    robots = [place for _, place in root.get("solutions").items()]
    found = [(*part, of_landmarks(part[1], not part[0].is_pose)) for robot in robots for part in by_kind(robot)]
    marks = landmark_numbers({s for _, symbols, _, landmarks in found for s in compress(symbols, landmarks)})
    rows: dict[Kind, list[tuple[IntArray, Array]]] = {}
    for kind, symbols, places, landmarks in found:
        part = keys_of(symbols, landmarks, marks, places), poses_or_points(places, kind)
        rows.setdefault(kind, []).append(part)
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {kind: last_of_each(of) for kind, of in rows.items()}
    try:
        return [
            MapEstimate(Values.of(parts), None, *_noted(root, [k for keys, _ in parts.values() for k in keys.tolist()]))
        ]
    except ModelError as error:
        raise InputError(str(error), path=root.path) from None


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
