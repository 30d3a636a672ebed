"""What may be wrong with a robot's names of landmarks, one change at a time.

exchanged   two landmarks are called by each other's names
mistaken    a landmark is called by the name of another, which the robot itself does not know
apart       a landmark is not where the others have it: it was moved, or is another one of the same name
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model.keys import twin_key
from teamslam.trust.labels.alignment import Stars

ALL = 24  # landmarks of a constellation, of which all pairs are tried; of more, those that fit badly
FEW = 24  # that fit badly, at most


@dataclass(frozen=True)
class Change:
    """A change of names: landmark `one` of `robot` is to be called `other`; exchanged, and the other way round."""

    kind: str
    robot: int
    one: int
    other: int

    @property
    def names(self) -> dict[int, int]:
        """Key by key, as each should be called."""
        both = {self.one: self.other}
        return both | {self.other: self.one} if self.kind == "exchanged" else both


def own_name(robot: int, mark: int) -> int:
    """The key of a landmark that one robot sees at another place than the others: the same every time it is asked."""
    return twin_key(mark, f"as robot {robot} sees it")


def changes(robot: int, stars: Stars, sky: Stars, misfit: Array) -> list[Change]:
    """The changes to try on a robot's constellation; `misfit` (n,) of each landmark, where most agree."""
    order = np.argsort(-misfit, kind="stable")
    suspects = np.sort(order if len(order) <= ALL else order[:FEW])
    here = np.isin(stars.keys, sky.keys)
    found = []
    for place, one in enumerate(suspects.tolist()):
        for other in suspects[place + 1 :].tolist():
            if here[one] or here[other]:
                found.append(Change("exchanged", robot, int(stars.keys[one]), int(stars.keys[other])))
    unknown = sky.keys[~np.isin(sky.keys, stars.keys)]
    for one in suspects.tolist():
        if here[one]:
            found.append(Change("apart", robot, int(stars.keys[one]), own_name(robot, int(stars.keys[one]))))
            found += [Change("mistaken", robot, int(stars.keys[one]), int(key)) for key in unknown.tolist()]
    return found


def assumed(change: Change | None, stars: Stars, sky: Stars) -> IntArray:
    """The place in the map of each landmark of a constellation under a change, -1 for none (n,)."""
    names = change.names if change is not None else {}
    keys = np.array([names.get(key, key) for key in stars.keys.tolist()], np.int64)
    order = np.argsort(sky.keys)
    at = np.minimum(np.searchsorted(sky.keys[order], keys), len(sky.keys) - 1)
    places = order[at]
    return np.asarray(np.where(sky.keys[places] == keys, places, -1))
