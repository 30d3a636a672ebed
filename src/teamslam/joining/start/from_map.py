"""A start of a piece from a map that its robot is in already: it goes on from there.

The robot's way is as the map has it, seen from the piece's first pose. What its sightings fix by themselves is there,
as in every start, at the place that the map has for it.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.joining.start.dead_reckoning import own_chain
from teamslam.joining.start.starts import with_targets
from teamslam.model import WORLD, Dataset, Layout, Submap, Values, pose_kind


def from_map(piece: Dataset, maps: Sequence[Submap]) -> Values | None:
    """Start values of one robot's piece, from that of the maps in which its way is; None where none has all of it.

    Law: they hold what `starts` hold that come from the same way. Raises ModelError as `starts` does.
    """
    robot = piece.tables[0].robot
    poses = own_chain(piece, robot)
    way = Layout(poses, np.full(len(poses), pose_kind(piece.robots[robot])))
    for submap in maps:
        known = submap.values if submap.base == WORLD else submap.all_values
        if known.layout.contains(poses).all():
            eye = known.pose(int(poses[0]))
            start = with_targets(known.seen_from(eye, way), piece, robot)
            both = start.layout.select(known.layout.contains(start.layout.keys))
            alike = both.kinds == known.layout.kinds[known.layout.index(both.keys)]
            return start.update(known.seen_from(eye, both.select(alike)))
    return None
