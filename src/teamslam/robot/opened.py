"""What a body is, once it is opened: its entry, what it makes known, and whose it is.

submap        a message of `teamslam.wire`, which begins with its name
announcement  a page of what a robot knows
removal       of a submap, or of all of a robot's
"""

from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.model import robot_of
from teamslam.robot.packets import Announcement, Entry, Removal, digest_of, news_from, to_bytes
from teamslam.team import Knowledge, SubmapSet
from teamslam.team.knowledge import PAGE, Page
from teamslam.team.sets import Held
from teamslam.wire import receive
from teamslam.wire.codec_places import get_known, put_known
from teamslam.wire.messages import MAGIC
from teamslam.wire.packing import Reader, Writer
from teamslam.wire.rounding import EXACT


@dataclass(frozen=True, eq=False)
class Opened:
    """`entry`; `news`: what it makes known of submaps; `told`: of what robots know; `robots`: those whose rows are in
    it, whose submaps are out, or who tells; `base`: the robot whose pose it is written from; `kind`: that of a submap's
    message, 'announcement' or 'removal'; `short`: it is less than the submap to the bit; `keys`: a submap's variables.
    """

    entry: Entry
    news: SubmapSet
    robots: tuple[int, ...]
    base: int
    kind: str
    short: bool = False
    keys: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    told: Knowledge = field(default_factory=Knowledge)

    def stands(self, held: SubmapSet, known: Knowledge) -> bool:
        """Whether nothing newer is held."""
        if self.told.pages:
            return all(known.pages[name].version == page.version for name, page in self.told.pages.items())
        if self.entry.robot:
            return held.removed_robots.get(self.entry.robot) == self.entry.version
        mine = held.held[self.entry.id]
        return mine.version == self.entry.version and mine.removed == self.entry.gone


@lru_cache(maxsize=4096)
def opened(data: bytes) -> Opened:
    """A body's bytes opened; what robots of one process hold in common is opened once. Raises InputError where they
    make no sense."""
    if data[: len(MAGIC)] != MAGIC:
        said = news_from(data)
        return _announcement(said, data) if isinstance(said, Announcement) else _removal(said, data)
    received = receive(data)
    submap = received.submap()
    short = received.kind != "sparse" or received.rounding != EXACT
    entry = Entry(received.id, received.version, digest_of(data), len(data), submap.rows)
    news = SubmapSet(MappingProxyType({entry.id: Held(entry.version, False, frozenset({data}))}))
    return Opened(entry, news, submap.robots, int(robot_of(submap.base)), received.kind, short, submap.keys)


def announcements(told: Knowledge) -> list[bytes]:
    """Pages of what robots know as bodies."""
    found = []
    for (robot, number), page in sorted(told.pages.items()):
        keys = Writer()
        put_known(keys, np.array(sorted(page.keys), np.int64))
        found.append(to_bytes(Announcement(robot, number, keys.content()).checked()))
    return found


def page_id(robot: int, number: int) -> str:
    """What names a page in lists."""
    return f"what robot {robot} knows, page {number}"


def _announcement(said: Announcement, data: bytes) -> Opened:
    if said != said.checked():
        raise InputError("an announcement is damaged: its digest does not fit its content; ask for it again")
    source = Reader(said.keys)
    try:
        keys = get_known(source)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(f"an announcement makes no sense: {error}") from None
    if not (source.finished and 0 < len(keys) <= PAGE and keys.min() >= 0 and (np.diff(keys) > 0).all()):
        raise InputError(f"an announcement is not of 1 to {PAGE} keys, each once")
    page = Page(len(keys), frozenset(keys.tolist()))
    entry = Entry(page_id(said.robot, said.page), page.version, digest_of(data), len(data), knows=True)
    told = Knowledge(MappingProxyType({(said.robot, said.page): page}))
    return Opened(entry, SubmapSet(), (said.robot,), said.robot, "announcement", told=told)


def _removal(out: Removal, data: bytes) -> Opened:
    digest, whose = digest_of(data), (out.robot,)
    if out.id:
        entry = Entry(out.id, out.version, digest, len(data), gone=True)
        news = SubmapSet(MappingProxyType({out.id: Held(out.version, True)}))
    else:
        entry = Entry(f"all of robot {out.robot}", out.version, digest, len(data), robot=out.robot)
        news = SubmapSet(removed_robots=MappingProxyType({out.robot: out.version}))
    return Opened(entry, news, whose, out.robot, "removal")
