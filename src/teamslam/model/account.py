"""What went into a map and did not come out of it, so that nothing vanishes: the books of a run balance.

    variables of the log  =  variables of its maps  +  those left out
    rows of the log       =  rows that its maps hold  +  those left out

Each is left out once, with the reason in words.
"""

from dataclasses import dataclass

from teamslam.errors import in_words
from teamslam.geometry import IntArray
from teamslam.model.sources import Sources


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Part of a log that is in no map: of which `kind` ('piece', 'poses', 'landmark' or 'rows'), `what` it is in words,
    the variables (`keys`) and rows (`rows`) that are lost with it, how many rows that is, and the `reason`."""

    kind: str
    what: str
    keys: IntArray
    rows: Sources
    count: int
    reason: str

    def __repr__(self) -> str:
        return f"LeftOut({in_words(self.what)}: {in_words(self.reason)[:120]})"
