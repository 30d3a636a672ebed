"""What a body is, once it is opened: its entry, what it makes known, and whose it is.

submap      a message of `teamslam.wire`, which begins with its name
removal     all else that makes sense
"""

from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

from teamslam.model import robot_of
from teamslam.robot.packets import Entry, digest_of, removal_from
from teamslam.team import SubmapSet
from teamslam.team.sets import Held
from teamslam.wire import receive
from teamslam.wire.messages import MAGIC


@dataclass(frozen=True, eq=False)
class Opened:
    """`entry`; `news`: what it makes known; `robots`: those whose rows are in it, or whose submaps are out; `base`: the
    robot whose pose it is written from.
    """

    entry: Entry
    news: SubmapSet
    robots: tuple[int, ...]
    base: int

    def stands(self, held: SubmapSet) -> bool:
        """Whether nothing newer is held."""
        if self.entry.robot:
            return held.removed_robots.get(self.entry.robot) == self.entry.version
        mine = held.held[self.entry.id]
        return mine.version == self.entry.version and mine.removed == self.entry.gone


@lru_cache(maxsize=4096)
def opened(data: bytes) -> Opened:
    """A body's bytes opened; what robots of one process hold in common is opened once. Raises InputError where they
    make no sense."""
    if data[: len(MAGIC)] != MAGIC:
        return _removal(data)
    received = receive(data)
    submap = received.submap()
    entry = Entry(received.id, received.version, digest_of(data), len(data), submap.rows)
    news = SubmapSet(MappingProxyType({entry.id: Held(entry.version, False, frozenset({data}))}))
    return Opened(entry, news, submap.robots, int(robot_of(submap.base)))


def _removal(data: bytes) -> Opened:
    out = removal_from(data)
    digest, whose = digest_of(data), (out.robot,)
    if out.id:
        entry = Entry(out.id, out.version, digest, len(data), gone=True)
        news = SubmapSet(MappingProxyType({out.id: Held(out.version, True)}))
    else:
        entry = Entry(f"all of robot {out.robot}", out.version, digest, len(data), robot=out.robot)
        news = SubmapSet(removed_robots=MappingProxyType({out.robot: out.version}))
    return Opened(entry, news, whose, out.robot)
