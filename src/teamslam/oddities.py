"""Oddities of a log that look like slips of the hand, told in words before a map is made.

names      landmarks `1` and `1.0`, which are one number and two landmarks
twice      rows that stand in two logs of a robot, or numbers of one robot in another's log
truth      a truth that knows none of a robot's poses
mistakes   signs, units, axes and clocks that do not fit between odometry and sightings (see `trust.causes.told`)
"""

import itertools
from collections.abc import Iterator

import numpy as np

from teamslam.geometry import AnyArray
from teamslam.model import Dataset, Table, index_of, is_landmark, is_pose, robot_of
from teamslam.trust.causes.told import looks_like

COPIED = 0.5  # of the rows of a log that another robot's holds too
FEWEST = 5


def oddities(dataset: Dataset) -> Iterator[str]:
    """What looks like a slip of the hand, a sentence each."""
    yield from _twin_names(dataset)
    yield from _in_two_logs(dataset)
    yield from _out_of_truth(dataset)
    yield from (f"it looks like this: {cause.sentence}" for cause in looks_like(dataset))


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
