"""Constellations: what each robot knows of the landmarks alone, as small submaps in its own frame.

A robot that calls two landmarks by each other's names is at one with itself: its map is right but for the names. It is
the team that disagrees. So labels are judged between constellations, in which all else is eliminated exactly: a few
dozen numbers a robot, joined in milliseconds, which allows thousands of what-ifs.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.joining import condense, join
from teamslam.model import Sources, Submap, robot_of

FEWEST = 2  # landmarks of a constellation that says anything


def constellations(submaps: Sequence[Submap]) -> dict[int, list[Submap]]:
    """By robot, what it knows of landmarks: one submap of landmarks alone for each part of its way that hangs together,
    `id` and frame of that part, without an account of what went in: they are for what-ifs. Robots with fewer than two
    landmarks have none."""
    found: dict[int, list[Submap]] = {}
    for robot in dict.fromkeys(int(robot_of(submap.base)) for submap in submaps):
        own = [replace(submap, raw=(), sources=Sources()) for submap in submaps if robot_of(submap.base) == robot]
        maps = [c.map for c in join(own).components] if len(own) > 1 else own
        known = [constellation for part in maps if (constellation := _of(part)) is not None]
        if known:
            found[robot] = known
    return found


def _of(part: Submap) -> Submap | None:
    marks = part.landmark_keys
    if len(marks) < FEWEST:
        return None
    try:
        return condense(part, marks)[0]
    except TeamslamError:
        return None  # a landmark is not determined: the join, should there be one, names it


def renamed(submap: Submap, names: dict[int, int]) -> Submap:
    """A submap with landmarks called by other names, all else as it was. Law: an exchange twice is no exchange."""
    old = submap.values.layout.keys
    new = np.array([names.get(key, key) for key in old.tolist()], np.int64)
    if np.array_equal(old, new):
        return submap
    values = submap.values.renamed(old, new)
    # Where each unknown of the new layout stood in the old one.
    back = np.zeros(len(old), np.int64)
    back[values.layout.index(new)] = np.arange(len(old))
    moved = submap.values.layout.unknowns(old[back])
    return replace(submap, values=values, information=submap.information[moved][:, moved])
