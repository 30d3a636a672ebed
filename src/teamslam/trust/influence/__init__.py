"""Which robot, or which submap, contradicts the rest of the team; and a map as if it had never been there."""

from teamslam.trust.influence.downdate import Downdate, left_out
from teamslam.trust.influence.liars import Judgement, influences, liars, lying_submaps
from teamslam.trust.influence.parts import Part, Problem
from teamslam.trust.influence.removal import without

__all__ = ["Downdate", "Judgement", "Part", "Problem", "influences", "left_out", "liars", "lying_submaps", "without"]
