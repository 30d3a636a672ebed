"""The least squares of one robot's piece of log: what a Gaussian over its variables holds, and what travels raw.

inside: rows of the robot's own relative poses, of landmarks that its sightings fix, of robots whose pose it saw
raw:    rows in the world's frame, sightings that leave part of their target open (a range or bearing to a robot has
        no heading; a landmark straight ahead has no distance; two ranges meet at two places), and robust sightings
        of robots, since a pose seen once leaves no residual by which a wrong sighting could be known
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import ModelError, SolveError
from teamslam.frontend.tags.hinges import swung
from teamslam.frontend.tags.mirrored import turned
from teamslam.frontend.tags.yielded import turned_with_its_eyes
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.build.eyes import best_seen_from
from teamslam.joining.build.split import refuse_borrowed
from teamslam.joining.start.adrift import adrift
from teamslam.joining.start.dead_reckoning import own_chain
from teamslam.joining.start.elsewhere import elsewhere, while_lower
from teamslam.joining.start.starts import driven_start, starts
from teamslam.joining.start.twofold import RULED_OUT, twofold
from teamslam.model import (
    Dataset,
    Layout,
    Sources,
    Submap,
    Table,
    Values,
    among,
    distinct,
    expect,
    index_of,
    is_landmark,
    is_pose,
    robot_of,
)
from teamslam.model.sparse import sp
from teamslam.solver import Options, Solution, Step, System, firm, optimise

ROUGH = 20  # iterations of a solve that only gives a start
TRIED = 8  # landmarks that are tried at another place at most
TURNS = 4  # times that tags are turned, where turning some shows others
SWINGS = 8  # parts that are swung about the tags that they hang on


@dataclass(frozen=True, eq=False)
class Begun:
    """What a piece is solved from: `guesses` of its variables (see `starts`), or one estimate that is `near` the
    optimum. They are made once, whatever of the piece turns out to travel raw."""

    guesses: Sequence[Values]
    near: bool = False

    @classmethod
    def of(cls, piece: Dataset, near: Values | None = None) -> "Begun":
        """From an estimate, else from a piece's own measurements. Raises ModelError where they are not one robot's."""
        robot = the_robot(piece)
        for table in piece.tables:
            refuse_borrowed(table, piece.names)
        return cls(starts(piece, robot)) if near is None else cls([near], near=True)


@dataclass(frozen=True, eq=False)
class Problem:
    """The least squares of one piece: its `system`, the rows that travel `raw`, the `guesses` of what the system holds,
    what it was `begun` from, and landmarks that were found `loose`; `base`: the first pose, in whose frame it is
    solved."""

    piece: Dataset
    base: int
    system: System
    raw: Sequence[Table]
    guesses: Sequence[Values]
    begun: Begun
    loose: IntArray

    @classmethod
    def of(cls, piece: Dataset, begun: Begun, loose: IntArray = np.zeros(0, np.int64)) -> "Problem":  # noqa: B008
        """The problem of a piece, solved in the frame of its first pose; what a start does not hold travels raw."""
        robot = the_robot(piece)
        poses = own_chain(piece, robot)
        known = begun.guesses[0].layout
        inside, raw = gaussian_part(piece.tables, robot, poses, known.select(~np.isin(known.keys, loose)))
        held = distinct(np.concatenate([poses, *(distinct(column) for t in inside for column in t.keys.T)]))
        whole = [guess.only(held) for guess in begun.guesses if guess.layout.contains(held).all()]
        guesses = [guess.seen_from(guess.pose(int(poses[0])), guess.layout) for guess in whole]
        system = System(guesses[0].layout, tables=inside, fixed=poses[:1], names=piece.names)
        return cls(piece, int(poses[0]), system, raw, guesses, begun, loose)

    def without(self, keys: IntArray) -> "Problem":
        """The same in which sightings of some landmarks more travel raw."""
        return Problem.of(self.piece, self.begun, np.append(self.loose, keys))

    @classmethod
    def bare(cls, piece: Dataset, begun: Begun) -> "Problem":
        """The problem of the robot's own way, in which nothing that was seen from it takes part."""
        own = own_chain(piece, the_robot(piece))
        return cls.of(piece, begun, np.setdiff1d(piece.layout.keys, own))

    def driven(self, options: Options, progress: Callable[[Step], None] | None) -> list[Solution]:
        """The optimum from the way solved part by part, where it leads to one."""
        start = driven_start(self.piece, int(robot_of(self.base)), self.system.tables)
        keys = self.guesses[0].layout.keys
        if not start.layout.contains(keys).all():
            return []
        try:
            return [firm(self.system, optimise(self.system, start.only(keys), options, progress))]
        except SolveError:
            return []

    def placed(self, optimum: Solution, options: Options, progress: Callable[[Step], None] | None) -> Solution:
        """The optimum with landmarks where what sees them costs less, while that gains: itself, where none does."""
        return while_lower(
            optimum,
            lambda found: found,
            lambda found: elsewhere(found.values, self.system.tables, np.array([self.base])),
            lambda other: firm(self.system, optimise(self.system, other, options, progress)),
        )

    def upright(self, optimum: Solution, options: Options, progress: Callable[[Step], None] | None) -> Solution:
        """The optimum with no tag left the wrong way round (see `mirrored` and `yielded`), and no part that hangs on
        one (see `hinges`): itself, where none is."""
        for _ in range(TURNS):
            other = turned(optimum.values, self.system.tables)
            if other is None:
                other = turned_with_its_eyes(optimum.values, self.system.tables, self.base)
            found = None if other is None else self._lower(optimum, other, options, progress)
            if found is None:
                break
            optimum = found
        for _ in range(SWINGS):
            ways = swung(optimum.values, self.system.tables, self.base)
            lower = (self._lower(optimum, other, options, progress) for other in ways)
            found = next((found for found in lower if found is not None), None)
            if found is None:
                break
            optimum = found
        return optimum

    def _lower(
        self, optimum: Solution, start: Values, options: Options, progress: Callable[[Step], None] | None
    ) -> Solution | None:
        """The optimum from elsewhere, where it costs less."""
        try:
            found = firm(self.system, optimise(self.system, start, options, progress))
        except SolveError:
            return None
        return found if found.is_lower_than(optimum) else None

    def undecided(self, optimum: Solution, options: Options) -> IntArray:
        """Landmarks that fit at two places, or that nothing holds where they came to lie: which place is right the team
        may know, so their sightings travel raw. One that fits elsewhere only if poses give way is tried there."""
        found: list[IntArray] = [np.zeros(0, np.int64)]
        if not optimum.converged:
            found.append(adrift(optimum.values, self.system.tables, settled=False))
        for two in twofold(optimum.values, self.system.tables):
            lies_open = two.open | (two.more < RULED_OUT) & ~two.by_nature
            found.append(two.keys[lies_open])
            rest = two.select(~lies_open & ~two.by_nature)
            for place in np.argsort(rest.more)[:TRIED].tolist():
                one = slice(place, place + 1)
                moved = optimum.values.update(Values.of({rest.kind: (rest.keys[one], rest.others[one])}))
                with suppress(SolveError):
                    other = firm(self.system, optimise(self.system, moved, replace(options, max_iterations=ROUGH)))
                    if other.cost < optimum.cost + RULED_OUT and apart(self.system, other, optimum):
                        found.append(rest.keys[one])
        return np.concatenate(found)

    def submap(self, solution: Solution, id: str | None, version: int) -> Submap:
        """What is kept of a solution, seen from where that is seen best (see `eyes`): its measurements, linearised in
        that frame."""
        piece, robot = self.piece, int(robot_of(self.base))
        base = best_seen_from(own_chain(piece, robot), self.system.tables, solution.values)
        values = solution.values.seen_from(solution.values.pose(base), solution.values.layout)
        return Submap(
            id=id or f"{piece.names.robot(robot)}/{int(index_of(self.base))}",
            version=version,
            base=base,
            base_dim=piece.robots[robot],
            values=values.select(values.layout.keys != base),
            information=lambda: self._information(solution, base, values),
            sources=Sources.of(piece.tables),
            names=piece.names,
            raw=tuple(self.raw),
            cost=solution.cost,
            chi2=solution.chi2,
            rows=solution.rows,
        )

    def _information(self, solution: Solution, base: int, values: Values) -> sp.csr_array:
        """The information of the measurements at a solution, whose `values` are seen from a base."""
        if base == self.base:
            return solution.information
        system = System(values.layout, tables=self.system.tables, fixed=np.array([base]), names=self.piece.names)
        return system.linearise(values).hessian.to_csr()


def apart(system: System, one: Solution, other: Solution) -> bool:
    """Whether two estimates of one system are more than a sigma apart."""
    keys = system.free.keys
    difference = one.values.only(keys).minus(other.values.only(keys))
    return float(difference @ (other.information @ difference)) > 1.0


def gaussian_part(
    tables: Iterable[Table], robot: int, poses: IntArray, known: Layout
) -> tuple[list[Table], list[Table]]:
    """A piece's tables in two parts: the rows that the submap's Gaussian holds, and those that travel raw.

    `poses` are the robot's own poses of the piece, `known` the variables that its measurements fix.
    """
    inside, raw = [], []
    for table in tables:
        keep = _holds(table, robot, poses, known)
        inside += [table.select(keep)] if keep.any() else []
        raw += [table.select(~keep)] if not keep.all() else []
    return inside, raw


def _holds(table: Table, robot: int, poses: IntArray, known: Layout) -> BoolArray:
    """Which rows the Gaussian of a robot's submap can hold."""
    if table.row.unary:
        return np.zeros(len(table), bool)  # absolute: written in the world's frame, which no submap knows
    target = table.keys[:, 1]
    other_robot = is_pose(target) & (robot_of(target) != robot)
    whole_robot = table.model == "relative_pose" and table.loss.name == "squared"
    own = among(table.keys, poses).all(1) | (is_landmark(target) & known.contains(target))
    return np.where(other_robot, whole_robot & known.contains(target), own)


def the_robot(piece: Dataset) -> int:
    """The one robot whose measurements a piece holds. Raises ModelError where they are of several, or of none."""
    expect(piece, Dataset, "a piece of a log (a Dataset, of ts.split)")
    owners = sorted({table.robot for table in piece.tables})
    if len(owners) != 1:
        raise ModelError(f"a submap is built from one robot's measurements, found those of {len(owners)} robots")
    return owners[0]
