"""What a team will know after a mission: the Cramer-Rao bound along its ways, in figures and words.

    information  J'WJ at the planned places, of every sighting that the plan allows
    covariance   >= its inverse, in the frame of the first robot's start        (Van Trees 1968, 2.4)

What nothing ties to that start has no covariance there, and is named. Losses do not count: the bound is that of
Gaussian noise.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError, in_words
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import SQUARED, Dataset, Names, Values, is_landmark, is_pose, robot_of
from teamslam.trust.weak import Knowledge, Weak, knowledge_from, weakest_of
from teamslam.trust.weak.knowledge import listed, worst_variances
from teamslam.trust.weak.words import metres, radians


@dataclass(frozen=True, eq=False)
class Foreseen:
    """What a team will know. `values` of everything, in the frame of the pose `base`; `tied` (n,): what will be known
    there; `place_m` and `heading_rad` (n,): largest standard deviations of each variable in that frame, nan where it is
    not tied or has no heading; `covariances` by key, of what is tied. `weak`: what will be known least; `unseen`: the
    landmarks that nobody will see, by name."""

    base: int
    names: Names
    values: Values
    tied: BoolArray
    place_m: Array
    heading_rad: Array
    covariances: Mapping[int, Array]
    weak: Weak
    unseen: tuple[str, ...] = ()

    @property
    def known(self) -> Knowledge:
        """What will be known of the shape."""
        return self.weak.known

    def way(self, robot: int) -> IntArray:
        """The places in the layout of a robot's poses, in time order."""
        keys = self.values.layout.keys
        at = np.flatnonzero(is_pose(keys) & (robot_of(keys) == robot))
        return np.asarray(at[np.argsort(keys[at])])

    @property
    def robots(self) -> tuple[int, ...]:
        """By number."""
        keys = self.values.layout.keys
        return tuple(int(robot) for robot in np.unique(robot_of(keys[is_pose(keys)])))

    @property
    def sentences(self) -> tuple[str, ...]:
        """All of it in words."""
        return (*self._of_robots(), *self._of_landmarks(), *self.weak.sentences)

    def _of_robots(self) -> Iterator[str]:
        for robot in self.robots:
            way, name = self.way(robot), in_words(self.names.robot(robot))
            place, heading = self.place_m[way], self.heading_rad[way]
            if np.isnan(place).all():
                yield f"Robot {name}: not tied to {self.names.describe(self.base)}"
                continue
            worst = int(np.nanargmax(place))
            when = self.names.describe(int(self.values.layout.keys[way[worst]])).rpartition(" at ")[2]
            yield (
                f"Robot {name}: place known to {_figure(place[-1], metres)} at its end, {metres(place[worst])} at "
                f"worst (at {when}); heading to {_figure(heading[-1], radians)} at its end, "
                f"{radians(float(np.nanmax(heading)))} at worst"
            )

    def _of_landmarks(self) -> Iterator[str]:
        keys = self.values.layout.keys
        marks = np.flatnonzero(is_landmark(keys))
        seen = marks[np.isfinite(self.place_m[marks])]
        if len(seen):
            worst = int(seen[np.argmax(self.place_m[seen])])
            yield (
                f"Landmarks: {metres(float(np.median(self.place_m[seen])))} in the middle, "
                f"{metres(self.place_m[worst])} at worst ({self.names.describe(int(keys[worst]))})"
            )
        if self.unseen:
            yield f"Nobody will see landmark{'s' * (len(self.unseen) > 1)} {', '.join(map(in_words, self.unseen))}"


def foresee(dataset: Dataset, landmarks: Mapping[int, str] | None = None) -> Foreseen:
    """What the rows of a log would tell of everything at its true or initial places.

    `landmarks`: all that were planned, by key, to say which nobody sees. Law: the covariances are those of
    `teamslam.metrics.bound.cramer_rao` where everything is tied. Raises InputError where places are not known.
    """
    at = _places_of(dataset)
    base = int(dataset.pose_keys[min(r for r in dataset.robots if len(dataset.pose_keys[r]))][0])
    absolute = any(table.row.unary and len(table) for table in dataset.tables)
    values = at if absolute else at.transform(at.pose(base).inverse())
    tables = [replace(table, values=table.predict(at), loss=SQUARED) for table in dataset.tables if len(table)]
    known = knowledge_from(tables, values, dataset.names)
    tied = np.ones(len(values), bool) if absolute else known.holds(base)
    stacks = known.stacks if absolute else known.seen_from(base)
    place, heading = (np.sqrt(np.maximum(worst, 0.0)) for worst in worst_variances(values.layout, stacks))
    place[~tied], heading[~tied] = np.nan, np.nan
    blocks = listed(values.layout, stacks)
    seen = values.layout.keys.tolist()
    covariances = {key: blocks[n] for n, key in enumerate(seen) if tied[n]}
    unseen = tuple(name for key, name in (landmarks or {}).items() if key not in seen)
    return Foreseen(base, dataset.names, values, tied, place, heading, covariances, weakest_of(known), unseen)


def _places_of(dataset: Dataset) -> Values:
    keys = dataset.layout.keys
    if not len(keys) or not any(len(dataset.pose_keys[robot]) for robot in dataset.robots):
        raise InputError("nothing would be measured: give robots with ways, and sensors that see something")
    for values in (dataset.truth, dataset.initial):
        if values is not None and values.layout.contains(keys).all():
            return values.only(keys)
    raise InputError(
        "a plan needs the places of all poses and landmarks: a mission, a simulated log, or a log with the truth or "
        "initial values of everything that was seen"
    )


def _figure(sigma: float, words: Callable[[float], str]) -> str:
    return words(sigma) if np.isfinite(sigma) else "nothing"
