"""Variables asked for in words:

    door, 17, landmark 17            a landmark
    red@12.5, robot red at 12.5 s    the pose of a robot at a stamp [s], to half a millisecond; where poses are only
                                     counted, red@3 and robot red at pose 3
    red@first, red@last, red@~12.5   its first pose, its last, the one nearest to a stamp
    an integer                       a key itself

Law: what `Names.describe` says of a key leads back to it. Whatever is not there is told with the names nearest to it.
"""

from collections.abc import Collection, Sequence
from types import UnionType
from typing import Any

import numpy as np

from teamslam.errors import ModelError, in_words
from teamslam.geometry import IntArray
from teamslam.model.keys import WORLD, Names, index_of, is_landmark, is_pose, pose_key, robot_of

SAME_S = 0.5e-3  # [s] stamps that are printed alike are one
A_LOG = "a log (a Dataset, of ts.read or ts.simulate)"  # what is expected, in a sentence
A_PATH = "a path (text, or a pathlib.Path)"
MOST = 8  # names told of those there are
Asked = str | int


def key_asked(asked: Asked, names: Names, keys: IntArray) -> int:
    """The key, among `keys` (n,), of the variable asked for in words or by its key. ModelError where there is none."""
    if is_whole(asked):
        return _there(int(asked), names, keys)
    words = _words(asked, "a variable is asked for in words, such as 'door' or 'red@12.5', or by its key")
    landmarks = _landmarks(names, keys)
    for name in (words, words.removeprefix("landmark ")):
        if name in landmarks:
            return landmarks[name]
    robots = robot_names(names, keys)
    robot, stamp = _pose_words(words, robots)
    if stamp:
        return pose_asked(robot, stamp, names, keys)
    if robot in robots:
        raise ModelError(
            f"'{in_words(words)}' is a robot, which has many poses; ask for one, such as '{robot}@first', "
            f"'{robot}@last' or '{robot}@{_stamp(names, _poses_of(robots[robot], keys)[0])}'"
        )
    if words.startswith("robot "):
        return robot_asked(words, names, keys)  # which says what there is
    if words.startswith("landmark "):
        return landmark_asked(words, names, keys)
    raise ModelError(f"nothing here is called '{in_words(words)}'; {nearest(words, [*landmarks, *robots])}")


def landmark_asked(asked: Asked, names: Names, keys: IntArray) -> int:
    """The key of a landmark asked for by its name or number. ModelError where there is none."""
    landmarks = _landmarks(names, keys)
    words = str(asked) if is_whole(asked) else _words(asked, "a landmark is asked for by its name, such as 'door'")
    for name in (words, words.removeprefix("landmark ")):
        if name in landmarks:
            return landmarks[name]
    if is_whole(asked) and int(asked) in landmarks.values():
        return int(asked)
    raise ModelError(f"no landmark here is called '{in_words(words)}'; {nearest(words, list(landmarks))}")


def robot_asked(asked: Asked, names: Names, keys: IntArray) -> int:
    """The number of a robot with a pose among `keys`, asked for by its name or number. ModelError where it has none."""
    robots = robot_names(names, keys)
    words = str(asked) if is_whole(asked) else _words(asked, "a robot is asked for by its name, such as 'red'")
    for name in (words, words.removeprefix("robot ")):
        if name in robots:
            return robots[name]
    if is_whole(asked) and int(asked) in robots.values():
        return int(asked)
    raise ModelError(f"no robot here is called '{in_words(words)}'; {nearest(words, list(robots))}")


def pose_asked(robot: Asked, stamp: str | float, names: Names, keys: IntArray) -> int:
    """The key of a robot's pose at a stamp: a number [s] (or count), 'first', 'last', or '~' and a number for the pose
    nearest to it. ModelError where there is none, with those beside it."""
    number = robot_asked(robot, names, keys)
    own = _poses_of(number, keys)
    words = str(stamp).strip()
    if words in ("first", "last"):
        return int(own[0 if words == "first" else -1])
    near = words.removeprefix("~")
    try:
        tick = float(near) / names.tick_s
    except ValueError:
        raise ModelError(
            f"'{in_words(near)}' is no stamp; expected a number {'of a pose' if names.counts else '[s]'}, first, last, "
            f"or ~ and a number"
        ) from None
    at = int(np.argmin(np.abs(index_of(own) - tick)))
    if words == near and abs(int(index_of(own[at])) - tick) * names.tick_s > SAME_S:
        after = int(np.searchsorted(index_of(own), tick))
        beside = " and ".join(_stamp(names, key) for key in own[max(after - 1, 0) : after + 1])
        raise ModelError(
            f"robot {in_words(names.robot(number))} has no pose at {near}; beside it are those at {beside} "
            f"('{in_words(names.robot(number))}@~{near}' takes the nearest)"
        )
    return int(own[at])


def robot_names(names: Names, keys: IntArray) -> dict[str, int]:
    """The robots with a pose among `keys`: their names, and the number of each."""
    return {names.robot(robot): robot for robot in np.unique(robot_of(keys[is_pose(keys)])).tolist()}


def nearest(word: str, known: Sequence[str]) -> str:
    """What to ask for in place of a word that is not known: the names nearest to it, or those there are."""
    from difflib import get_close_matches

    lower = {name.lower(): name for name in known}
    close = [lower[name] for name in get_close_matches(word.lower(), lower, n=3, cutoff=0.6)]
    if close:
        return f"did you mean {' or '.join(repr(in_words(name)) for name in close)}?"
    if not known:
        return "there is none"
    some = ", ".join(in_words(name) for name in known[:MOST])
    return f"there {'is' if len(known) == 1 else 'are'} {some}" + (
        f" and {len(known) - MOST:,} more" if len(known) > MOST else ""
    )


def is_whole(asked: object) -> bool:
    """True for a whole number of any kind (a truth value is none)."""
    return isinstance(asked, int | np.integer) and not isinstance(asked, bool | np.bool_)


def _words(asked: Any, expected: str) -> str:
    if not isinstance(asked, str):
        raise ModelError(f"{expected}; found {a_kind(asked)}")
    return asked.strip()


def expect(given: object, kind: type | UnionType, words: str) -> None:
    """ModelError in a sentence where what is given is not of a kind; `words` say what is, and where it comes from."""
    if not isinstance(given, kind):
        raise ModelError(f"expected {words}, found {a_kind(given)}")


def a_kind(found: object) -> str:
    """What something is, for a sentence: 'a list', 'an Array', 'nothing (None)'."""
    if found is None:
        return "nothing (None)"
    kind = type(found).__name__
    return f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"


def _pose_words(words: str, robots: Collection[str]) -> tuple[str, str]:
    """The robot and the stamp in 'red@12.5' or 'robot red at 12.5 s', whichever names a robot; no stamp where there is
    none."""
    found = []
    for mark in (" at ", "@"):
        robot, there, stamp = words.rpartition(mark)
        if there and (mark == "@" or words.startswith("robot ")):
            found.append((robot.removeprefix("robot "), stamp.removesuffix(" s").removeprefix("pose ")))
    bare = words.removeprefix("robot "), ""
    return next((pair for pair in found if pair[0] in robots), found[-1] if found and bare[0] not in robots else bare)


def _landmarks(names: Names, keys: IntArray) -> dict[str, int]:
    own = keys[is_landmark(keys) & (keys != WORLD)]
    return {names.landmark(int(index_of(key))): key for key in own.tolist()}


def _poses_of(robot: int, keys: IntArray) -> IntArray:
    return np.sort(keys[(keys >= pose_key(robot, 0)) & (robot_of(keys) == robot)])


def _there(key: int, names: Names, keys: IntArray) -> int:
    if not (keys == key).any():
        told = names.describe(key) if key >= 0 else f"variable {key}"
        raise ModelError(f"{told} (key {key}) is not among the {len(keys):,} variables here")
    return key


def _stamp(names: Names, key: int) -> str:
    return str(int(index_of(key))) if names.counts else f"{int(index_of(key)) * names.tick_s:.3f}"
