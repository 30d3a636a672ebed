"""Names and places as fields of a message.

A message opens with the variables that it names (`known`, sorted); everything else refers to them by place.
"""

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.model import (
    Names,
    Sources,
    index_of,
    is_landmark,
    is_pose,
    robot_of,
)
from teamslam.wire.packing import DAMAGED, Reader, Writer


def put_names(out: Writer, names: Names, known: IntArray, sources: Sources) -> None:
    """Write the names of what a message speaks of."""
    robots = {int(r) for r in robot_of(known[is_pose(known)])} | {robot for robot, _ in sources.edges}
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
        if not -(1 << 12) <= robot < 1 << 12 or first >= 1 << 51:
            raise InputError(DAMAGED.format("a variable in it has no possible name"))
        indices = first + np.concatenate([[0], np.cumsum(source.integers(count - 1))]).astype(np.int64)
        parts.append(np.int64(robot) << np.int64(51) | indices)
    return np.concatenate(parts)


def put_sources(out: Writer, sources: Sources) -> None:
    out.number(len(sources.edges))
    for (robot, name), stretches in sources.edges.items():
        out.number(robot)
        out.text(name)
        out.number(len(stretches))
        edges = stretches.ravel()
        out.number(int(edges[0]))
        out.integers(np.diff(edges) - 1, np.arange(len(edges) - 1) % 2)


def get_sources(source: Reader) -> Sources:
    found = Sources()
    for _ in range(source.count()):
        robot, name, count, first = source.number(), source.text(), source.count(), source.number()
        steps = source.integers(2 * count - 1, np.arange(2 * count - 1) % 2) + 1
        edges = first + np.concatenate([[0], np.cumsum(steps)])
        found = found.merge(Sources.by_edges({(robot, name): edges.astype(np.int64).reshape(-1, 2)}))
    return found


def put_places(out: Writer, places: IntArray) -> None:
    out.number(len(places))
    out.integers(np.diff(places, prepend=-1) - 1)


def get_places(source: Reader, most: int) -> IntArray:
    count = source.count()
    return inside_all(np.cumsum(source.integers(count) + 1) - 1, most)


def put_pairs(out: Writer, variables: int, pairs: IntArray) -> None:
    """Which variables are coupled: nothing more to say where all are, else each one's partners as gaps."""
    complete = len(pairs) == variables * (variables + 1) // 2
    out.number(int(complete))
    if not complete:
        later = pairs[pairs[:, 0] < pairs[:, 1]]
        counts = np.bincount(later[:, 0], minlength=variables)
        out.integers(counts)
        first = np.append(True, np.diff(later[:, 0]) != 0)[: len(later)]
        out.integers(np.where(first, later[:, 1] - later[:, 0], np.diff(later[:, 1], prepend=0)) - 1)


def get_pairs(source: Reader, variables: int) -> IntArray:
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
    second = inside_all(first + walked - before, variables)
    own = np.arange(variables)
    pairs = np.stack([np.append(own, first), np.append(own, second)], -1)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def inside(place: int, most: int) -> int:
    if not 0 <= place < most:
        raise InputError(DAMAGED.format("it refers to something that it does not hold"))
    return place


def inside_all(places: IntArray, most: int) -> IntArray:
    if places.size and not (places.min() >= 0 and places.max() < most):
        raise InputError(DAMAGED.format("it refers to something that it does not hold"))
    return places
