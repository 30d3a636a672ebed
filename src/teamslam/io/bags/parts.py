"""Which files are one recording, and which are recordings of several robots.

    a part        begins where the one before ends, and both hold a topic by which a robot moves or sees
    its company   was recorded meanwhile, and holds nothing that a robot saw: odometry or motion capture by themselves

What else is recorded at the same time, or at another, is of another robot.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.bags.opened import opened
from teamslam.io.bags.roles import ROLES

SEEING = {"tags", "tag poses", "image"}
MOVING = {"odometry", "pose"}
SPLIT_NS = 2 * 10**9  # between the last message of a part and the first of the next, at most
NUMBERED = re.compile(r"(?P<name>.*?)(?:_?\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)?_(?P<number>\d+)")


@dataclass(frozen=True)
class _File:
    """When the first and the last message of a file were recorded [ns], and its topics by which robots move and see."""

    path: Path
    start: int
    stop: int
    moving: frozenset[str]
    seeing: frozenset[str]

    def goes_on_in(self, other: "_File") -> bool:
        """Whether another is the next part of the same recording."""
        alike = (self.moving | self.seeing) & (other.moving | other.seeing)
        return bool(alike) and abs(other.start - self.stop) < SPLIT_NS and other.start > self.start

    def is_company_of(self, other: "_File") -> bool:
        """Whether it says of what another saw only where that was."""
        apart = not self.moving & other.moving and self.start < other.stop and other.start < self.stop
        return apart and not self.seeing and bool(other.seeing)


def recordings_of(paths: Sequence[Path]) -> list[tuple[Path, ...]]:
    """The recordings that files are, each with its parts in their order. InputError where one cannot be read."""
    left = sorted((_file(path) for path in paths), key=lambda file: file.start)
    found: list[list[_File]] = []
    for file in left:
        before = [group for group in found if group[-1].goes_on_in(file)]
        if len(before) == 1:
            before[0].append(file)
        else:
            found.append([file])
    for group in [group for group in found if not any(file.seeing for file in group)]:
        hosts = [other for other in found if any(a.is_company_of(b) for a in group for b in other)]
        if len(hosts) == 1:
            hosts[0].extend(group)
            found.remove(group)
    order = {path: k for k, path in enumerate(paths)}
    groups = [tuple(file.path for file in group) for group in found]
    return sorted(groups, key=lambda group: min(order[path] for path in group))


def parts_beside(path: Path) -> tuple[Path, ...]:
    """The parts of the recording of which a file seems to be one, in their order, itself among them: files beside it
    whose names differ in a number at the end (and a date), as `rosbag record --split` has it, and that go on in one
    another. Just itself where there are none."""
    mine = NUMBERED.fullmatch(path.stem)
    if mine is None or not path.is_file():
        return (path,)
    alike = [(other, NUMBERED.fullmatch(other.stem)) for other in sorted(path.parent.glob(f"*{path.suffix}"))]
    files = []
    for other in (other for other, its in alike if its is not None and its["name"] == mine["name"]):
        try:
            files.append(_file(other))
        except InputError:  # not of this recording, or of no use to it
            continue
    groups = recordings_of([file.path for file in files])
    return next((group for group in groups if path in group), (path,))


def _file(path: Path) -> _File:
    with opened(path) as recording:
        start, stop = recording.span_ns
        roles = {topic: ROLES.get(types[0], "") for topic, (types, count) in recording.topics.items() if count}
    moving, seeing = (frozenset(t for t, role in roles.items() if role in some) for some in (MOVING, SEEING))
    return _File(path, start, stop, moving, seeing)
