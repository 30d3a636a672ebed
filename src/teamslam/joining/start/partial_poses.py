"""Landmarks that have a heading, placed from several sightings of which none tells their whole pose.

A relative pose whose information has a zero direction says nothing there; from another place or heading the direction
that is open is another one, and two such sightings may fix the landmark.

    propose:  where the sighting that tells most would have it
    solve:    the least squares of the landmarks alone, from poses that stand; one that stays open is left out
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.frontend.tags.whole_poses import tells_pose
from teamslam.joining.start.targets import measured_poses
from teamslam.model import Kind, Layout, Table, Values
from teamslam.solver import System, convex_start, optimise, refuse_rounding


def place_from_parts(start: Values, tables: Sequence[Table], layout: Layout) -> Values:
    """`start` with those landmarks of `layout` that are poses and that all their sightings in `tables` together fix."""
    known = [t.select(start.layout.contains(t.keys[:, 0]) & layout.contains(t.keys[:, 1])) for t in tables]
    rows = [t for t in known if len(t)]
    guess = _proposed(start, rows, layout)
    while len(guess):
        mine = [t.select(guess.layout.contains(t.keys[:, 1])) for t in rows]
        seers = np.unique(np.concatenate([t.keys[:, 0] for t in mine]))
        both = start.only(seers).update(guess)
        system = System(both.layout, tables=[t for t in mine if len(t)], fixed=seers)
        try:
            solution = optimise(system, convex_start(system, both))
            refuse_rounding(system, solution)
            return start.update(solution.values.only(guess.layout.keys))
        except SolveError as error:
            if error.key is None or not guess.layout.contains(np.array([error.key])).any():
                return start
            guess = guess.select(guess.layout.keys != error.key)
    return start


def _proposed(start: Values, rows: Sequence[Table], layout: Layout) -> Values:
    """Each landmark where the sighting of its pose that tells most has it; none of which too little was measured."""
    best: dict[int, tuple[int, Table, int]] = {}
    told = Counter[int]()
    for table in rows:
        for row, (key, rank) in enumerate(zip(table.keys[:, 1].tolist(), table.ranks.tolist(), strict=True)):
            told[key] += rank
            if tells_pose(table) and (key not in best or rank > best[key][0]):
                best[key] = (rank, table, row)
    out = Values.of({})
    for key, (_, table, row) in best.items():
        kind = Kind(int(layout.kinds[layout.index(np.array([key]))][0]))
        if kind.is_pose and told[key] >= kind.dof:
            part = table.select(np.array([row]))
            observer = start.poses_of(part.keys[:, 0], max(kind.dim, part.dim))
            seen = (observer @ measured_poses(part, observer.dim)).onto(kind.dim)
            out = out.update(Values.of({kind: (np.array([key]), seen)}))
    return out
