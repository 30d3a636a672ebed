"""What is weak in a map, in words that the figures bear out."""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.errors import in_words
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import Layout, Names, is_landmark, is_pose, robot_of
from teamslam.trust.weak.freedoms import Freedom
from teamslam.trust.weak.hinges import Hinge

MOST_NAMED = 4  # landmarks that are called by their names
ROUGHLY = 0.8  # of a direction: less than this explained is said
AXES = ("x", "y", "z")
ANY_ANGLE = np.pi / np.sqrt(3.0)  # the standard deviation of an angle that may be any


def called(part: BoolArray, layout: Layout, names: Names) -> str:
    """A part of a map in words: whole robots, stretches of their ways, landmarks."""
    keys = layout.keys[part]
    words = list(_robots(keys, layout, names))
    marks = np.sort(keys[is_landmark(keys)])
    if len(marks):
        words.append(_landmarks(marks, names))
    return _listed(words)


def _robots(keys: IntArray, layout: Layout, names: Names) -> Iterator[str]:
    """Robots that are whole in one phrase, then those in part, each with its stretch."""
    poses = layout.keys[is_pose(layout.keys)]
    whole = []
    for robot in np.unique(robot_of(keys[is_pose(keys)])).tolist():
        way, own = np.sort(poses[robot_of(poses) == robot]), np.sort(keys[robot_of(keys) == robot])
        if len(own) == len(way):
            whole.append(in_words(names.robot(robot)))
            continue
        at = np.searchsorted(way, own)
        name = f"robot {in_words(names.robot(robot))}"
        if len(own) == 1:
            yield names.describe(int(own[0]))
        elif (np.diff(at) == 1).all():
            yield f"{name} {_stretch(int(at[0]), int(at[-1]), way, names)}"
        else:
            yield f"{len(own)} of the {len(way)} poses of {name}"
    if whole:
        yield f"robot{'s' * (len(whole) > 1)} {_listed(whole)}"


def _stretch(first: int, last: int, way: IntArray, names: Names) -> str:
    start, stop = (_when(int(way[k]), names) for k in (first, last))
    if last == len(way) - 1:
        return f"from {start} on"
    return f"up to {stop}" if first == 0 else f"from {start} to {stop}"


def _when(key: int, names: Names) -> str:
    return names.describe(key).rpartition(" at ")[2]


def _landmarks(marks: IntArray, names: Names) -> str:
    if len(marks) > MOST_NAMED:
        return f"{len(marks)} landmarks"
    called = [in_words(names.landmark(int(key))) for key in marks]
    return f"landmark{'s' * (len(marks) > 1)} {_listed(called)}"


def _listed(words: Sequence[str]) -> str:
    *some, last = words
    return f"{', '.join(some)} and {last}" if some else last


def verb(part: BoolArray, layout: Layout, one: str, many: str) -> str:
    """The form of a verb that goes with a part."""
    keys = layout.keys[part]
    poses = keys[is_pose(keys)]
    robots = len(np.unique(robot_of(poses)))
    return one if robots + int(is_landmark(keys).sum()) == 1 and not _scattered(keys, layout) else many


def _scattered(keys: IntArray, layout: Layout) -> bool:
    """Whether a part of one robot is neither a pose nor a stretch: it is so many of its poses, then."""
    poses = layout.keys[is_pose(layout.keys)]
    own = np.sort(keys[is_pose(keys)])
    way = np.sort(poses[np.isin(robot_of(poses), robot_of(own))])
    return bool((np.diff(np.searchsorted(way, own)) != 1).any())


def sentence_of_hinge(
    hinge: Hinge, part: BoolArray, against: str, layout: Layout, names: Names, sigma: float, explained: float
) -> str:
    """'Robots 2 and 3 turn about landmark 7 against the rest: heading known to 0.21 rad'."""
    who, roughly = called(part, layout, names), "" if explained >= ROUGHLY else ", roughly"
    if hinge.kind == "shift":
        does = verb(part, layout, "shifts", "shift")
        return _capital(f"{who} {does} along {along(hinge.axis)} against {against}{roughly}: known to {metres(sigma)}")
    does = verb(part, layout, "turns", "turn")
    if _on_the_spot(hinge, part, layout):
        return _capital(f"{who} {does} on the spot{_axis(hinge)}{roughly}: heading {angle(sigma)}")
    pivot = pivot_of(hinge, names)
    return _capital(f"{who} {does} about {pivot} against {against}{roughly}: {_what(hinge)} {angle(sigma)}")


def sentence_of_freedom(freedom: Freedom, layout: Layout, names: Names) -> str:
    """'Robot 2 turns freely about landmark 7 against robot 1: nothing measured holds it'."""
    who = called(freedom.part, layout, names)
    other = called(freedom.against, layout, names) if freedom.against.any() else "the world"
    if freedom.ways == freedom.all_ways:
        does = verb(freedom.part, layout, "is", "are")
        return _capital(f"{who} {does} not tied to {other}: no measurement says where one lies from the other")
    does, hinge = verb(freedom.part, layout, "turns", "turn"), freedom.hinge
    if freedom.centre is not None:
        every = f" in {freedom.ways} ways" if freedom.ways > 1 else ""
        return _capital(f"{who} {does} freely{every} about {names.describe(freedom.centre)} against {other}: not known")
    if hinge is None:
        does = verb(freedom.part, layout, "is", "are")
        return _capital(f"{who} {does} free in {freedom.ways} ways against {other}: not known")
    if hinge.kind == "shift":
        does = verb(freedom.part, layout, "shifts", "shift")
        return _capital(f"{who} {does} freely along {along(hinge.axis)} against {other}: not known")
    return _capital(f"{who} {does} freely about {pivot_of(hinge, names)} against {other}: {_what(hinge)} not known")


def pivot_of(hinge: Hinge, names: Names) -> str:
    """What stands still in a turn."""
    if len(hinge.pivot) == 2:
        return f"the line through {' and '.join(names.describe(key) for key in hinge.pivot)}"
    where = names.describe(hinge.pivot[0]) if hinge.pivot else f"a place at {place(hinge.at)}"
    return where + _axis(hinge)


def _axis(hinge: Hinge) -> str:
    """About which direction a turn is, where that is not the vertical."""
    return "" if _upright(hinge) or len(hinge.pivot) == 2 else f" (axis along {along(hinge.axis)})"


def _what(hinge: Hinge) -> str:
    return "heading" if _upright(hinge) else "turn"


def _upright(hinge: Hinge) -> bool:
    return bool(abs(hinge.axis[-1]) > np.cos(np.deg2rad(20.0)))


def _on_the_spot(hinge: Hinge, part: BoolArray, layout: Layout) -> bool:
    return int(part.sum()) == 1 and int(layout.keys[part][0]) in hinge.pivot


def along(direction: Array) -> str:
    """A direction in the frame of the map: an axis where it is one to a degree, else its numbers."""
    direction = direction * (1.0 if direction[np.argmax(np.abs(direction))] > 0.0 else -1.0)
    if direction.max() > np.cos(np.deg2rad(1.0)):
        return AXES[int(np.argmax(direction)) + (0 if len(direction) > 1 else 2)]
    return f"({', '.join(f'{v:.2f}' for v in direction)})"


def place(at: Array) -> str:
    """'(1.20, -0.31) m'."""
    return f"({', '.join(f'{v:.2f}' for v in at)}) m"


def angle(sigma: float) -> str:
    """How well an angle is known: '0.21 rad'; that it is not, where it is no better than any."""
    return "known to " + radians(sigma) if sigma < ANY_ANGLE else f"as good as unknown ({radians(sigma)})"


def metres(sigma: float) -> str:
    """'0.21 m'."""
    return f"{sigma:.2g} m"


def radians(sigma: float) -> str:
    """'0.21 rad'."""
    return f"{sigma:.2g} rad"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
