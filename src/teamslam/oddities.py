"""Oddities of a log that look like slips of the hand, told in words before a map is made.

names      landmarks `1` and `1.0`, which are one number and two landmarks; `Door 1` of one robot and `door_1` of
           another; landmarks that are called as robots are
limits     ranges of which many are the same to the last digit, and none is larger
twice      rows that stand in two logs of a robot, or numbers of one robot in another's log
truth      a truth that knows none of a robot's poses
time       stamps of a robot that run a thousand or a million times as fast as the others'
mistakes   signs, units, axes and clocks that do not fit between odometry and sightings (see `trust.causes.told`)
"""

import itertools
import re
import unicodedata
from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.geometry import AnyArray
from teamslam.model import WORLD, Dataset, Table, index_of, is_landmark, is_pose, is_unnamed, robot_of
from teamslam.trust.cause import rows_called
from teamslam.trust.causes.told import looks_like

COPIED = 0.5  # of the rows of a log that another robot's holds too
FEWEST = 5
PARTS = {1e3: "milliseconds", 1e6: "microseconds"}  # of a second; nanoseconds are refused where they are read
SEEN = 20  # sightings of a sensor that is looked at for its limit
AT_LIMIT, OFTEN = 0.05, 3.0  # of its ranges that are the largest, and beside how often another is met
ALIKE = 3.0  # times as long or as short, for stamps to be taken for those of one team


def oddities(dataset: Dataset) -> Iterator[str]:
    """What looks like a slip of the hand, a sentence each."""
    yield from plain_oddities(dataset)
    yield from _in_two_logs(dataset)
    yield from _out_of_truth(dataset)
    yield from _in_other_seconds(dataset)
    yield from (f"it looks like this: {cause.sentence}" for cause in looks_like(dataset))


def plain_oddities(dataset: Dataset) -> Iterator[str]:
    """Those that a look at names and numbers tells, so that a run tells them as well."""
    yield from _twin_names(dataset)
    yield from _nearly_twins(dataset)
    yield from _called_as_robots(dataset)
    yield from _at_a_limit(dataset)


def _twin_names(dataset: Dataset) -> Iterator[str]:
    """Landmarks whose names are one number, written in different ways."""
    by_number: dict[float, list[str]] = {}
    for name in map(dataset.names.landmark, dataset.landmark_keys.tolist()):
        number = _number(name)
        if number is not None:
            by_number.setdefault(number, []).append(name)
    twins = [names for names in by_number.values() if len(names) > 1]
    if twins:
        some = "; ".join(" and ".join(f"'{name}'" for name in sorted(names)) for names in twins[:3])
        more = f" and {len(twins) - 3} pairs more" if len(twins) > 3 else ""
        yield f"landmarks {some}{more} are one number each but count as different landmarks; write it in one way"


def _nearly_twins(dataset: Dataset) -> Iterator[str]:
    """Landmarks of several robots whose names differ in case, blanks, signs or leading zeros alone, if none of these
    robots has both."""
    users: dict[str, set[int]] = {}
    for table in dataset.tables:
        keys = np.unique(table.keys[:, -1])
        for key in keys[is_landmark(keys) & (keys != WORLD) & ~is_unnamed(keys)].tolist():
            users.setdefault(dataset.names.landmark(int(index_of(key))), set()).add(table.robot)
    alike: dict[str, list[str]] = {}
    for name in sorted(users):
        if _number(name) is None and (plain := _plain(name)):
            alike.setdefault(plain, []).append(name)
    found = [names for names in alike.values() if len(names) > 1 and _disjoint([users[name] for name in names])]
    if found:
        of = dataset.names
        some = "; ".join(
            " and ".join(f"'{name}' ({of.these(sorted(users[name]))})" for name in names) for names in found[:3]
        )
        more = f" and {len(found) - 3} more" if len(found) > 3 else ""
        yield (
            f"landmarks {some}{more} differ in case, blanks or signs alone, and count as different landmarks; where "
            f"they are one, write its name in one way"
        )


def _plain(name: str) -> str:
    """A name without case, blanks, signs and leading zeros; what parts two numbers stays: A-1-2 is not A-12."""
    parts = re.findall(r"\d+|[^\W\d_]+", unicodedata.normalize("NFKC", name).casefold())
    numbers = [part.isdigit() for part in parts]
    told = [part.lstrip("0") or "0" if number else part for part, number in zip(parts, numbers, strict=True)]
    gaps = ["." if a and b else "" for a, b in itertools.pairwise(numbers)]
    return "".join(itertools.chain.from_iterable(zip(told, [*gaps, ""], strict=False)))


def _disjoint(sets: Sequence[set[int]]) -> bool:
    return sum(map(len, sets)) == len(set().union(*sets))


def _called_as_robots(dataset: Dataset) -> Iterator[str]:
    """Landmarks that have the name of a robot: rows in which robots see each other, in the wrong column."""
    robots = {dataset.names.robot(robot).casefold() for robot in dataset.robots}
    marks = map(dataset.names.landmark, dataset.landmark_keys.tolist())
    found = sorted(n for n in marks if len(n) > 1 and _number(n) is None and n.strip().casefold() in robots)
    if found:
        are = f"landmark {found[0]} is" if len(found) == 1 else f"landmarks {', '.join(found)} are"
        yield (
            f"{are} called as robots are: a robot that is seen is no landmark, which stands still; write these rows "
            f"into a file of their own, with the column `other` in place of `landmark`"
        )


def _at_a_limit(dataset: Dataset) -> Iterator[str]:
    """Sensors that report their limit for what is farther away."""
    for table in dataset.tables:
        if table.model not in ("range", "range_bearing") or len(table) < SEEN:
            continue
        values, counts = np.unique(table.values[:, 0], return_counts=True)
        if counts[-1] > max(AT_LIMIT * len(table), OFTEN * counts[:-1].max(initial=0)):
            yield (
                f"robot {dataset.names.robot(table.robot)}, {rows_called(table.source)}: {counts[-1]} of {len(table)} "
                f"ranges are {values[-1]:.6g} m to the last digit, and none is larger: is that the limit of its "
                f"sensor, reported for whatever is farther away? Leave such rows out, or give their bearings alone"
            )


def _number(name: str) -> float | None:
    try:
        return float(name)
    except ValueError:
        return None


def _in_two_logs(dataset: Dataset) -> Iterator[str]:
    """Pairs of tables that hold the same rows."""
    for one, other in itertools.combinations(dataset.tables, 2):
        if one.model != other.model or one.dim != other.dim:
            continue
        who = [dataset.names.robot(table.robot) for table in (one, other)]
        if one.robot == other.robot:
            both = _common(_whole(one), _whole(other))
            if both:
                yield (
                    f"robot {who[0]}: {_rows(both)} of {_called(one, other)} twice, to the last digit, and "
                    f"counts twice; was one file given two times?"
                )
            continue
        plain = [_told(table) for table in (one, other)]
        both = _common(*plain)
        if both >= FEWEST and both >= COPIED * min(map(len, plain)):
            yield (
                f"robots {who[0]} and {who[1]}: {_rows(both)} of {_called(one, other)} of both, with the same stamps "
                f"and to the last digit: is it one log, given to two robots?"
            )


def _rows(count: int) -> str:
    return f"{count} row{'s' * (count != 1)} stand{'s' * (count == 1)} in the log"


def _called(one: Table, other: Table) -> str:
    return f"'{one.source}'" if one.source == other.source else f"'{one.source}' and of '{other.source}'"


def _whole(table: Table) -> AnyArray:
    """Rows as they are: keys and values, to the bit."""
    return np.concatenate([table.keys, _bits(table)], -1)


def _told(table: Table) -> AnyArray:
    """Rows without who told them; those whose numbers stand in the table more than once (a robot that stands still)
    tell nothing and are left out."""
    landmark = is_landmark(table.keys)
    what = np.where(landmark, table.keys, index_of(table.keys))
    _, first, counts = np.unique(_bits(table), axis=0, return_index=True, return_counts=True)
    rows = np.concatenate([what, landmark.astype(np.int64), _bits(table)], -1)
    return np.asarray(rows[np.sort(first[counts == 1])])


def _bits(table: Table) -> AnyArray:
    return np.ascontiguousarray(table.values, dtype=float).view(np.int64)


def _common(one: AnyArray, other: AnyArray) -> int:
    if not len(one) or not len(other) or one.shape[1] != other.shape[1]:
        return 0
    rows = [np.unique(np.ascontiguousarray(part), axis=0) for part in (one, other)]
    return sum(map(len, rows)) - len(np.unique(np.concatenate(rows), axis=0))


def _out_of_truth(dataset: Dataset) -> Iterator[str]:
    """Robots that the truth knows at other stamps only."""
    if dataset.truth is None:
        return
    names, truth = dataset.names, dataset.truth.layout.keys
    for robot, poses in dataset.pose_keys.items():
        known = truth[is_pose(truth) & (robot_of(truth) == robot)]
        if len(poses) and len(known) and not np.isin(poses, known).any():
            (a, b), (c, d) = ([names.stamps_s(keys)[n] for n in (0, -1)] for keys in (np.sort(known), poses))
            yield (
                f"robot {names.robot(robot)}: the truth lies at {a:.3f} to {b:.3f}, its {len(poses)} poses at {c:.3f} "
                f"to {d:.3f}, and none at the same stamp: it cannot be scored; do both clocks count from one zero?"
            )


def _in_other_seconds(dataset: Dataset) -> Iterator[str]:
    """Robots of which both the whole way and its steps last so many times as long as those of the others."""
    names = dataset.names
    if names.counts:
        return
    stamps = {robot: names.stamps_s(_driven(dataset, robot)) for robot in dataset.robots}
    stamps = {robot: at for robot, at in stamps.items() if len(at) >= FEWEST}
    for robot, at in stamps.items():
        others = [s for other, s in stamps.items() if other != robot]
        if not others:
            continue
        span, step = (float(np.median([f(s) for s in others])) for f in (np.ptp, _step))
        for times, unit in PARTS.items():
            both = (np.ptp(at) / times / span, _step(at) / times / step)
            if all(1.0 / ALIKE < part < ALIKE for part in both):
                yield (
                    f"robot {names.robot(robot)}: its way lasts {np.ptp(at):,.6g} s by its stamps, with a pose every "
                    f"{_step(at):,.6g} s, where others' last {span:,.6g} s, with one every {step:,.6g} s; expected "
                    f"seconds: are its stamps {unit}?"
                )


def _driven(dataset: Dataset, robot: int) -> AnyArray:
    """The poses of a robot that its odometry ties, in their order."""
    own = [t.keys for t in dataset.tables if t.robot == robot and t.is_odometry]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *(keys.ravel() for keys in own)]))


def _step(stamps: AnyArray) -> float:
    return float(np.median(np.diff(stamps)))
