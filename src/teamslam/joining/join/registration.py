"""The rigid motion that takes a map to what was measured in the world, where its rows tell only part: depth, height,
the tilt that an accelerometer knows, fixes of which one coordinate is missing.

    least    by `geometry.register`, each row by its whitening: what it does not tell has no say in where the map goes
    starts   the rigid fit of the rows that tell all of a place, and turns in steps of an eighth (in space a quarter)
             about it, since what little is told may lie beyond a ridge
"""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.geometry import Pose, Registration, Told, align, lift_points, register, rotations, turns_apart
from teamslam.model import Table, Values

MOST = 300  # rows of a table that are looked at, evenly taken
LOOKS, GO_ON = 4, 6  # steps of each start, of which one in so many goes on


def registered(values: Values, absolute: Sequence[Table], dim: int) -> Registration:
    """Where a map goes whose poses and landmarks are among `values`, by rows of the world.

    Law: rows of a map that was moved by X give X in all that they tell, however many numbers of each are missing.
    """
    told = _told(values, absolute, dim)
    found = [register(told, start, LOOKS) for start in _starts(told, dim)]
    best = sorted(found, key=lambda one: one.cost)[: max(1, len(found) // GO_ON)]
    return min((register(told, one.pose) for one in best), key=lambda one: one.cost)


def _told(values: Values, absolute: Sequence[Table], dim: int) -> Told:
    dof = dim + rotations(dim).DOF
    parts = []
    for table in absolute:
        some = table.select(np.unique(np.linspace(0, len(table) - 1, min(len(table), MOST)).astype(np.int64)))
        here, m = min(dim, some.dim), len(some)
        goals, places = lift_points(some.values[:, :here], dim), values.positions(some.keys[:, 0], dim)
        turns = turned = np.tile(np.eye(dim), (m, 1, 1))
        of = np.arange(here)  # the unknowns that its numbers tell of
        if some.model == "pose" and some.dim <= dim:
            turns = values.poses_of(some.keys[:, 0], dim).rotation
            goal = Pose(some.values[:, some.dim :].reshape(m, some.dim, some.dim), some.values[:, : some.dim]).lift(dim)
            turned, goals = goal.rotation, goal.translation
            of = np.append(of, np.arange(dim, dof) if some.dim == dim else [dof - 1])
        given = np.broadcast_to(some.whitening, (m, *some.whitening.shape[1:]))[:, :, : len(of)]
        whitening = np.zeros((m, dof, dof))
        whitening[:, : given.shape[1], of] = given
        if some.sensor is not None and some.model == "position":  # an antenna on its mast
            arm = some.sensor.lift(dim).translation
            places = places + (values.poses_of(some.keys[:, 0], dim).rotation @ arm)
        parts.append((places, goals, turns, turned, whitening))
    return Told(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _starts(told: Told, dim: int) -> Iterator[Pose]:
    """Fits of whole places, and turns about them."""
    whole, middle = told.whole, told.places.mean(0)
    first = align(told.places[whole], told.goals[whole]).pose if whole.any() else Pose.identity(dim)
    goal = first.act(middle)
    for turn in turns_apart(dim):
        yield Pose(turn @ first.rotation, goal - turn @ first.rotation @ middle)
