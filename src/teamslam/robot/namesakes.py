"""What is held under a robot's own ids that it has not made since it was started: in its journal, of an earlier life
whose journal is gone, or of another robot that goes by its number.

    the same submap       what is held stays: of a version there is one message; where both were made before either was
                          heard, in two forms, one version more takes the place of both
    another               its own goes as well: so all hold both, whoever was heard first, and no map has either
    of a newer version    its own is out of date, and stays at home

What robots hold depends on what was made, not on who was heard when; what it costs the map is said (`left_out`).
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.joining import condense
from teamslam.model import Submap
from teamslam.team import SubmapSet
from teamslam.wire import receive
from teamslam.wire.rounding import within

WHOSE = (
    "of an earlier life whose journal it does not have, or of another robot of its number: go on from the journal with "
    "--resume, or begin with another number, or in a team of another name"
)
SLACK = 1e-3  # sigma, and of the information: what another processor's arithmetic makes of the same rows is far less


@lru_cache(maxsize=256)
def tells(data: bytes, submap: Submap) -> bool:
    """Whether a message says of its variables what a submap says, but for how it was rounded."""
    received = receive(data)
    theirs = received.submap()
    keys, eta = theirs.values.layout.keys, received.rounding.information + SLACK
    alike = (theirs.base, theirs.sources) == (submap.base, submap.sources)
    if not alike or not submap.values.layout.contains(keys).all() or not _same_raw(theirs, submap):
        return False
    try:
        mine = condense(submap, keys)[0]
    except TeamslamError:
        return False
    off = theirs.values.minus(mine.values)
    shift_sigma = np.sqrt(max(0.0, float(off @ (mine.information @ off))))
    near = shift_sigma <= received.rounding.shift_sigma + SLACK
    return bool(near) and within(mine.values.layout, mine.information, theirs.information, eta)


def _same_raw(one: Submap, other: Submap) -> bool:
    """Whether raw rows are the same rows, of about the same numbers."""
    return len(one.raw) == len(other.raw) and all(
        np.array_equal(a.keys, b.keys) and np.array_equal(a.ids, b.ids) and np.allclose(a.values, b.values, 0.01, 0.01)
        for a, b in zip(one.raw, other.raw, strict=True)
    )


def left_out(own: Mapping[str, int], held: SubmapSet) -> dict[str, str]:
    """The submaps that are in no map, each with the reason, where a robot made its `own` up to these versions."""
    found = {refusal.name: refusal.reason for refusal in held.admission.refused}
    for id_ in own.keys() & held.held.keys():
        known = held.held[id_]
        if len(known.contents) > 1:
            found[id_] += f"; one is this robot's, the other {WHOSE}"
        elif not known.removed and known.version > own[id_]:
            found[id_] = (
                f"{id_} is held in version {known.version}, and this robot has not made that: what it mapped there is "
                f"in no map; what is held is {WHOSE}"
            )
    return found
