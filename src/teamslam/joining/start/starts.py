"""Start values of a piece of log: guesses of everything that its measurements fix, in the frame of its first pose.

    relative poses close loops    `chordal`: headings and places in closed form
    the heading stays known       dead reckoning
    it may be lost by a turn      dead reckoning, and bent ways (`wound`), where the way is short
    it is lost in space           `by_targets`, where tags were seen
    it is lost on a long way      `grown` from short stretches, by the landmarks
    what comes of these misfits   `driven`: solved part by part, in the order in which the robot went

Targets stand where they were first seen whole, the others where several sightings put them. Of several starts that of
the lowest cost counts in the end. There are at most BENDS of them, however long the log, and each takes time in
proportion to its length.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.frontend.tags.by_targets import by_targets
from teamslam.joining.start.blurred import blurred
from teamslam.joining.start.chordal import chordal
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.joining.start.driven import driven
from teamslam.joining.start.grown import grown
from teamslam.joining.start.odometry import heading_variances, own_rows
from teamslam.joining.start.targets import place_targets
from teamslam.joining.start.triangulate import triangulate
from teamslam.joining.start.wound import wound
from teamslam.model import Dataset, Layout, Table, Values, among, is_landmark, pose_kind

HEADING_SIGMA = 0.2  # [rad]: up to here dead reckoning is a good start; a chord errs by about half its square, 2 %
SHORT = 15  # poses of a way that is tried bent; longer ones are grown


def starts(piece: Dataset, robot: int) -> list[Values]:
    """Start values of all of a piece's variables that its sightings fix; those left open are absent.

    There are several where it cannot be told which of them is nearest to the best optimum. Raises ModelError where the
    robot's own relative poses do not hang together.
    """
    return [with_targets(way, piece, robot) for way in ways(piece, robot)]


def with_targets(way: Values, piece: Dataset, robot: int) -> Values:
    """A robot's way with all that its sightings fix from there."""
    kinds = local_kinds(piece.layout, piece.robots[robot])
    guess = triangulate(place_targets(way, piece.tables, kinds), piece.tables)
    return guess.select(~np.isin(guess.layout.keys, blurred(piece, robot, guess)))


def reckoned(piece: Dataset, robot: int) -> Values:
    """Start values by dead reckoning alone, and every target where it was first seen whole."""
    kinds = local_kinds(piece.layout, piece.robots[robot])
    return place_targets(dead_reckoning(piece, robot), piece.tables, kinds)


def driven_start(piece: Dataset, robot: int, tables: Sequence[Table]) -> Values:
    """One more start, for where the others make no sense, from those of the piece's rows that a submap holds."""
    dim = piece.robots[robot]
    return driven(tables, dead_reckoning(piece, robot), local_kinds(piece.layout, dim), dim)


def ways(piece: Dataset, robot: int) -> list[Values]:
    """The robot's way, in as many guesses as there is reason for; with a grown one come the landmarks that made it."""
    dim = piece.robots[robot]
    way = dead_reckoning(piece, robot)
    keys = way.layout.keys
    if _loops(piece, robot, keys):
        own = own_rows(piece, robot)
        relaxed = Values.of({pose_kind(dim): (keys, chordal(own, keys, dim))})
        # A false loop bends what is relaxed, and leaves what is reckoned alone.
        return [relaxed] if all(t.loss.name == "squared" for t in own) else [relaxed, way]
    variances = heading_variances(piece, robot, keys)
    if not np.isfinite(variances).all() or variances.sum() <= HEADING_SIGMA**2:
        return [way]
    if dim == 3 and (led := by_targets(piece.tables, way, variances)) is not None:
        return [led]
    if len(keys) <= SHORT:
        return wound(way, variances)
    return [grown(piece, robot, way, local_kinds(piece.layout, dim))] if _sees_landmarks(piece) else [way]


def local_kinds(layout: Layout, dim: int) -> Layout:
    """The kinds of variables in a robot's own frame: seen from space, a robot on the ground is a pose in space."""
    return Layout.of(layout.keys, layout.kinds | 1 if dim == 3 else layout.kinds)


def _loops(piece: Dataset, robot: int, keys: np.ndarray) -> bool:
    """Whether the robot's own relative poses close loops (another between the same two is none)."""
    pairs = [np.sort(t.keys, 1) for t in own_rows(piece, robot)]
    within = [p[among(p, keys).all(1)] for p in pairs]
    return bool(within) and len(np.unique(np.concatenate(within), axis=0)) > len(keys) - 1


def _sees_landmarks(piece: Dataset) -> bool:
    return any(is_landmark(t.keys[:, -1]).any() for t in piece.tables if not t.row.unary)
